"""A gear of which only the ratio is described errs some times per turn of its input shaft."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signals.telemetry import Telemetry
from sim.description.axis import Axis, Load, LoadEncoder, Motor
from sim.description.axis_document import read_axis
from sim.experiment.virtual_measurement import measure
from sim.investigation.data.excitation import beyond_twice
from sim.investigation.data.validation import examine
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.investigation.extended_axis import extended_by
from sim.investigation.hypotheses.catalogue import terms_of
from sim.investigation.hypotheses.nonparametric import error_over_angle
from sim.investigation.investigate import investigate
from sim.mechanisms import KinematicError
from sim.mechanisms.catalogue import with_mechanism

PHASE = 0.7
AXIS = read_axis(
    {
        "name": "strain wave",
        "motor": {"inertia_kg_m2": 2e-4, "coulomb_friction_n_m": 0.04, "viscous_friction_n_m_s_per_rad": 3e-4},
        "stages": [
            {"name": "output", "ratio": 100.0, "stiffness_n_m_per_rad": 25e3, "damping_n_m_s_per_rad": 12.0,
             "transmission_error_rad": 2e-6}
        ],
        "load": {"inertia_kg_m2": 0.8, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.5},
        "load_encoder": {"error_rad": 5e-6},
        "motion": {"period_s": 4.0, "load_speed_rad_s": 1.0, "acceleration_time_s": 0.6},
    }
)  # fmt: skip


def log(axis: Axis, seed: int, stride: int = 1) -> Telemetry:
    """What a drive with this axis records in 8 s, every `stride`-th row of 2 kHz, with noise of sensors."""
    ideal, rng = measure(axis, 8.0, seed).telemetry, np.random.default_rng(seed)
    noise = {"motor_torque_nm": 2e-3, "motor_position_rad": 5e-5, "load_position_rad": 1e-6}
    channels = {name: (ideal[name] + s * rng.standard_normal(ideal.rows))[::stride] for name, s in noise.items()}
    return Telemetry(ideal.time_s[::stride], channels)


def erring(amplitude_rad: float) -> Axis:
    """The axis with an error of its gear twice per turn of the motor."""
    return with_mechanism(AXIS, KinematicError("output", {"amplitude_rad": amplitude_rad, "phase_rad": PHASE}))


@pytest.mark.slow
def test_an_error_twice_per_turn_of_the_motor_is_named_and_measured() -> None:
    result = investigate(AXIS, log(erring(1.5e-4), 1, stride=4))
    (finding,) = [f for f in result.findings if f.probability >= 0.5]
    numbers = {e.name: e.value for e in finding.parameters}
    assert (finding.mechanism, finding.location, numbers["order"]) == ("kinematic_error", "output", 2.0)
    assert numbers["amplitude_rad"] == pytest.approx(1.5e-4, rel=0.1)
    assert numbers["phase_rad"] == pytest.approx(PHASE, abs=0.1)


@pytest.mark.slow
def test_an_encoder_that_errs_over_the_angle_does_not_stand_for_friction() -> None:
    """The load's encoder errs by 0.3 mrad, which the spring would make 7 N m of: both frictions keep their sizes."""
    bare = replace(UNSAID, motor=Motor(AXIS.motor.inertia_kg_m2), load=Load(AXIS.load.inertia_kg_m2))
    true = log(AXIS, 3, stride=4)
    angle = true["load_position_rad"]
    wrong = 3e-4 * np.sin(13.0 * angle) + 1e-4 * np.cos(29.0 * angle)
    result = investigate(bare, replace(true, channels={**true.channels, "load_position_rad": angle + wrong}))
    sizes = {f.mechanism: f.parameters[0].value for f in result.findings if f.probability >= 0.5}
    assert sizes["coulomb_friction"] == pytest.approx(0.04 + 1.0 / 100.0, rel=0.2)
    assert sizes["viscous_friction"] == pytest.approx(3e-4 + 0.5 / 100.0**2, rel=0.3)


def problem() -> Problem:
    return Problem(AXIS, examine(AXIS, log(AXIS, 2, stride=2)).measurement, Noise.flat(0.01, 1.0))


PROBLEM = problem()
UNSAID = replace(
    AXIS, stages=tuple(replace(s, transmission_error_rad=0.0) for s in AXIS.stages), load_encoder=LoadEncoder()
)


def test_it_is_described_as_it_is_found() -> None:
    described = {p.name: p.start for p in PROBLEM.base()}
    terms = terms_of(AXIS, PROBLEM.measurement, PROBLEM.chain((), described))
    two, four = (t for t in terms if t.mechanism == "kinematic_error")
    assert [t.report(dict.fromkeys((p.name for p in t.parameters), 1e-4))["order"] for t in (two, four)] == [2.0, 4.0]
    values = {**described, **{p.name: 1e-4 for p in two.parameters}}
    axis = extended_by(AXIS, values, {("kinematic_error", "output"): two.report(values)})
    found = PROBLEM.raw_residuals((two,), values, weighted=False)
    stored = PROBLEM.of(axis).raw_residuals((), described, weighted=False)
    plain = PROBLEM.raw_residuals((), described, weighted=False)
    for with_term, with_entry, without in zip(found, stored, plain, strict=True):
        effect = float(np.std(with_term - without))
        assert effect > 0.0
        assert float(np.std(with_term - with_entry)) <= 1e-6 * effect


def test_what_the_load_encoder_errs_over_the_angle_is_taken_off_what_it_tells() -> None:
    """A log whose load encoder errs by a curve, with that curve in the model, leaves what a true log leaves."""
    m = PROBLEM.measurement
    assert m.slow_load_angle is not None
    assert m.slow_load_speed is not None
    assert m.load_angle is not None
    assert m.load_speed is not None
    (shapes, slopes), size = beyond_twice(m.slow_load_angle), 1e-4
    error, slope = size * shapes[4], size * slopes[4] * m.slow_load_speed
    read = replace(
        m,
        load_angle=m.load_angle + error,
        load_speed=m.load_speed + slope,
        slow_load_angle=m.slow_load_angle + error,
        slow_load_speed=m.slow_load_speed + slope,
    )
    wrong = Problem(AXIS, read, PROBLEM.noise)
    assert not error_over_angle(AXIS, m)  # the description says what gear and encoder err by
    (term,) = error_over_angle(UNSAID, m)
    values = {p.name: p.start for p in PROBLEM.base()} | {p.name: 0.0 for p in term.parameters}
    known = {**values, term.parameters[4].name: size}
    assert term.report(known)["error_rad"] == pytest.approx(size, rel=1e-3)
    true, fooled, told = (
        np.concatenate(one.raw_residuals(terms, at))
        for one, terms, at in ((PROBLEM, (), values), (wrong, (), values), (wrong, (term,), known))
    )
    assert float(np.std(told - true)) < 0.02 * float(np.std(fooled - true))
