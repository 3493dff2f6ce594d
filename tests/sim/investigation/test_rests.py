"""What an axis does in one of many seconds of a log, at rest before and after."""

import numpy as np
import pytest

from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.investigation.data.preprocessing import Measurement, prepare
from sim.investigation.data.validation import examine
from sim.investigation.investigate import investigate

RATE_HZ = 250.0
INERTIA, DRY, VISCOUS, WEIGHT, PHASE = 3.0, 20.0, 40.0, 35.0, -1.7
MOVING_S, SECONDS = (24.0, 31.0), 40.0


def stroke(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed and acceleration of a there and back of 1.7 rad, at rest before and after."""
    u = np.clip((t - MOVING_S[0]) / (MOVING_S[1] - MOVING_S[0]), 0.0, 1.0)
    turn = 4.0 * np.pi * u  # twice there and back
    rate = 4.0 * np.pi / (MOVING_S[1] - MOVING_S[0])
    inside = (u > 0.0) & (u < 1.0)
    return (
        0.85 * (1.0 - np.cos(turn)),
        0.85 * rate * np.sin(turn) * inside,
        0.85 * rate**2 * np.cos(turn) * inside,
    )


def log(weight: float = WEIGHT) -> Telemetry:
    """Rests in which friction holds what it likes, then dry and viscous friction and a weight in 7 of 40 s."""
    rng = np.random.default_rng(5)
    t = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    angle, speed, acceleration = stroke(t)
    moving = (t > MOVING_S[0]) & (t < MOVING_S[1])
    held = np.where(t < MOVING_S[0], -17.0, 11.0)
    torque = INERTIA * acceleration + VISCOUS * speed + weight * np.sin(angle + PHASE)
    torque += np.where(moving, DRY * np.tanh(speed / 0.01), held)
    torque += 0.8 * rng.standard_normal(t.size)
    return Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": angle + 1e-5 * rng.standard_normal(t.size)})


def axis(inertia: float | None = INERTIA) -> Axis:
    motor = {} if inertia is None else {"inertia_kg_m2": inertia}
    return read_axis({"name": "joint", "motor": motor, "load": {"inertia_kg_m2": 0.0}})


def test_friction_and_weight_of_an_axis_that_moves_in_a_sixth_of_its_log() -> None:
    result = investigate(axis(), log())
    found = {f.mechanism: {e.name: e.value for e in f.parameters} for f in result.findings if f.probability >= 0.9}
    assert set(found) == {"coulomb_friction", "viscous_friction", "gravity_imbalance"}
    assert found["coulomb_friction"]["torque_n_m"] == pytest.approx(DRY, rel=0.1)
    assert found["viscous_friction"]["coefficient_n_m_s_per_rad"] == pytest.approx(VISCOUS, rel=0.1)
    assert found["gravity_imbalance"]["torque_n_m"] == pytest.approx(WEIGHT, rel=0.15)


def test_an_inertia_that_nobody_knows_is_looked_for_near_that_beside_a_weight() -> None:
    """Over one stroke a weight goes with the acceleration, and without it the inertia would seem to be negative."""
    data_check = examine(axis(None), log())
    assert data_check.axis.motor.inertia_kg_m2 == pytest.approx(INERTIA, rel=0.2)


def still_and_moving() -> Measurement:
    t = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    angle, _, _ = stroke(t)
    return prepare(RATE_HZ, np.zeros(t.size), angle, None)


def test_rests_do_not_count_until_friction_slides() -> None:
    m = still_and_moving()
    clock = m.time_s
    assert not m.counts[(clock < MOVING_S[0]) | (clock > MOVING_S[1] + 0.1)].any()
    assert not m.counts[np.abs(m.slow_angle) < 0.009][: m.samples // 2].any()
    back = np.flatnonzero(np.diff(np.sign(m.slow_speed)) != 0)
    back = back[(clock[back] > MOVING_S[0] + 1.0) & (clock[back] < MOVING_S[1] - 1.0)]
    assert not m.resting[back].any()  # turning back is no rest
