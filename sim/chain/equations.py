"""The equations of shafts in series as they stand in `sim.chain.model`, without modes, steps and events.

They are written apart from the kernel, over the same laws, and hold its results against themselves: at an instant, and
from a sample to the next, where they are integrated in steps of their own. Importing this module imports numba.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from sim import laws
from sim.chain.kernel import DENTS, DRIVE, LINES, LINKS, RIPPLES, SHAFTS, WIDTH
from sim.laws import (
    BF1,
    BF2,
    COULOMB_B,
    COULOMB_F,
    CUBIC,
    DRIFT,
    ETA1,
    ETA2,
    FRICTIONAL,
    GRAVITY,
    HALF,
    HYST,
    HYST_X,
    INV,
    LAW,
    LOSSY,
    OFFSET,
    PHASE,
    ROW,
    STRIBECK,
    STRIBECK_EXP,
    STRIBECK_W,
    TURN,
    VISCOUS_B,
    VISCOUS_F,
    C,
    D,
    J,
)

FINER = 2
"""Steps per step of the kernel: their error is a sixteenth of its own."""
FORCE, BALANCE, LIMIT, FLOW, ENERGY = range(5)
"""Rows of residuals: law of a link, balance of a shaft, limit of a stuck one, motion of a shaft, energy of all."""

OPTIONS = {"error_model": "numpy", "nogil": True}
_law_of_friction: Callable[..., float] = njit(**OPTIONS)(laws.friction)
_spring: Callable[..., float] = njit(**OPTIONS)(laws.spring)
_contact: Callable[..., float] = njit(**OPTIONS)(laws.contact)
_dents: Callable[..., tuple[float, float, float]] = njit(**OPTIONS)(laws.dents)
_losses: Callable[..., float] = njit(**OPTIONS)(laws.driver_torque)


def _jit(function: Any) -> Any:
    return njit(cache=True, **OPTIONS)(laws.keyed(function, LINES, DENTS, RIPPLES, LINKS, DRIVE))


@_jit
def _link(k, angle, speed, p, q, out):  # type: ignore[no-untyped-def]
    """Of link k without its hysteresis: torque on the driven shaft, levers of driver and driven shaft, and x'."""
    a = LINKS + WIDTH * k
    x, rate = angle[k] * p[a + INV] - angle[k + 1], speed[k] * p[a + INV] - speed[k + 1]
    asks, gives = p[a + INV], 1.0
    for j in range(q[LINES + k], q[LINES + k + 1], ROW):
        shaft = int(p[j])
        x -= p[j + 2] * math.sin(p[j + 1] * angle[shaft] + p[j + 3])
        slope = p[j + 2] * p[j + 1] * math.cos(p[j + 1] * angle[shaft] + p[j + 3])
        rate -= slope * speed[shaft]
        if shaft == k:
            asks -= slope
        else:
            gives += slope
    torque = 0.0
    if p[a + LAW] == 0.0:
        torque = _spring(x, p[a + C], p[a + CUBIC]) + p[a + D] * rate
    else:
        for side in (1.0, -1.0):
            depth, before, after = _dents(p, q[DENTS + k], q[DENTS + k + 1], side, k, angle, 0)
            into = side * x - p[a + HALF] - depth
            if into > 0.0:
                damper = p[a + D] * (side * rate - before * speed[k] - after * speed[k + 1])
                torque = side * _contact(p[a + LAW], _spring(into, p[a + C], p[a + CUBIC]), damper, 0)
                asks -= side * before
                gives += side * after
    out[0], out[1], out[2], out[3] = torque, asks, gives, rate


@_jit
def _asked(k, load, way, last, p):  # type: ignore[no-untyped-def]
    """Torque into the driver of link k when it turns in direction `way`; the load itself without losses."""
    a = LINKS + WIDTH * k
    if k == last or p[a + LOSSY] == 0.0:
        return load
    first = _losses(load, way, way > 0.0, p[a + ETA1], p[a + ETA2], p[a + BF1], p[a + BF2])
    if first >= way * p[a + TURN]:
        return first
    return _losses(load, way, way < 0.0, p[a + ETA1], p[a + ETA2], p[a + BF1], p[a + BF2])


@_jit
def _friction(k, speed, way, t, p):  # type: ignore[no-untyped-def]
    s = WIDTH * k
    return _law_of_friction(
        p[s + COULOMB_F], p[s + COULOMB_B], p[s + VISCOUS_F], p[s + VISCOUS_B], p[s + STRIBECK], p[s + STRIBECK_W],
        p[s + STRIBECK_EXP], p[s + DRIFT], speed, way, t,
    )  # fmt: skip


@_jit
def _torques(t, drive, angle, speed, held, way, p, q, force, net, above, size):  # type: ignore[no-untyped-def]
    """Torques at an instant.

    Per link `force`; per shaft `net`, by which it is accelerated, `above`, by which a stuck one is beyond what holds
    it, and `size`, what should cancel. `way` is 0 for a stuck shaft.
    """
    n = q[SHAFTS]
    link = np.empty(4)
    asks = 0.0
    gives = drive
    for k in range(n):
        s = WIDTH * k
        given = p[s + OFFSET] - p[s + GRAVITY] * math.sin(angle[k] + p[s + PHASE]) + gives
        size[k] = abs(p[s + OFFSET]) + abs(p[s + GRAVITY]) + abs(gives)
        for j in range(q[RIPPLES], q[RIPPLES + 1], ROW):
            if int(p[j + 4]) == k:
                over = angle[int(p[j])] if p[j] >= 0.0 else t
                given += p[j + 2] * math.sin(p[j + 1] * over + p[j + 3])
        asks = 0.0
        if k < n - 1:
            _link(k, angle, speed, p, q, link)
            force[k] = link[0] + held[k]
            asks, gives = force[k] * link[1], force[k] * link[2]
        above[k] = 0.0
        if way[k] == 0.0:
            net[k] = 0.0
            ahead = given - _asked(k, asks, 1.0, n - 1, p) - _friction(k, 0.0, 1.0, t, p)
            back = _asked(k, asks, -1.0, n - 1, p) + _friction(k, 0.0, -1.0, t, p) - given
            above[k] = max(ahead, back, 0.0)
            size[k] += abs(asks) + _friction(k, 0.0, 1.0, t, p)
        else:
            loss, friction = _asked(k, asks, way[k], n - 1, p), _friction(k, speed[k], way[k], t, p)
            net[k] = given - loss - friction
            size[k] += abs(loss) + abs(friction)


@_jit
def _moved(t, h, steps, drive, given, angle, speed, held, way, p, q):  # type: ignore[no-untyped-def]
    """Integrate over `h` [s] in place by Runge-Kutta of order 4; return the work of all torques on the shafts."""
    n = q[SHAFTS]
    state, rate, total, begin = np.empty((4, 3, n)), np.empty((3, n)), np.empty((3, n)), np.empty((3, n))
    force, net, above, size, link = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.empty(4)
    now = state[0]
    now[0], now[1], now[2] = angle, speed, held
    step = h / steps
    work = 0.0
    for i in range(steps):
        begin[:] = now
        total[:] = 0.0
        power = 0.0
        for part in range(4):
            share = 0.0 if part == 0 else (1.0 if part == 3 else 0.5)
            u = (i + share) / steps
            torque = given[0] + u * (given[1] - given[0])
            torque += drive[2] * math.sin(drive[3] * (t + u * h) + drive[4])
            _torques(t + u * h, torque, now[0], now[1], now[2], way, p, q, force, net, above, size)
            weight = 2.0 if 0 < part < 3 else 1.0
            for k in range(n):
                rate[0, k] = now[1, k]
                rate[1, k] = net[k] * p[WIDTH * k + J]
                rate[2, k] = 0.0
                a = LINKS + WIDTH * k
                if k < n - 1 and p[a + HYST] != 0.0:
                    _link(k, now[0], now[1], p, q, link)
                    loop = 1.0 if link[3] >= 0.0 else -1.0
                    rate[2, k] = link[3] * (p[a + HYST] - loop * now[2, k]) / p[a + HYST_X]
                power += weight * net[k] * now[1, k]
            total += weight * rate
            if part < 3:
                now[:] = begin + (step if part == 2 else 0.5 * step) * rate
        now[:] = begin + step / 6.0 * total
        work += step / 6.0 * power
    angle[:], speed[:], held[:] = now[0], now[1], now[2]
    return work


@_jit
def residuals(  # type: ignore[no-untyped-def]
    at, quiet, given, rate_hz, substeps, angle, speed, acceleration, force, p, q
):
    """Residuals at the samples `at`, shape (5, instants, shafts), and what should cancel, shape (5, shafts).

    `given`: torque of the drive at the beginning and the end of the sample that follows, shape (instants, 2), without
    its sine. Where not `quiet`, a mode changes within that sample, and the motion is not looked at.
    """
    n = q[SHAFTS]
    out, sizes = np.zeros((5, len(at), n)), np.zeros((5, n))
    links, net, above, size = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    held, way = np.zeros(n), np.zeros(n)
    drive = p[DRIVE : DRIVE + 5]
    h = 1.0 / rate_hz
    for i in range(len(at)):
        row = at[i]
        t = row * h
        torque = given[i, 0] + drive[2] * math.sin(drive[3] * t + drive[4])
        held[:] = 0.0
        for k in range(n):
            held_by_friction = p[WIDTH * k + FRICTIONAL] != 0.0 or (k < n - 1 and p[LINKS + WIDTH * k + LOSSY] != 0.0)
            way[k] = np.sign(speed[row, k]) if speed[row, k] != 0.0 else np.sign(acceleration[row, k])
            if way[k] == 0.0 and not held_by_friction:
                way[k] = 1.0
        _torques(t, torque, angle[row], speed[row], held, way, p, q, links, net, above, size)
        for k in range(n - 1):
            a = LINKS + WIDTH * k
            gone = force[row, k] - links[k]
            if p[a + HYST] != 0.0:
                held[k] = min(max(gone, -p[a + HYST]), p[a + HYST])
            out[FORCE, i, k] = abs(gone - held[k])
            sizes[FORCE, k] = max(sizes[FORCE, k], abs(force[row, k]))
        _torques(t, torque, angle[row], speed[row], held, way, p, q, links, net, above, size)
        before = after = 0.0
        for k in range(n):
            taken = acceleration[row, k] / p[WIDTH * k + J]
            out[BALANCE, i, k] = abs(taken - net[k])
            out[LIMIT, i, k] = above[k]
            for kind in (BALANCE, LIMIT):
                sizes[kind, k] = max(sizes[kind, k], size[k])
            sizes[FLOW, k] = max(sizes[FLOW, k], abs(speed[row, k]), abs(acceleration[row, k]) * h)
            before += 0.5 * speed[row, k] ** 2 / p[WIDTH * k + J]
            after += 0.5 * speed[row + 1, k] ** 2 / p[WIDTH * k + J]
        sizes[ENERGY, 0] = max(sizes[ENERGY, 0], before, after)
        if quiet[i]:
            then, turns = angle[row].copy(), speed[row].copy()
            work = _moved(t, h, FINER * substeps, drive, given[i], then, turns, held, way, p, q)
            out[ENERGY, i, 0] = abs(after - before - work)
            for k in range(n):
                out[FLOW, i, k] = max(abs(turns[k] - speed[row + 1, k]), abs(then[k] - angle[row + 1, k]) / h)
    return out, sizes
