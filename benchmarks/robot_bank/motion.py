"""Motions of six joints as programs make them; what a joint does is smooth, and known at any instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import interpolate, signal

from benchmarks.robot_bank.arm import Arm
from benchmarks.robot_bank.multibody import Array

RATE_HZ = 1000
"""Of the grid on which motions are made."""
LEAD_S = 1.0
"""A motion runs before the log begins and after it ends, so that no log sees its edges."""
KINDS = ("fourier", "trapezoids", "quintics", "one by one", "mixture")


@dataclass(frozen=True, eq=False)
class Motion:
    """Times (n,) [s], 0 where the log begins, and angles, speeds and accelerations (n, 6) there [rad, s]."""

    kind: str
    time: Array
    angles: Array
    speeds: Array
    accelerations: Array


def smooth(time: Array, angles: Array) -> tuple[Array, Array]:
    """Return speeds and accelerations (n, k) of angles (n, k): of the quintic spline through them."""
    course = interpolate.make_interp_spline(time, angles, k=5)
    return course(time, 1), course(time, 2)


def draw_motion(rng: np.random.Generator, arm: Arm, seconds: float, kind: str | None = None) -> Motion:
    """Draw a motion within the arm's limits of angle and speed."""
    kind = str(rng.choice(KINDS, p=[0.25, 0.2, 0.2, 0.15, 0.2])) if kind is None else kind
    time = np.arange(-LEAD_S, seconds + LEAD_S, 1 / RATE_HZ)
    hurry = rng.uniform(0.3, 0.75)
    if kind == "fourier":
        angles = _fourier(rng, arm, time, hurry)
    elif kind in ("trapezoids", "quintics"):
        angles = _between_poses(rng, arm, time, hurry, kind)
    elif kind == "one by one":
        angles = _one_by_one(rng, arm, time, hurry)
    else:
        half = len(time) // 2
        first = _fourier(rng, arm, time[:half], hurry)
        second = _between_poses(rng, arm, time[half:], hurry, str(rng.choice(["trapezoids", "quintics"])))
        angles = np.concatenate([first, second - second[0] + first[-1]])
    # no drive follows a jump of the acceleration or of the speed
    window = np.hanning(round(rng.uniform(0.1, 0.25) * RATE_HZ) | 1)[:, None]
    ends = np.repeat(angles[[0, -1]], len(window), axis=0)
    padded = np.concatenate([ends[: len(window)], angles, ends[len(window) :]])
    angles = signal.oaconvolve(padded, window / window.sum(), "same", axes=0)[len(window) : -len(window)]
    # a program keeps inside the limits; where the parts of a mixture did not meet there, it is shrunk about its start
    over = float(np.max(np.abs(angles - angles[0]).max(axis=0) / (0.98 * arm.limit - np.abs(angles[0]))))
    angles = angles[0] + (angles - angles[0]) / max(1.0, over)
    return Motion(kind, time, angles, *smooth(time, angles))


def _fourier(rng: np.random.Generator, arm: Arm, time: Array, hurry: float) -> Array:
    """Return sums of five harmonics, from rest to rest as the amplitude swells and fades (J. Swevers et al., 1997)."""
    base = rng.uniform(0.05, 0.12)
    order = np.arange(1, 6)
    angles = np.empty((len(time), 6))
    for j in range(6):
        waves = rng.standard_normal((2, 5)) / order**0.5
        phase = 2 * np.pi * base * np.outer(time, order)
        wave = np.sin(phase) @ waves[0] + np.cos(phase) @ waves[1]
        wave *= arm.range[j] / np.max(np.abs(wave))
        fastest = np.max(np.abs(np.gradient(wave, 1 / RATE_HZ)))
        angles[:, j] = arm.home[j] + wave * min(1.0, hurry * arm.speed[j] / fastest)
    swell = np.clip((time - time[0]) / 1.5, 0, 1)[:, None]
    return arm.home + (angles - arm.home) * (3 * swell**2 - 2 * swell**3)


def _pose(rng: np.random.Generator, arm: Arm) -> Array:
    return arm.home + arm.range * rng.uniform(-1, 1, 6)


def _profile(kind: str, u: Array, ramp: float) -> Array:
    """Return the share of a way that is gone at the share u of its time: quintic, or constant speed between ramps."""
    if kind == "quintics":
        return u**3 * (10 - 15 * u + 6 * u**2)
    top = 1 / (1 - ramp)
    up, down = top * u**2 / (2 * ramp), 1 - top * (1 - u) ** 2 / (2 * ramp)
    return np.where(u < ramp, up, np.where(u > 1 - ramp, down, top * (u - ramp / 2)))


def _between_poses(rng: np.random.Generator, arm: Arm, time: Array, hurry: float, kind: str) -> Array:
    """Return moves through random poses, all joints at rest together, most with a short stop."""
    angles, at = np.empty((len(time), 6)), 0
    start = _pose(rng, arm)
    while at < len(time):
        end = _pose(rng, arm)
        ramp = rng.uniform(0.15, 0.4)
        steepest = 1.875 if kind == "quintics" else 1 / (1 - ramp)
        seconds = max(0.6, float(np.max(steepest * np.abs(end - start) / (hurry * rng.uniform(0.5, 1) * arm.speed))))
        steps = round(seconds * RATE_HZ)
        gone = _profile(kind, np.arange(1, steps + 1) / steps, ramp)[:, None]
        stop = int(rng.choice([0.0, 0.1, 0.4]) * RATE_HZ)
        move = np.concatenate([start + (end - start) * gone, np.repeat(end[None], stop, axis=0)])[: len(time) - at]
        angles[at : at + len(move)] = move
        at, start = at + len(move), end
    return angles


def _one_by_one(rng: np.random.Generator, arm: Arm, time: Array, hurry: float) -> Array:
    """Return each joint to and fro in its turn, each way faster than the one before, the others at rest."""
    angles = np.repeat(_pose(rng, arm)[None], len(time), axis=0)
    slot = len(time) // 6
    for place, j in enumerate(rng.permutation(6)):
        first = angles[0, j]
        far = arm.home[j] + arm.range[j] * (1 if first < arm.home[j] else -1)
        shares = np.array([0.4, 0.25, 0.2, 0.15])
        course, at = [], first
        for share, end in zip(shares, (far, first, 0.5 * (far + first), first), strict=True):
            steps = int(share * slot)
            reach = end - at
            quickest = 1.5 * abs(reach) / (hurry * arm.speed[j]) * RATE_HZ
            if quickest > steps:
                reach *= steps / quickest
            u = np.arange(1, steps + 1) / steps
            course.append(at + reach * _profile("trapezoids", u, 1 / 3))
            at += reach
        moved = np.concatenate(course)
        angles[place * slot : place * slot + len(moved), j] = moved
        angles[place * slot + len(moved) :, j] = moved[-1]
    return angles
