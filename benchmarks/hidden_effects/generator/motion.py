"""Back-and-forth motions of a robot joint: s-curves between turning points, with dwell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden_effects.generator.kernel import SERVO_RATE_HZ

SETTLE_S = 1.5


@dataclass(frozen=True)
class Motion:
    """Position [rad], speed [rad/s], acceleration [rad/s2] of the load (3, n) at the servo's rate.

    The first `SETTLE_S` seconds are a run-up that is not recorded.
    """

    course: NDArray[np.float64]
    low: float
    high: float

    def passes(self, angle: float, direction: float) -> int:
        """Count how often the recorded part crosses `angle` (modulo 2 pi) cruising in `direction` (1 or -1).

        While braking the other flank carries the load.
        """
        position, speed, acceleration = self.course[:, int(SETTLE_S * SERVO_RATE_HZ) :]
        turn = np.floor((position - angle) / (2 * np.pi))
        cruising = np.abs(acceleration[1:]) < 0.01 * np.max(np.abs(acceleration))
        return int(np.count_nonzero((np.diff(turn) != 0) & cruising & (np.sign(speed[1:]) == direction)))


def _move(distance: float, speed: float, ramp_s: float) -> NDArray[np.float64]:
    """Return the speed of one move: raised-cosine acceleration up to `speed`, cruise, and the same down."""
    reach = abs(distance)
    speed = min(speed, reach / ramp_s)
    cruise_s = reach / speed - ramp_s
    time = np.arange(0.0, cruise_s + 2 * ramp_s, 1 / SERVO_RATE_HZ)

    def rise(moment: NDArray[np.float64]) -> NDArray[np.float64]:
        part = np.clip(moment / ramp_s, 0.0, 1.0)
        return part - np.sin(2 * np.pi * part) / (2 * np.pi)

    return np.sign(distance) * speed * (rise(time) - rise(time - cruise_s - ramp_s))


def draw_motion(rng: np.random.Generator, top_speed: float, duration_s: float) -> Motion:
    """Draw a motion: the same two turning points over and over, or new ones each time at varied speed."""
    regular = rng.random() < 0.5
    low = float(rng.uniform(-3.0, 1.0))
    span = float(rng.uniform(4.0, 2 * np.pi))
    ramp_s, dwell_s = float(rng.uniform(0.3, 0.55)), float(rng.uniform(0.05, 0.45))
    speed = top_speed * float(rng.uniform(0.85, 1.0))
    samples = round((SETTLE_S + duration_s) * SERVO_RATE_HZ) + 2 * SERVO_RATE_HZ
    pieces: list[NDArray[np.float64]] = [np.zeros(SERVO_RATE_HZ // 5)]
    position, target, length = low, low + span, len(pieces[0])
    while length < samples:
        pieces += [_move(target - position, speed, ramp_s), np.zeros(round(dwell_s * SERVO_RATE_HZ))]
        length += len(pieces[-1]) + len(pieces[-2])
        position = target
        if regular:
            target = low if target > low else low + span
            continue
        target = low + span * _next_part(rng, (position - low) / span)
        speed = top_speed * float(rng.choice([1.0, 1.0, 0.6, 0.25]) * rng.uniform(0.85, 1.0))
        ramp_s, dwell_s = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.05, 0.6))
    velocity = np.concatenate(pieces)
    start = int(rng.integers(0, SERVO_RATE_HZ)) if regular else 0
    place = low + np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))]) / SERVO_RATE_HZ
    course = np.vstack([place, velocity, np.gradient(velocity) * SERVO_RATE_HZ])[:, start : start + samples]
    return Motion(np.ascontiguousarray(course), low, low + span)


def _next_part(rng: np.random.Generator, part: float) -> float:
    """Draw the next turning point, as a part of the span, at least a third of the span away."""
    while True:
        drawn = float(np.round(rng.beta(0.6, 0.6), 3))
        if abs(drawn - part) > 1 / 3:
            return drawn
