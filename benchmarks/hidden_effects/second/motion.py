"""Motions of the motor: moves to and fro, with the same or with varied speeds, or a sum of sines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

TELEMETRY_RATE_HZ = 2_000
STEPS_PER_SAMPLE = 20
STEP_S = 1 / (TELEMETRY_RATE_HZ * STEPS_PER_SAMPLE)
RUN_IN_S = 4.0
RECORD_S = 30.0
MOTIONS = ("multisine", "varied", "trapezoid", "mixture")
SLOW_TOO = ("varied", "mixture")
"""Motions with passes at low speed, too; a torque ripple or a mesh error needs them."""


@dataclass(frozen=True)
class Motion:
    """Position [rad], speed [rad/s], acceleration [rad/s2] of the motor at every step; the run-in is not recorded."""

    position: NDArray[np.float64]
    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]


def draw_motion(rng: np.random.Generator, ratio: float, kind: str) -> Motion:
    """Draw a motion of one of MOTIONS; the load turns by about a turn."""
    recorded = round((RUN_IN_S + RECORD_S) / STEP_S)
    # a second more than is needed, so that smoothing does not see the end
    steps = recorded + int(1.0 / STEP_S)
    turn = 2 * np.pi * ratio
    top_speed, ramp = rng.uniform(180, 285), rng.uniform(700, 1300)
    if kind == "multisine":
        speed = _sines(rng, steps, turn, top_speed)
    else:
        speed = _to_and_fro(rng, kind, steps, turn, top_speed, ramp)
        window = np.hanning(int(rng.uniform(0.22, 0.4) / STEP_S))
        speed = signal.fftconvolve(speed, window / window.sum(), "same")
    speed[np.abs(speed) < 1e-9] = 0.0
    speed = speed[:recorded]
    return Motion(np.cumsum(speed) * STEP_S, speed, np.gradient(speed, STEP_S))


def _sines(rng: np.random.Generator, steps: int, turn: float, top_speed: float) -> NDArray[np.float64]:
    """Return the speed of a large slow sine and three smaller, faster ones, of `top_speed` at most."""
    time = np.arange(steps) * STEP_S
    amplitude = turn / 2 * rng.uniform(1.02, 1.25)
    frequency = min(top_speed / (2 * np.pi * amplitude), 0.3)
    position = amplitude * np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6.28))
    for number in range(3):
        faster = frequency * rng.uniform(2.2, 6)
        size = 0.25 * top_speed / (2 * np.pi * faster) / (1 + 0.5 * number)
        position += size * np.sin(2 * np.pi * faster * time + rng.uniform(0, 6.28))
    speed = np.gradient(position, STEP_S)
    over = np.abs(speed).max() / top_speed
    if over > 1:  # the same path, slower
        speed = np.interp(np.arange(steps) / over, np.arange(steps), speed) / over
    return speed * np.clip(time / 2.0, 0, 1)


def _to_and_fro(
    rng: np.random.Generator, kind: str, steps: int, turn: float, top_speed: float, ramp: float
) -> NDArray[np.float64]:
    """Return the speed of moves with dwells between, not yet smoothed."""
    speed = np.zeros(steps)
    start, position, direction, count = int(0.5 / STEP_S), 0.0, 1.0, 0
    while start < steps:
        cruise, distance, dwell = _next_move(rng, kind, turn, top_speed, count)
        move = _move(cruise, distance, dwell, ramp)
        part = speed[start : start + len(move)]
        part[:] = direction * move[: len(part)]
        start += len(move)
        position += direction * distance
        direction = -1.0 if position > 0.3 * turn else 1.0
        if kind == "mixture" and 0.0 < position < 0.6 * turn and rng.random() < 0.2:
            direction = 1.0
        count += 1
    return speed


def _next_move(
    rng: np.random.Generator, kind: str, turn: float, top_speed: float, count: int
) -> tuple[float, float, float]:
    """Return speed [rad/s], distance [rad] and the dwell after it [s] of the move number `count`."""
    if kind == "trapezoid":
        return top_speed, turn * 1.03 if count else turn * 0.6, 0.25
    speeds = [1.0, 0.75, 0.45, 0.25, 0.12] if kind in SLOW_TOO else [1.0, 0.8, 0.6, 0.4]
    cruise = top_speed * rng.choice(speeds)
    distance = min(turn * rng.uniform(0.5, 1.15) if count % 3 else turn * 1.03, cruise * 4.5)
    dwell = rng.choice([0.0, 0.15, 0.4])
    if kind == "mixture" and count % 2 == 0:
        return top_speed, turn * 1.03, dwell
    return cruise, distance, dwell


def _move(cruise: float, distance: float, dwell: float, ramp: float) -> NDArray[np.float64]:
    """Return the speed of one move: up to `cruise` [rad/s] at `ramp` [rad/s2], down again, and a dwell [s]."""
    ramp_s = cruise / ramp
    cruise_s = max(0.0, distance / cruise - ramp_s)
    moments = np.arange(int(ramp_s / STEP_S)) * STEP_S
    return np.concatenate(
        [
            ramp * moments,
            np.full(int(cruise_s / STEP_S), cruise),
            np.maximum(cruise - ramp * moments, 0),
            np.zeros(int(dwell / STEP_S)),
        ]
    )
