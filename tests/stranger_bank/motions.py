"""Commanded motions: one period of position, speed and acceleration, and its repetition.

The work half computes moves from pieces of constant jerk; the final half lets steps of speed run
through moving averages (as digital controllers do) and uses quintic moves for `s_curve`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .axes import Design
from .kinds import Floats, Half

RATE = 16000
DT = 1.0 / RATE


@dataclass(frozen=True, eq=False)
class Motion:
    """One period at `RATE`: position [rad], speed [rad/s], acceleration [rad/s2]."""

    name: str
    position: Floats
    speed: Floats
    accel: Floats

    @property
    def period_s(self) -> float:
        """Time after which the motion repeats [s]."""
        return self.position.size * DT

    @property
    def peak_speed(self) -> float:
        """Peak output speed [rad/s]."""
        return float(np.max(np.abs(self.speed)))


def _move_pieces(distance: float, speed: float, ramp_s: float, jerk_s: float) -> Floats:
    """Speed of one move: acceleration over `ramp_s`, with jerk time `jerk_s` at its ends."""
    side = 1.0 if distance >= 0 else -1.0
    way = abs(distance)
    ramp_s = max(ramp_s, jerk_s)
    speed = min(speed, way / (ramp_s + jerk_s + 1e-9))
    n_j = round(jerk_s * RATE)
    n_a = max(1, round(ramp_s * RATE))
    up = np.ones(n_a + n_j)
    if n_j:
        edge = (np.arange(n_j) + 0.5) / n_j
        up[:n_j] = edge
        up[-n_j:] = np.minimum(up[-n_j:], edge[::-1])
    up = np.cumsum(up) / np.sum(up)
    rest = way - speed * DT * 2.0 * np.sum(up)
    n_c = max(0, round(rest / (speed * DT)))
    v = np.concatenate([up, np.ones(n_c), up[::-1]])
    return side * v * (way / (np.sum(v) * DT))


def _move_filtered(distance: float, speed: float, ramp_s: float, jerk_s: float) -> Floats:
    """Speed of one move: a rectangle run through two moving averages."""
    n_r = max(1, round(abs(distance) / speed * RATE))
    n_a = max(1, round(ramp_s * RATE))
    n_j = max(1, round(jerk_s * RATE))
    if n_r < n_a:
        n_r = n_a
    c = np.zeros(n_r + n_a + n_j + 1)
    c[:n_r] = 1.0
    for n in (n_a, n_j):
        s = np.cumsum(c)
        s[n:] -= s[:-n].copy()
        c = s / n
    return c * (distance / (np.sum(c) * DT))


def _move_quintic(distance: float, speed: float) -> Floats:
    """Speed of a minimum jerk move whose peak speed is `speed`."""
    t_s = 1.875 * abs(distance) / speed
    n = max(8, round(t_s * RATE))
    u = (np.arange(n) + 0.5) / n
    v = 30 * u**2 * (1 - u) ** 2
    return v * (distance / (np.sum(v) * DT))


def _pause(seconds: float) -> Floats:
    return np.zeros(max(0, round(seconds * RATE)))


def motion_of(name: str, half: Half, design: Design, rng: np.random.Generator, speed: float | None) -> Motion:
    """Draw one motion of the given kind for an axis; `speed` [rad/s] overrides the drawn one."""
    work = half == "work"
    v = float(rng.uniform(*design.speed)) if speed is None else speed
    a = float(rng.uniform(*design.accel))
    ramp = min(max(v / a, 0.2), 0.6)
    jerk = 0.0 if work else rng.uniform(0.012, 0.03)
    mover = _move_pieces if work else _move_filtered
    stroke = v * rng.uniform(0.9, 1.7)
    limit = design.travel * 0.92

    def go(distance: float, speed_: float = v, ramp_: float = ramp, jerk_: float = jerk) -> Floats:
        return mover(distance, speed_, ramp_, jerk_)

    if name == "trapezoid_dwell":
        p = [go(stroke), _pause(rng.uniform(0.3, 1.0)), go(-stroke), _pause(rng.uniform(0.3, 1.0))]
    elif name == "trapezoid":
        p = [go(stroke), go(-stroke)]
    elif name == "sine":
        w = min(a * 0.8 / v, 2 * np.pi / 1.6)
        n = round(2 * np.pi / w * RATE)
        ph = 2 * np.pi * (np.arange(n) + 0.5) / n
        shape = np.sin(ph) + (0.0 if work else 0.10) * np.sin(3 * ph)
        p = [v * shape / np.max(np.abs(shape))]
    elif name == "s_curve":
        if work:
            jt = rng.uniform(0.1, 0.22)
            p = [go(stroke, v, ramp, jt), _pause(0.25), go(-stroke, v, ramp, jt), _pause(0.25)]
        else:
            way = 1.4 * stroke
            p = [_move_quintic(way, v), _pause(0.2), _move_quintic(-way, v), _pause(0.35)]
    elif name == "short":
        way = rng.uniform(0.3, 0.5)
        v_s = min(v, 0.75 * np.sqrt(a * way))
        r = v_s / a
        pa, pb = rng.uniform(0.05, 0.3, 2)
        p = [go(way, v_s, r), _pause(pa), go(-way, v_s, r), _pause(pb)]
    elif name == "turn":
        way = min(2 * np.pi * rng.uniform(1.03, 1.15), limit)
        p = [go(way), _pause(0.4), go(-way), _pause(0.4)]
    elif name == "production":
        stops = [0.0]
        for _ in range(int(rng.integers(3, 6))):
            step = stroke * rng.uniform(0.25, 0.9) * (1 if rng.random() < 0.55 else -1)
            if abs(stops[-1] + step) > 0.45 * limit:
                step = -step
            stops.append(stops[-1] + step)
        if abs(stops[-1]) > 0.1:
            stops.append(0.0)
        p = []
        for here, there in pairwise(stops):
            p += [go(there - here, v * rng.uniform(0.7, 1.0)), _pause(rng.uniform(0.1, 0.8))]
        # the closing move makes up for what rounding left
        total = sum(np.sum(q) for q in p)
        p[-2] = p[-2] - total / p[-2].size
    elif name == "fast_ramp":
        r = rng.uniform(0.1, 0.15)
        v_f = min(v, 0.8 * a)
        p = [go(stroke, v_f, r), _pause(0.4), go(-stroke, v_f, r), _pause(rng.uniform(0.3, 0.7))]
    else:
        raise ValueError(f"no motion {name!r}")
    speed_ = np.concatenate(p)
    speed_ -= np.mean(speed_)
    pos = np.cumsum(speed_) * DT
    centre = 0.5 * (pos.max() + pos.min())
    free = max(0.0, 0.5 * (design.travel - np.ptp(pos)))
    pos = pos - centre + rng.uniform(-1, 1) * 0.8 * free
    acc = (np.roll(speed_, -1) - np.roll(speed_, 1)) / (2 * DT)
    return Motion(name, pos, speed_, acc)
