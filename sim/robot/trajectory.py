"""Motions of a robot that are to be made: sums of harmonics from rest to rest, within limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.discrepancy.unexplained import rounded
from sim.robot.motion import Motion
from sim.robot.robot import Robot

Array = NDArray[np.float64]

RATE_HZ = 100.0  # of the file: a controller interpolates between its rows
ORDERS = np.arange(1, 6)
LONGEST_S, SHORTEST_S = 20.0, 5.0  # period of the first harmonic
WAVES = 32  # that are drawn for each joint of a motion
FADE = 0.25  # of that period, over which a motion swells from rest and fades to it


@dataclass(frozen=True)
class Trajectory:
    """A motion of the logged joints: times [s], shape (n,); positions [rad], speeds [rad/s], accelerations [rad/s2] of
    each, shape (n, joints); [m] and so on where a joint slides."""

    joints: tuple[str, ...]
    time_s: Array
    position: Array
    speed: Array
    acceleration: Array

    def csv(self) -> str:
        """The file that a controller can play: `time_s`, then position and velocity of each joint."""
        names = [f"{joint}/{what}" for what in ("position", "velocity") for joint in self.joints]
        rows = np.column_stack([self.time_s, self.position, self.speed]).tolist()
        lines = [",".join(["time_s", *names]), *(",".join(f"{value:.6f}" for value in row) for row in rows)]
        return "\n".join([*lines, ""])


@dataclass(frozen=True)
class Harmonics:
    """A motion as sums of harmonics of `period_s`, that swell from rest and fade to it within `seconds`.

    `middle` [rad]: where each joint begins and ends, shape (joints,); `sine`, `cosine` [rad]: of each order, shape
    (joints, 5).
    """

    joints: tuple[str, ...]
    seconds: float
    period_s: float
    middle: Array
    sine: Array
    cosine: Array

    def trajectory(self) -> Trajectory:
        """Row by row."""
        time_s = np.arange(round(self.seconds * RATE_HZ) + 1) / RATE_HZ
        turns = 2.0 * math.pi / self.period_s * ORDERS
        sine, cosine = np.sin(np.outer(time_s, turns)), np.cos(np.outer(time_s, turns))
        wave = sine @ self.sine.T + cosine @ self.cosine.T
        rate = cosine @ (turns * self.sine).T - sine @ (turns * self.cosine).T
        bend = -sine @ (turns**2 * self.sine).T - cosine @ (turns**2 * self.cosine).T
        swell, growth, change = (each[:, None] for each in _swell(time_s, FADE * self.period_s))
        return Trajectory(
            self.joints, time_s, self.middle + swell * wave, swell * rate + growth * wave,
            swell * bend + 2.0 * growth * rate + change * wave,
        )  # fmt: skip

    def document(self) -> dict[str, object]:
        """JSON."""
        columns = zip(self.joints, self.middle, self.sine, self.cosine, strict=True)
        return {
            "seconds": self.seconds,
            "period_s": rounded(self.period_s),
            "joints": [
                {
                    "name": name,
                    "middle_rad": rounded(float(middle)),
                    "sine_rad": [rounded(float(x)) for x in sine],
                    "cosine_rad": [rounded(float(x)) for x in cosine],
                }
                for name, middle, sine, cosine in columns
            ],
        }

    @staticmethod
    def of_document(document: Mapping[str, Any]) -> Harmonics:
        """The motion that `document` said."""
        joints = document["joints"]
        middle, sine, cosine = (
            np.array([joint[key] for joint in joints], dtype=np.float64)
            for key in ("middle_rad", "sine_rad", "cosine_rad")
        )
        names = tuple(str(joint["name"]) for joint in joints)
        return Harmonics(names, float(document["seconds"]), float(document["period_s"]), middle, sine, cosine)


@dataclass(frozen=True)
class Limits:
    """What a motion keeps: each joint between `low` and `high` [rad], no faster than `speed` [rad/s], with no more than
    `acceleration` [rad/s2], all of shape (joints,)."""

    joints: tuple[str, ...]
    low: Array
    high: Array
    speed: Array
    acceleration: Array

    @staticmethod
    def of(robot: Robot, present: Motion) -> Limits:
        """Where the joints have been, since nothing is known of what stands around the robot but that it was not in
        the way; as fast as the URDF lets them be; with accelerations that they have had, for which drives suffice."""
        counts = present.counts
        low, high = present.position[counts].min(axis=0), present.position[counts].max(axis=0)
        speed, acceleration = (np.abs(each[counts]).max(axis=0) for each in (present.speed, present.acceleration))
        for k, joint in enumerate(robot.joints):
            first, last, fastest = robot.urdf.limits.get(joint.name, (0.0, 0.0, 0.0))
            if first < last:
                low[k], high[k] = np.clip([low[k], high[k]], first, last)
            speed[k] = fastest or speed[k]
        return Limits(tuple(joint.name for joint in robot.joints), low, high, speed, acceleration)

    def drawn(self, rng: np.random.Generator, seconds: float) -> Harmonics:
        """A motion of so many seconds in which each joint is as large as it may be, and of `WAVES` the fastest."""
        count = len(self.joints)
        period = min(seconds, float(np.exp(rng.uniform(math.log(SHORTEST_S), math.log(LONGEST_S)))))
        sizes = rng.standard_normal((2, WAVES * count, ORDERS.size))
        sizes /= ORDERS ** rng.uniform(0.0, 2.0, (WAVES * count, 1))  # from equal positions to equal accelerations
        middle = np.zeros(WAVES * count)
        way = Harmonics(WAVES * self.joints, seconds, period, middle, *sizes).trajectory()
        low, high = way.position.min(axis=0), way.position.max(axis=0)
        fast, hard = (np.abs(each).max(axis=0) for each in (way.speed, way.acceleration))
        room, speed, acceleration = (
            np.tile(each, WAVES) for each in (self.high - self.low, self.speed, self.acceleration)
        )
        size = np.minimum(np.minimum(room / (high - low), speed / fast), acceleration / hard)
        effective = size * np.sqrt(np.mean(way.speed**2, axis=0))
        best = effective.reshape(WAVES, count).argmax(axis=0) * count + np.arange(count)
        size, low, high = size[best], low[best], high[best]
        middle = 0.5 * (self.low + self.high - size * (low + high))
        return Harmonics(self.joints, seconds, period, middle, *(size[:, None] * each[best] for each in sizes))


def repeated(robot: Robot, present: Motion, seconds: float) -> Trajectory:
    """The present motion, there and back, as often as it takes."""
    time_s = np.arange(round(seconds * RATE_HZ) + 1) / RATE_HZ
    length = float(present.time_s[-1] - present.time_s[0])
    gone = (time_s / length) % 2.0
    there = present.time_s[0] + length * (1.0 - np.abs(1.0 - gone))
    way = np.where(gone > 1.0, -1.0, 1.0)[:, None]
    position, speed, acceleration = (
        present.on(each, there) for each in (present.position, present.speed, present.acceleration)
    )
    return Trajectory(tuple(joint.name for joint in robot.joints), time_s, position, way * speed, acceleration)


def _swell(time_s: Array, fade_s: float) -> tuple[Array, Array, Array]:
    """From 0 to 1 within `fade_s`, and back before the end, by a polynomial of degree 5; with two derivatives."""
    ahead, behind = time_s / fade_s, (time_s[-1] - time_s) / fade_s
    u, way = np.minimum(np.minimum(ahead, behind), 1.0), np.where(ahead <= behind, 1.0, -1.0) / fade_s
    return (
        u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
        30.0 * u**2 * (1.0 - u) ** 2 * way,
        60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / fade_s**2,
    )
