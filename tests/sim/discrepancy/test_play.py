"""Fits of a gear whose teeth leave each other: what noise makes of them, how far a linear picture reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.discrepancy.data.chatter import told
from sim.discrepancy.data.validation import examine
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import final_fit
from sim.discrepancy.estimation.whitening import Noise
from sim.discrepancy.hypotheses.catalogue import terms_of
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.hypotheses.nonparametric import over_speed
from sim.discrepancy.investigation import investigate
from sim.discrepancy.report.wording import explain
from sim.discrepancy.search.score_test import screen
from tests.sim.discrepancy.telemetry_of import swing

INERTIA, LOAD, RATIO, STIFFNESS, GAP = 0.01, 0.7, 9.0, 7e3, 1.2e-5
NEW = read_axis(
    {
        "motor": {"inertia_kg_m2": INERTIA, "coulomb_friction_n_m": 0.1},
        "stages": [
            {
                "name": "output",
                "ratio": RATIO,
                "stiffness_n_m_per_rad": STIFFNESS,
                "damping_n_m_s_per_rad": 3.0,
                "backlash_rad": GAP,
            }
        ],
        "load": {"inertia_kg_m2": LOAD},
        "load_encoder": {"error_rad": 1e-5},
    }
)


def telemetry(noise_rad: float = 2e-6, gap_rad: float = 0.5 * GAP) -> Telemetry:
    """A load that follows the motor by the twist of its inertia, on either flank of a gap; default: as new."""
    t, angle, speed, acceleration = swing()
    rng = np.random.default_rng(5)
    moment = LOAD * acceleration / RATIO
    load = angle / RATIO - moment / STIFFNESS - 0.5 * gap_rad * np.tanh(moment / 0.5)
    torque = INERTIA * acceleration + moment / RATIO + 0.1 * np.tanh(speed / 0.05)
    return Telemetry(
        t,
        {
            "motor_torque_nm": torque + 0.01 * rng.standard_normal(t.size),
            "motor_position_rad": angle + noise_rad * rng.standard_normal(t.size),
            "load_position_rad": load + 0.1 * noise_rad * rng.standard_normal(t.size),
        },
    )


def problem(axis: Axis = NEW, gap_rad: float = 0.5 * GAP) -> Problem:
    return Problem(axis, examine(axis, telemetry(gap_rad=gap_rad)).measurement, Noise.flat(0.02, 0.5))


def play(one: Problem) -> Term:
    described = {p.name: p.start for p in one.base()}
    return next(t for t in terms_of(NEW, one.measurement, one.chain((), described)) if t.mechanism == "backlash")


def with_gap(one: Problem, gap: float) -> Fit:
    term = play(one)
    return one.fit((term,), {term.parameters[0].name: gap}, iterations=0)


def test_what_noise_makes_of_teeth_does_not_hang_on_the_gap_it_was_learned_with() -> None:
    one = problem()
    fits = [with_gap(one, gap) for gap in (1e-3, 3e-4)]
    first, second = (one.with_reestimated_noise(fit) for fit in fits)
    for fit in fits:
        torque, guide = first.raw_residuals(fit.terms, fit.values)
        other_torque, other_guide = second.raw_residuals(fit.terms, fit.values)
        assert torque == pytest.approx(other_torque, abs=1e-12)
        assert guide == pytest.approx(other_guide, abs=1e-9)


def test_sensitivities_to_what_shifts_the_load_are_taken_within_a_gap_as_new() -> None:
    """Over wider steps teeth change flanks, and a fit that follows such slopes stands still."""
    one = problem()
    steps = {p.name: p.step for p in one.base()}
    speed = one.measurement.load_speed
    assert speed is not None
    assert steps["load_offset_rad"] < 0.5 * GAP
    assert steps["load_delay_s"] * float(np.abs(speed).max()) < GAP


def test_a_gap_promises_what_it_brings_at_the_gap_that_was_simulated() -> None:
    one = problem()
    fit = one.fit(to_end=True)
    term = play(one)
    (promised, _, start), *_ = screen(one, fit, [term])
    brought = fit.cost - one.fit((term,), start, iterations=0).cost
    assert term.contact
    assert start[term.parameters[0].name] in {next(iter(group[0].values())) for group in term.probes}
    assert promised >= brought - 1e-6 * fit.cost  # the rest of the model follows, which can only help


def test_an_explanation_says_where_else_it_may_be() -> None:
    numbers = {"gap_rad": 1e-3}
    assert "not certain" not in explain("backlash", "output", numbers)
    assert "at transfer it explains" in explain("backlash", "output", numbers, ["transfer"])


def test_an_explanation_says_what_the_form_of_a_dent_means() -> None:
    dent = {"angle_rad": 1.0, "depth_rad": 1e-4}
    assert "worn hollow (form 2.0)" in explain("tooth_damage", "output", {**dent, "form": 2.0})
    assert "piece broken out (form 10.0)" in explain("tooth_damage", "output", {**dent, "form": 10.0})


def to_and_fro(described_n_m: float, friction_n_m: float) -> tuple[Axis, Telemetry]:
    """A motor that turns evenly most of the time ahead of a load that no encoder sees, with friction at the load."""
    bare = {**NEW.to_mapping(), "load": {"inertia_kg_m2": LOAD, "coulomb_friction_n_m": described_n_m}}
    bare["stages"][0]["backlash_rad"] = 1e-5
    bare.pop("load_encoder")
    t = np.arange(0.0, 12.0, 5e-4)
    speed = 20.0 * np.tanh(4.0 * np.sin(2.0 * np.pi * t / 6.0))
    angle = np.cumsum(speed) * 5e-4
    torque = (INERTIA + LOAD / RATIO**2) * np.gradient(speed, t) + (0.1 + friction_n_m / RATIO) * np.tanh(speed / 0.05)
    rng = np.random.default_rng(8)
    channels = {
        "motor_torque_nm": torque + 0.01 * rng.standard_normal(t.size),
        "motor_position_rad": angle + 2e-5 * rng.standard_normal(t.size),
    }
    return read_axis(bare), Telemetry(t, channels)


def coasting(described_n_m: float) -> Problem:
    axis, measured = to_and_fro(described_n_m, described_n_m)
    return Problem(axis, examine(axis, measured).measurement, Noise.flat(0.02, 0.5))


def test_rows_in_which_teeth_rattle_do_not_count() -> None:
    """Nothing presses the teeth together while the axis coasts; a little friction at the load does."""
    loose, pressed = (coasting(friction) for friction in (0.0, 0.1))
    described = {p.name: p.start for p in loose.base()}
    counts = loose.told((), described).measurement.told > 0.5
    nudged = {**described, "load.inertia_kg_m2": (1.0 + 1e-4) * LOAD}
    apart = np.abs(np.subtract(*(loose.raw_residuals((), values)[0] for values in (described, nudged))))
    assert 0.2 < counts.mean() < 0.8
    assert np.mean(apart[counts] ** 2) < 0.3 * np.mean(apart[~counts] ** 2)
    assert pressed.told((), {p.name: p.start for p in pressed.base()}).measurement.told.all()


def test_play_is_looked_for_in_rows_in_which_teeth_rattle_as_well() -> None:
    one = coasting(0.0)
    described = {p.name: p.start for p in one.base()}
    some = one.told((), described)
    assert not some.measurement.told.all()
    assert some.told((play(one),), described).measurement.told.all()
    assert some.with_all_told().measurement.told.all()


def test_friction_is_named_without_which_teeth_would_rattle() -> None:
    axis, measured = to_and_fro(described_n_m=0.0, friction_n_m=0.5)
    without = replace(axis, motor=replace(axis.motor, coulomb_friction_n_m=0.0))
    found = investigate(without, measured)
    assert [f.mechanism for f in found.findings] == ["coulomb_friction"]
    assert found.findings[0].probability > 0.5


def test_a_spell_of_rattle_lasts_from_its_first_sign_to_its_last() -> None:
    """Rough by 0.05 in the middle and by 0.005 around; rough by 0.005 alone is none, nor what bends nowhere."""
    rows = np.zeros(3000)
    rows[1000:1600], rows[1200:1300], rows[2300:2600] = 0.005, 0.05, 0.005
    still = np.zeros(rows.size)
    lost = np.flatnonzero(told([still, still, rows], 1000.0) < 0.5)
    assert lost.min() == pytest.approx(1000, abs=50)
    assert lost.max() == pytest.approx(1600, abs=50)
    assert lost.size == lost.max() - lost.min() + 1
    assert told([still, rows, 2.0 * rows], 1000.0).all()
    assert told([still, still, still + 1.0], 1000.0).all()  # nothing would be left


@pytest.mark.parametrize("even", [False, True])
def test_a_curve_over_the_speed_leaves_friction_the_numbers_that_it_has_without(even: bool) -> None:
    """Its tents together are nearly dry friction: as they were selected they may take any part of it."""
    one = problem()
    curve = over_speed("motor", one.measurement, 0.01, even=even)
    both = one.fit((curve,), to_end=True)
    taken = {p.name: 0.05 for p in curve.parameters}
    friction = "motor.coulomb_friction_n_m"
    shared = one.fit((curve,), {**both.values, **taken, friction: both.values[friction] - 0.05}, iterations=0)
    without, plain = one.fit(to_end=True), final_fit(one, shared)[1]
    assert abs(shared.values[friction] - without.values[friction]) > 0.04
    assert plain.values[friction] == pytest.approx(without.values[friction], abs=0.004)
