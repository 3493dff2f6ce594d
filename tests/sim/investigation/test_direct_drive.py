"""A coarse encoder on a stiff direct drive: its noise, times the inertia, is louder than the torque."""

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import RATE_HZ, swing
from signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.investigation.investigate import investigate

MOTOR, LOAD, STIFFNESS, DAMPING = 0.35, 0.34, 5000.0, 2.0
AXIS = read_axis(
    {
        "name": "direct",
        "motor": {"inertia_kg_m2": MOTOR, "coulomb_friction_n_m": 0.8, "viscous_friction_n_m_s_per_rad": 0.13},
        "transmission": {"stiffness_n_m_per_rad": STIFFNESS, "damping_n_m_s_per_rad": DAMPING},
        "load": {"inertia_kg_m2": LOAD},
    }
)


def measured(ripple_n_m: float = 0.0, top_rad_s: float = 3.0) -> Telemetry:
    """What the axis would tell, with a ripple twice per turn; the load lags as a spring and damper let it."""
    t, angle, speed, acceleration = swing(top_rad_s=top_rad_s)
    frequency = 2j * np.pi * np.fft.rfftfreq(t.size, 1.0 / RATE_HZ)
    spring = STIFFNESS + DAMPING * frequency
    lag = spring / (spring + LOAD * frequency**2)  # load angle per motor angle, both without friction
    followed = np.fft.irfft(np.fft.rfft(acceleration) * lag, t.size)
    torque = MOTOR * acceleration + LOAD * followed + 0.8 * np.tanh(speed / 0.002) + 0.13 * speed
    torque += ripple_n_m * np.sin(2.0 * angle + 0.4)
    torque += 0.06 * np.random.default_rng(1).standard_normal(t.size)
    step = 2 * np.pi / 2**17
    return Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": np.round(angle / step) * step})


def test_a_coarse_encoder_is_no_finding_and_leaves_the_whole_inertia_alone() -> None:
    result = investigate(AXIS, measured())
    assert (result.verdict, result.findings) == ("nothing_missing", ())
    found = {e.name: e.value for e in result.parameters}
    whole = found["motor.inertia_kg_m2"] + found["load.inertia_kg_m2"]
    assert whole == pytest.approx(MOTOR + LOAD, rel=0.03)


def test_ripple_twice_per_turn_is_named_where_the_axis_hardly_turns_once() -> None:
    """Errors as new have no name, and a torque of their shape that is larger has one."""
    telemetry = measured(ripple_n_m=0.2, top_rad_s=6.0)
    assert 2 * np.pi < 2 * np.ptp(telemetry.channels["motor_position_rad"]) < 4 * np.pi
    (finding,) = investigate(AXIS, telemetry).findings
    assert finding.mechanism == "torque_ripple"
    (order,) = (p for p in finding.parameters if p.name == "order")
    turns = np.ptp(telemetry.channels["motor_position_rad"]) / (2 * np.pi)
    assert order.high - 2.0 == 2.0 - order.low == pytest.approx(1.0 / turns, rel=0.01)  # no way tells them closer
    assert {p.name: p.value for p in finding.parameters}["torque_n_m"] == pytest.approx(0.2, rel=0.1)
