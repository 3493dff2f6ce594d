"""A fit ends where nothing is left to gain; what is as new is set free only where the data know that it is more."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from casebase.signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.discrepancy.assessment.cross_validation_gain import gains
from sim.discrepancy.assessment.remarks import misfit_remarks
from sim.discrepancy.data.preprocessing import prepare, standstill_weight
from sim.discrepancy.data.validation import examine
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.levenberg_marquardt import MOST_STEPS, NormalEquations, State, cost_of
from sim.discrepancy.estimation.problem import MISTAKEN, Problem
from sim.discrepancy.estimation.refit import calibrate, look_closely
from sim.discrepancy.estimation.whitening import Noise
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.hypotheses.traits import OVER_SPEED
from sim.discrepancy.investigation import investigate
from sim.discrepancy.model.nominal import MOTOR_STRETCH, nuisance_of
from sim.discrepancy.model.parameters import Parameter
from sim.discrepancy.parallel import each
from sim.discrepancy.search.effect_size import beyond, magnitude
from sim.torsional.model import Array
from tests.sim.discrepancy.telemetry_of import RATE_HZ, one_body, swing

AXIS = {
    "motor": {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
    "load": {"inertia_kg_m2": 0.0},
}


def axis() -> Axis:
    return read_axis(AXIS)


def problem(telemetry: Telemetry) -> Problem:
    return Problem(axis(), examine(axis(), telemetry).measurement, Noise.flat(0.05, 1.0))


@pytest.mark.parametrize("seed", [1, 2])
def test_a_finished_fit_ends_in_the_same_place_from_wherever_it_starts(seed: int) -> None:
    one = problem(one_body(0.3, 1.0, 0.02, seed))
    near = one.fit(to_end=True)
    bent = {"motor.inertia_kg_m2": 0.2, "motor.coulomb_friction_n_m": 1.9, "offset_n_m": 0.2}
    far = one.fit((), bent, to_end=True)
    assert far.cost == pytest.approx(near.cost, rel=1e-5)  # over which speed friction turns hardly shows here
    assert far.values["motor.inertia_kg_m2"] == pytest.approx(near.values["motor.inertia_kg_m2"], rel=1e-3)


def test_friction_that_builds_up_over_a_way_is_no_inertia() -> None:
    """After a reversal it is less than before it, at the same speed: a law of the speed alone takes that for torque
    along the acceleration."""
    t, angle, speed, acceleration = swing()
    inertia, coulomb, way = 0.003, 1.0, 0.2
    held = np.empty(t.size)
    level = 1.0
    for k, step in enumerate(np.diff(angle, prepend=angle[0])):
        level = np.sign(step) + (level - np.sign(step)) * np.exp(-abs(step) / way)
        held[k] = level
    torque = inertia * acceleration + coulomb * held + 0.02 * speed
    torque += 0.05 * np.random.default_rng(1).standard_normal(t.size)
    light = read_axis({"motor": {**AXIS["motor"], "inertia_kg_m2": inertia}, "load": {"inertia_kg_m2": 0.0}})
    telemetry = Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": angle})
    doubts = np.full((t.size, 1), 1e-6)  # as those of a joint, whose rigid body nobody knows for sure
    known = Telemetry(t, {**telemetry.channels, "known_torque_nm": np.zeros(t.size)})
    one = Problem(light, examine(light, known, doubts).measurement, Noise.flat(0.05, 1.0))
    one.doubts = {"motor.inertia_kg_m2": 10.0}
    fit = one.fit(to_end=True)
    assert fit.values["motor.inertia_kg_m2"] == pytest.approx(inertia, rel=0.02)
    assert math.exp(fit.values[MOTOR_STRETCH]) == pytest.approx(way, rel=0.05)


def test_what_a_known_torque_is_doubted_by_is_no_noise_as_well() -> None:
    """It was counted twice: along its doubted ways, and in the noise that hid whatever is as slow."""
    t, angle, speed, acceleration = swing()
    doubts = 2.0 * np.stack([np.ones(t.size), np.sin(0.3 * t)], axis=1)
    wrong = doubts @ np.array([1.0, -1.5])
    torque = 0.003 * acceleration + 0.02 * speed + 0.05 * np.random.default_rng(1).standard_normal(t.size)
    light = read_axis({"motor": {**AXIS["motor"], "inertia_kg_m2": 0.003}, "load": {"inertia_kg_m2": 0.0}})
    squares = []
    for off in (0.0 * wrong, wrong):
        channels = {"motor_torque_nm": torque + off, "motor_position_rad": angle, "known_torque_nm": np.zeros(t.size)}
        one = Problem(light, examine(light, Telemetry(t, channels), doubts).measurement, Noise.flat(0.05, 1.0))
        one, fit = calibrate(one)
        squares.append(fit.misfit / fit.residual.size)
    assert squares[1] == pytest.approx(squares[0], rel=0.1)


def test_what_friction_holds_at_rest_is_no_misfit() -> None:
    """A servo leaves any torque that friction bears while it stands, and a model of the motion cannot tell which."""
    t = np.arange(12 * int(RATE_HZ)) / RATE_HZ
    speed, angle = np.zeros(t.size), np.zeros(t.size)
    for start, way in ((1.0, 1.0), (4.0, -1.0), (7.0, 1.0), (10.0, -1.0)):
        u = np.clip(t - start, 0.0, 1.0)
        speed += way * 20.0 * (1.0 - np.cos(2.0 * np.pi * u))
        angle += way * 20.0 * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
    rng = np.random.default_rng(2)
    stands = rng.uniform(-0.9, 0.9, 13)[t.astype(int)] * (speed == 0.0)
    torque = 0.002 * np.gradient(speed, t) + np.sign(speed) + 0.02 * speed + stands
    torque += 0.05 * rng.standard_normal(t.size)
    light = read_axis({"motor": {**AXIS["motor"], "inertia_kg_m2": 0.002}, "load": {"inertia_kg_m2": 0.0}})
    telemetry = Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": angle})
    one = Problem(light, examine(light, telemetry).measurement, Noise.flat(0.05, 1.0))
    fit = one.fit(to_end=True)
    gained = gains(one, fit, fit, ())
    assert misfit_remarks(fit, gained) == ()


@pytest.mark.parametrize("width", [-2.0, 0.5, 1.0])
def test_a_finished_fit_ends_in_sensitivities_of_where_it_ended(width: float) -> None:
    """Those that steps have corrected on the way are off by several times their own size where an effect is curved."""
    one = problem(one_body(0.3, 1.0, 0.02, 3))
    wide = Parameter("width", 0.5, 3.0)
    curve = Term(OVER_SPEED, "motor", (wide,), (), dict, torque=lambda m, v: np.tanh(m.speed / np.exp(v["width"])))
    bent = {"motor.inertia_kg_m2": 0.2, "motor.coulomb_friction_n_m": 1.9, "offset_n_m": 0.2, "width": width}
    ended = one.fit((curve,), bent, to_end=True)
    there = one.fit((curve,), ended.values, iterations=0)
    np.testing.assert_allclose(ended.jacobian, there.jacobian, atol=1e-3 * float(np.abs(there.jacobian).max()))


def test_numbers_that_a_fit_is_given_beyond_their_limits_start_at_the_limit() -> None:
    one = problem(one_body(0.3, 1.0, 0.02, 3))
    limit = next(p for p in one.base() if p.name == "motor.inertia_kg_m2").high
    assert one.fit((), {"motor.inertia_kg_m2": 10.0 * limit}, iterations=0).values["motor.inertia_kg_m2"] == limit


def test_an_effect_that_the_data_do_not_show_is_not_beyond_anything() -> None:
    one = problem(one_body(0.3, 1.0, 0.02, 4))
    parameter = next(p for p in one.base() if p.name == "offset_n_m")
    silent = Term("nothing", None, (parameter,), (), lambda v: {"size": 5.0}, size=1.0)
    fit = one.fit(to_end=True)
    assert magnitude(silent, fit.values) == 5.0
    unknown = Term(
        "unseen", None, (type(parameter)("unseen", 5.0, 1.0),), (), lambda v: {"size": v["unseen"]}, size=1.0
    )
    assert beyond(unknown, one.fit((unknown,), to_end=True)) < 0.01


def test_an_offset_is_named_where_it_is_more_than_as_new_and_fitted_where_it_is_not() -> None:
    said = investigate(axis(), one_body(0.3, 1.0, 0.02, 5, extra=0.5))
    assert [f.mechanism for f in said.findings] == ["torque_offset"]
    assert said.findings[0].parameters[0].value == pytest.approx(0.5, rel=0.1)
    assert investigate(axis(), one_body(0.3, 1.0, 0.02, 5, extra=0.03)).findings == ()


def test_a_channel_that_is_late_is_named_with_its_delay() -> None:
    told = one_body(0.3, 1.0, 0.02, 6, noise_n_m=0.2)
    late = int(0.004 * RATE_HZ)
    torque = np.concatenate([np.full(late, told["motor_torque_nm"][0]), told["motor_torque_nm"][:-late]])
    channels = {"motor_torque_nm": torque, "motor_position_rad": told["motor_position_rad"]}
    said = investigate(axis(), Telemetry(told.time_s, channels))
    assert [f.mechanism for f in said.findings] == ["time_delay"]
    assert said.findings[0].parameters[0].value == pytest.approx(0.004, rel=0.15)


def two_columns(alike: float, scores: float = 0.0) -> Fit:
    """A fit of unit noise to two columns of which only the difference from `alike` tells them apart."""
    rng = np.random.default_rng(7)
    first, second = rng.standard_normal((2, 4000))
    columns = np.stack([first, alike * first + np.sqrt(1.0 - alike**2) * second], axis=1)
    residual = rng.standard_normal(4000) * (1.0 + scores * np.abs(first))
    residual -= columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    parameters = (Parameter("a", 0.0, 1.0), Parameter("b", 0.0, 1.0))
    return Fit((), parameters, {"a": 0.0, "b": 0.0}, residual, columns, float(residual @ residual), 4000)


def test_a_sum_is_known_where_its_parts_are_not() -> None:
    fit = two_columns(0.9999)
    parts, together = fit.deviations(), fit.deviation({"a": 1.0, "b": 1.0})
    assert together < 0.03 * min(parts.values())
    assert fit.deviation({"a": 1.0}, known=["b"]) == pytest.approx(1.0 / np.sqrt(4000), rel=0.2)


def test_what_has_run_into_a_limit_leaves_the_others_known() -> None:
    fit = two_columns(0.9999)
    held = replace(fit, parameters=(fit.parameters[0], Parameter("b", 0.0, 1.0, low=0.0)))
    assert held.deviation({"a": 1.0}) == pytest.approx(fit.deviation({"a": 1.0}, known=["b"]), rel=1e-9)
    assert held.deviation({"b": 1.0}) == pytest.approx(fit.deviation({"b": 1.0}), rel=1e-9)


def test_fits_under_different_noise_are_compared_by_their_likelihood() -> None:
    """Minus twice the log density of independent normal residuals, but for the logs of 2 pi."""
    residual, guide = np.random.default_rng(2).standard_normal((2, 500))
    for torque_sd, guide_sd in ((0.5, 2.0), (0.1, 30.0)):
        noise = Noise.flat(torque_sd, guide_sd)
        white = noise.whiten(residual, guide[:100])
        density = norm.logpdf(residual, scale=torque_sd).sum() + norm.logpdf(guide[:100], scale=guide_sd).sum()
        expected = -2.0 * density - 600.0 * np.log(2.0 * np.pi)
        assert float(white @ white) + noise.log_scale(500, 100) == pytest.approx(expected)


def test_what_a_data_sheet_has_wrong_costs_as_the_log_of_how_far_it_is_off() -> None:
    """Within some deviations as their square; beyond, by the spread that makes it likeliest."""
    one = problem(one_body(0.3, 1.0, 0.02, 6))
    name = "motor.inertia_kg_m2"
    known = next(p for p in one.base() if p.name == name)

    def cost(far: float) -> float:
        at = {**one.numbers(), name: known.expected + far * known.spread}
        other = one.with_reestimated_noise(one.fit((), at, iterations=0))
        fit = other.fit((), at, iterations=0)
        return other.neg2_log_posterior(fit) - fit.misfit - other.noise.log_scale(fit.residual.size, 0)

    assert cost(2.0) == pytest.approx(4.0)
    assert cost(MISTAKEN) == pytest.approx(MISTAKEN**2)
    assert cost(2.0 * MISTAKEN) == pytest.approx(MISTAKEN**2 + 2.0 * np.log(2.0))
    back = one.with_reestimated_noise(
        one.fit((), {name: known.expected + 20.0 * known.spread}, iterations=0)
    ).with_reestimated_noise(one.fit(iterations=0))
    assert back.base() == one.base(), "a fit that goes back to the sheet is trusted again"


def to_and_fro(duration_s: int) -> Array:
    """Angle [rad] that goes one way for 1.5 s, rests for half a second and comes back, over and over."""
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    u = np.clip((t % 4.0) / 1.5, 0.0, 1.0) - np.clip((t % 4.0 - 2.0) / 1.5, 0.0, 1.0)
    return np.asarray(60.0 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def looked_at_closely(stretch_rad: float, release: float, held_n_m: float = 0.0) -> tuple[Problem, Fit]:
    """An axis whose friction gives way by `stretch_rad` before it slides, to and fro with rests between.

    At each rest it holds up to `held_n_m` more that nothing in the motion tells.
    """
    geared = read_axis(
        {
            "motor": {"inertia_kg_m2": 0.02, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.01},
            "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 96, "stiffness_n_m_per_rad": 1e5}],
            "load": {"inertia_kg_m2": 0.5},
        }
    )
    angle = to_and_fro(30)
    rng = np.random.default_rng(8)
    still = prepare(RATE_HZ, np.zeros(angle.size), angle, angle / 8.0 + 3e-6 * rng.standard_normal(angle.size))
    one = Problem(geared, still, Noise.flat(0.05, 1.0))
    start = {p.name: p.start for p in one.base()}
    holds = replace(nuisance_of(start), stretch_rad=(stretch_rad, 1e-9), friction_width=(release, 1e-3))
    moved = one.observer.predict(one.chain((), start), holds).torque
    noise = 0.02 * rng.standard_normal(moved.size)
    held = standstill_weight(still.slow_speed, still.standstill) == 0.0
    noise += rng.uniform(-held_n_m, held_n_m, 16)[(still.time_s // 2.0).astype(int)] * held
    return look_closely(*calibrate(Problem(geared, replace(still, torque=moved + noise), Noise.flat(0.05, 1.0))))


def test_noise_is_that_of_rows_at_rest_after_what_friction_holds_there_is_fitted() -> None:
    """What it holds before would pass for slow noise, and hide whatever acts over whole strokes."""
    closely, fit = looked_at_closely(0.01, 2e-5)
    assert closely.measurement.rests
    rows = fit.residual[: fit.torque_rows] * (closely.measurement.moving > 0.5)
    slow = np.convolve(rows, np.ones(500) / np.sqrt(500.0), "same")[closely.measurement.moving > 0.5]
    assert np.mean(slow**2) == pytest.approx(1.0, rel=0.7)


def test_rows_at_rest_say_nothing_where_friction_gives_way_by_less_than_the_encoder_sees() -> None:
    assert not looked_at_closely(2e-5, 1e-9)[0].measurement.rests


def test_rows_at_rest_say_nothing_where_friction_sticks_at_what_the_servo_did_before() -> None:
    assert not looked_at_closely(0.01, 2e-5, held_n_m=0.5)[0].measurement.rests


def test_a_simulation_that_bursts_is_far_off_and_no_number_is_lost() -> None:
    closely, fit = looked_at_closely(0.01, 2e-5)
    burst = {**fit.values, "stages.output.damping_n_m_s_per_rad": -1e9}
    residual = closely.residual((), burst)
    assert np.isfinite(residual).all()
    assert residual @ residual > 1e6 * fit.misfit


def test_noise_that_grows_with_what_is_fitted_widens_its_deviation() -> None:
    even, grown = two_columns(0.0), two_columns(0.0, scores=4.0)
    assert grown.deviation({"a": 1.0}) > 3.0 * even.deviation({"a": 1.0})


def test_what_is_fitted_side_by_side_is_what_is_fitted_one_after_the_other() -> None:
    one = problem(one_body(0.3, 1.0, 0.02, 6))
    starts = [{"motor.inertia_kg_m2": j} for j in (0.2, 0.3, 0.4)]
    together = each(lambda start: one.fit((), start), starts)
    assert [f.cost for f in together] == [one.fit((), start).cost for start in starts]


def test_where_the_model_is_straight_sensitivities_foretell_what_a_step_gains() -> None:
    """Inertia, friction and offset are linear in the torque: the first step lands, and its gain is known before."""
    one = problem(one_body(0.3, 1.0, 0.02, 7))
    parameters = tuple(p for p in one.base() if p.name != "torque_delay_s")
    values = {p.name: p.start for p in one.base()} | {"motor.inertia_kg_m2": 0.25}
    raw = one.raw_residuals((), values)
    columns = one.whitened(parameters, one.sensitivities((), values, parameters, raw))
    system = NormalEquations.of(parameters, columns)
    before = State(values, raw, one.noise.whiten(*raw), 0.0)
    before.cost = cost_of(before.residual, parameters, values)
    moved = values | system.stepped(parameters, values, columns.T @ before.residual, 0.0)
    after = State(moved, raw, one.residual((), moved), 0.0)
    gain = before.cost - cost_of(after.residual, parameters, moved)
    assert gain > 1e4
    assert system.promised(parameters, before, after) == pytest.approx(gain, rel=1e-3)


def test_a_try_that_leads_nowhere_is_given_up_and_a_fit_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Far above the noise, where each step gains a tenth."""
    steps: list[float] = []

    def slow(_problem: object, _terms: object, _parameters: object, state: State, *_: object) -> tuple[float, float]:
        steps.append(state.cost)
        state.cost *= 0.9
        return 0.1 * steps[-1], 1e-4

    one = problem(one_body(0.3, 1.0, 0.02, 8, extra=40.0))
    monkeypatch.setattr(Problem, "_step", slow)
    one.fit()
    assert len(steps) == 2
    one.fit(to_end=True)
    assert len(steps) == 2 + MOST_STEPS[False]
