"""A fit ends where nothing is left to gain; what is as new is set free only where the data know that it is more."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from benchmarks.harness.telemetry_of import RATE_HZ, one_body, swing
from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.assessment.held_out_gain import gains
from sim.investigation.assessment.remarks import misfit_remarks
from sim.investigation.data.validation import examine
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import calibrate
from sim.investigation.estimation.whitening import Noise
from sim.investigation.investigate import investigate
from sim.investigation.model.nominal import MOTOR_STRETCH
from sim.investigation.model.parameters import Parameter

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
    assert misfit_remarks(fit, gained, ()) == ()
    edge = replace(fit, values={**fit.values, "motor.inertia_kg_m2": 0.0})
    (stated,), (open_,) = misfit_remarks(edge, gained, ()), misfit_remarks(edge, gained, {"motor.inertia_kg_m2"})
    assert "by a factor" in stated
    assert "by a factor" not in open_, "nobody gave it"


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


def test_noise_that_grows_with_what_is_fitted_widens_its_deviation() -> None:
    even, grown = two_columns(0.0), two_columns(0.0, scores=4.0)
    assert grown.deviation({"a": 1.0}) > 3.0 * even.deviation({"a": 1.0})
