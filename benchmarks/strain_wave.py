"""Logs of a gear of which only the ratio is described, with and without an error twice per turn of the motor."""

from __future__ import annotations

import numpy as np

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.virtual_measurement import measure
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


def log(axis: Axis, seed: int, stride: int = 1, *, load_encoder: bool = True) -> Telemetry:
    """What a drive with this axis records in 8 s, every `stride`-th row of 2 kHz, with noise of sensors."""
    ideal, rng = measure(axis, 8.0, seed).telemetry, np.random.default_rng(seed)
    noise = {"motor_torque_nm": 2e-3, "motor_position_rad": 5e-5, "load_position_rad": 1e-6}
    channels = {
        name: (ideal[name] + level * rng.standard_normal(ideal.rows))[::stride]
        for name, level in noise.items()
        if load_encoder or name != "load_position_rad"
    }
    return Telemetry(ideal.time_s[::stride], channels)


def erring(amplitude_rad: float) -> Axis:
    """The axis with an error of its gear twice per turn of the motor."""
    return with_mechanism(AXIS, KinematicError("output", {"amplitude_rad": amplitude_rad, "phase_rad": PHASE}))
