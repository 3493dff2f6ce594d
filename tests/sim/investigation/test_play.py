"""Fits of a gear whose teeth leave each other: what noise makes of them, how far a linear picture reaches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.harness.telemetry_of import swing
from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.data.validation import examine
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.investigation.investigate import investigate

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
    counts = loose.with_predictable_rows((), described).measurement.predictable > 0.5
    nudged = {**described, "load.inertia_kg_m2": (1.0 + 1e-4) * LOAD}
    apart = np.abs(np.subtract(*(loose.raw_residuals((), values)[0] for values in (described, nudged))))
    assert 0.2 < counts.mean() < 0.8
    assert np.mean(apart[counts] ** 2) < 0.3 * np.mean(apart[~counts] ** 2)
    assert pressed.with_predictable_rows((), {p.name: p.start for p in pressed.base()}).measurement.predictable.all()


def test_friction_is_named_without_which_teeth_would_rattle() -> None:
    axis, measured = to_and_fro(described_n_m=0.0, friction_n_m=0.5)
    without = replace(axis, motor=replace(axis.motor, coulomb_friction_n_m=0.0))
    found = investigate(without, measured)
    assert [f.mechanism for f in found.findings] == ["coulomb_friction"]
    assert found.findings[0].probability > 0.5
