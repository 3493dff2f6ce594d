"""Measured channels made from closed forms, for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from signals.telemetry import Telemetry

RATE_HZ = 1000.0


def swing(duration_s: float = 12.0, top_rad_s: float = 60.0) -> tuple[NDArray[np.float64], ...]:
    """Time, angle, speed, acceleration of a smooth motion to and fro (two sines of incommensurate periods)."""
    t = np.arange(int(duration_s * RATE_HZ)) / RATE_HZ
    a, b = 2 * np.pi / 2.9, 2 * np.pi / 1.1
    angle = top_rad_s * (np.sin(a * t) / a * 0.8 + np.sin(b * t) / b * 0.2)
    speed = top_rad_s * (np.cos(a * t) * 0.8 + np.cos(b * t) * 0.2)
    acceleration = -top_rad_s * (a * np.sin(a * t) * 0.8 + b * np.sin(b * t) * 0.2)
    return t, angle, speed, acceleration


def one_body(
    inertia: float,
    coulomb: float,
    viscous: float,
    seed: int,
    noise_n_m: float = 0.05,
    extra: NDArray[np.float64] | float = 0.0,
) -> Telemetry:
    """Torque of one inertia with friction along `swing`, with white noise and a quantised encoder."""
    t, angle, speed, acceleration = swing()
    rng = np.random.default_rng(seed)
    torque = inertia * acceleration + coulomb * np.tanh(speed / 0.01) + viscous * speed + extra
    torque = torque + noise_n_m * rng.standard_normal(t.size)
    step = 2 * np.pi / 2**20
    return Telemetry(t, {"motor_torque_nm": torque, "motor_position_rad": np.round(angle / step) * step})


def geared(inertia: float, ratio: float, load_inertia: float, stiffness: float, seed: int) -> Telemetry:
    """A motor with friction of 1 N m, a gear and a load on its spring, which twists by the torque of its inertia."""
    t, angle, _, acceleration = swing()
    plain = one_body(inertia + load_inertia / ratio**2, 1.0, 0.02, seed)
    rng = np.random.default_rng(seed + 1)
    twist = load_inertia * acceleration / ratio / stiffness
    load = angle / ratio - twist + 2e-6 * rng.standard_normal(t.size)
    return Telemetry(t, {**plain.channels, "load_position_rad": load, "reference_position_rad": angle})
