"""A coarse encoder on a stiff direct drive: its noise, times the inertia, is louder than the torque."""

import numpy as np
import pytest

from casebase.signals.telemetry import Telemetry
from sim.axis import read_axis
from sim.discrepancy.investigation import investigate
from tests.discrepancy.telemetry_of import RATE_HZ, swing


def test_a_coarse_encoder_is_no_finding_and_leaves_the_whole_inertia_alone() -> None:
    motor, load, stiffness, damping = 0.35, 0.34, 5000.0, 2.0
    t, angle, speed, acceleration = swing(top_rad_s=3.0)
    rng = np.random.default_rng(1)
    frequency = 2j * np.pi * np.fft.rfftfreq(t.size, 1.0 / RATE_HZ)
    spring = stiffness + damping * frequency
    lag = spring / (spring + load * frequency**2)  # load angle per motor angle, both without friction
    followed = np.fft.irfft(np.fft.rfft(acceleration) * lag, t.size)
    torque = motor * acceleration + load * followed + 0.8 * np.tanh(speed / 0.002) + 0.13 * speed
    torque = torque + 0.06 * rng.standard_normal(t.size)
    step = 2 * np.pi / 2**17
    axis = read_axis(
        {
            "name": "direct",
            "motor": {
                "inertia_kg_m2": motor,
                "coulomb_friction_n_m": 0.8,
                "viscous_friction_n_m_s_per_rad": 0.13,
            },
            "transmission": {"stiffness_n_m_per_rad": stiffness, "damping_n_m_s_per_rad": damping},
            "load": {"inertia_kg_m2": load},
        }
    )
    measured = Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": np.round(angle / step) * step})
    result = investigate(axis, measured)
    assert (result.verdict, result.findings) == ("nothing_missing", ())
    found = {e.name: e.value for e in result.parameters}
    whole = found["motor.inertia_kg_m2"] + found["load.inertia_kg_m2"]
    assert whole == pytest.approx(motor + load, rel=0.03)
