"""Compiled inner loop of shafts in series over flat arrays (packed in `sim.chain.integrate`).

Classical Runge-Kutta of order 4 with fixed steps between events. What is not smooth is a mode that is held
during a step and changed only at a located instant: contact of each mesh, stick or slip of each shaft, driving
side of each lossy mesh, direction of each hysteresis loop. A margin is >= 0 while its mode is valid. One margin
crossing zero ends the step; the instant is found on the Runge-Kutta solution itself, to rounding.

Three arrays hold everything, because numba counts references of every array it takes out of a tuple, which cost more
than the physics: `p` parameters (shaft k at 16 k, link k at LINKS + 16 k, drive, rows of lines,
dents and ripples), `q` counts, offsets and modes, `w` working rows. Importing this module imports numba;
`sim.chain.reduction` does so at the first simulation. Friction, spring and dents are those of `sim.laws`,
as in the observer of an investigation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim import laws
from sim.laws import (
    APART,
    BF1,
    BF2,
    BOTH,
    COULOMB_B,
    COULOMB_F,
    CUBIC,
    DRIFT,
    ELASTO,
    ETA1,
    ETA2,
    FRICTIONAL,
    GRAVITY,
    HALF,
    HYST,
    HYST_X,
    INV,
    LAW,
    LIMITED,
    LINEAR,
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

# numba compiles for arrays; to a type checker a row of numbers is a list
Floats = list[float]
Ints = list[int]
Matrix = NDArray[np.float64]

# range() with a step divides, which costs more than the loop: hence while
# p; J holds the reciprocal
WIDTH, LINKS, DRIVE, ROWS = 16, 64, 112, 120
# q: number of shafts, kind of drive, then offsets into p where the rows of link (ripples: all) begin and end
SHAFTS, KIND, RIPPLES, LINES, DENTS, CONTACT, LOOP, WAY, SIDE = 0, 1, 2, 4, 8, 12, 16, 20, 24
Q_SIZE = 28
TORQUE, SERVO = 0, 1
PLAIN = 9  # contact of a link without gap: one law for both flanks, never left
FREE = 9  # way of a shaft on which nothing depends on the direction
GAP = 0  # or a piece of the law of contact with the sign of the flank
# w: states are angles, speeds (from 4), hysteresis torques (from 8)
# margins: 4 per link (two of contact, loop, side), then 2 per shaft
# levers: torque that a link asks of its driver and gives to its driven shaft, of the force between them
Y, K1, RATE, STAGE, TOTAL, FORCE, MARGIN, AT_START, AT_END, ASKS, GIVES = 0, 12, 24, 36, 48, 60, 64, 84, 104, 124, 128
STATES, MARGINS, SHAFT_MARGIN, W_SIZE = 11, 20, 12, 132
MAX_EVENTS_PER_STEP = 40
HALVINGS = 30

OPTIONS = {"error_model": "numpy", "fastmath": {"contract", "nsz"}, "nogil": True}


def _jit(function: Any) -> Any:
    return njit(cache=True, **OPTIONS)(laws.keyed(function))


def _inline(function: Any) -> Any:
    return njit(cache=True, forceinline=True, **OPTIONS)(laws.keyed(function))


_law_of_friction: Callable[..., float] = njit(forceinline=True, **OPTIONS)(laws.friction)
_spring: Callable[..., float] = njit(forceinline=True, **OPTIONS)(laws.spring)
_dents: Callable[..., tuple[float, float, float]] = njit(**OPTIONS)(laws.dents)
_contact_torque: Callable[..., float] = njit(forceinline=True, **OPTIONS)(laws.contact)
_law_of_losses: Callable[..., float] = njit(forceinline=True, **OPTIONS)(laws.driver_torque)


@_inline
def _sincos(x: float) -> tuple[float, float]:
    """Sine and cosine together, to 1e-15 for |x| < 1e6 (reduction of Cody and Waite, then Taylor to order 15)."""
    k = (x * 0.6366197723675814 + 6755399441055744.0) - 6755399441055744.0  # to the nearest whole number
    r = ((x - k * 1.5707963267341256) - k * 6.077100506303966e-11) - k * 2.0222662487959506e-21
    q = r * r
    s = q * (1.6059043836821613e-10 - q * 7.647163731819816e-13) - 2.505210838544172e-8
    s = q * (q * s + 2.7557319223985893e-6) - 1.984126984126984e-4
    s = r + r * q * (q * (q * s + 8.333333333333333e-3) - 1.6666666666666666e-1)
    c = q * (2.08767569878681e-9 - q * 1.1470745597729725e-11) - 2.755731922398589e-7
    c = q * (q * c + 2.48015873015873e-5) - 1.388888888888889e-3
    c = 1.0 + q * (q * (q * c + 4.1666666666666664e-2) - 0.5)
    n = int(k)
    sign = 1.0 - (n & 2)
    return sign * (c if n & 1 else s), sign * (-s if n & 1 else c)


@_inline
def _dent(k: int, side: float, p: Floats, q: Ints, w: Floats) -> tuple[float, float, float]:
    """Missing material [rad at the driven gear] on one flank of link k, its slope over the angles of both wheels."""
    return _dents(p, q[DENTS + k], q[DENTS + k + 1], side, k, w, STAGE)


@_inline
def _friction(s: int, speed: float, slip: float, t: float, p: Floats) -> float:
    """Torque [N m] against a shaft (offset s) that slides in direction `slip`, or holds that share of its friction."""
    return _law_of_friction(
        p[s + COULOMB_F], p[s + COULOMB_B], p[s + VISCOUS_F], p[s + VISCOUS_B], p[s + STRIBECK], p[s + STRIBECK_W],
        p[s + STRIBECK_EXP], p[s + DRIFT], speed, slip, t,
    )  # fmt: skip


@_inline
def _driver_torque(a: int, load: float, way: int, side: int, p: Floats) -> float:
    """Torque [N m] into the rolling lossy gear of link a for the load at its driver: LossyGear, solved for tau_a."""
    drives = (way > 0) == (side > 0)
    return _law_of_losses(load, way, drives, p[a + ETA1], p[a + ETA2], p[a + BF1], p[a + BF2])


@_inline
def _driving_side(a: int, load: float, way: int, p: Floats) -> int:
    """1 while tau_a is above the turning point of the two branches, else -1."""
    return 1 if _driver_torque(a, load, way, 1, p) >= way * p[a + TURN] else -1


@_inline
def _contact(k: int, x: float, xd: float, c: float, p: Floats, q: Ints, w: Floats) -> float:
    """Force [N m] of link k in the held contact mode; leaves the margins of that mode."""
    mode = q[CONTACT + k]
    a = LINKS + WIDTH * k
    if mode == PLAIN:
        return _spring(x, c, p[a + CUBIC]) + p[a + D] * xd
    m = 4 * k
    if mode == GAP:
        w[MARGIN + m] = p[a + HALF] + _dent(k, 1.0, p, q, w)[0] - x
        w[MARGIN + m + 1] = p[a + HALF] + _dent(k, -1.0, p, q, w)[0] + x
        return 0.0
    side = 1.0 if mode > 0 else -1.0
    depth, before, after = _dent(k, side, p, q, w)
    w[ASKS + k] -= side * before
    w[GIVES + k] += side * after
    x = side * x - p[a + HALF] - depth
    spring = _spring(x, c, p[a + CUBIC])
    damper = p[a + D] * (side * xd - before * w[STAGE + 4 + k] - after * w[STAGE + 5 + k])
    mode = abs(mode)
    if mode == BOTH:
        w[MARGIN + m] = spring - damper if p[a + LAW] == ELASTO else 1.0
        w[MARGIN + m + 1] = x if p[a + LAW] == LINEAR else spring + damper
    else:
        w[MARGIN + m] = damper - spring if mode == LIMITED else -spring - damper
        w[MARGIN + m + 1] = x
    return float(side * _contact_torque(p[a + LAW], spring, damper, mode))


@_inline
def _drive_torque(t: float, u: float, p: Floats) -> float:
    torque = p[DRIVE] + u * p[DRIVE + 1]
    if p[DRIVE + 2] != 0.0:
        torque += p[DRIVE + 2] * _sincos(p[DRIVE + 3] * t + p[DRIVE + 4])[0]
    return torque


@_inline
def _link(k: int, p: Floats, q: Ints, w: Floats) -> float:
    """Force [N m at the driven gear] of link k; leaves the rate of its hysteresis, and its levers.

    An error of teeth varies the ratio of the torques as it does that of the speeds: no power is lost by it.
    """
    a = LINKS + WIDTH * k
    w[ASKS + k] = p[a + INV]
    w[GIVES + k] = 1.0
    x = w[STAGE + k] * p[a + INV] - w[STAGE + k + 1]
    xd = w[STAGE + 4 + k] * p[a + INV] - w[STAGE + 5 + k]
    j = q[LINES + k]
    while j < q[LINES + k + 1]:
        s, c = _sincos(p[j + 1] * w[STAGE + int(p[j])] + p[j + 3])
        slope = p[j + 2] * p[j + 1] * c
        x -= p[j + 2] * s
        xd -= slope * w[STAGE + 4 + int(p[j])]
        if int(p[j]) == k:
            w[ASKS + k] -= slope
        else:
            w[GIVES + k] += slope
        j += ROW
    force = _contact(k, x, xd, p[a + C], p, q, w)
    if p[a + HYST] != 0.0:
        z = w[STAGE + 8 + k]
        force += z
        w[MARGIN + 4 * k + 2] = q[LOOP + k] * xd
        w[RATE + 8 + k] = xd * (p[a + HYST] - q[LOOP + k] * z) / p[a + HYST_X]
    return float(force)


@_inline
def _shaft(k: int, net: float, last: int, t: float, p: Floats, q: Ints, w: Floats) -> float:
    """Acceleration [rad/s2] of shaft k under `net` torque without friction and gear; leaves its margins."""
    s = WIDTH * k
    a = LINKS + s
    m = SHAFT_MARGIN + 2 * k
    way = q[WAY + k]
    load = w[FORCE + k] * w[ASKS + k] if k < last else 0.0
    lossy = k < last and p[a + LOSSY] != 0.0
    if way == 0:
        ahead = load
        back = load
        if lossy:
            w[MARGIN + 4 * k + 3] = 1.0
            ahead = _driver_torque(a, load, 1, _driving_side(a, load, 1, p), p)
            back = _driver_torque(a, load, -1, _driving_side(a, load, -1, p), p)
        w[MARGIN + m] = _friction(s, 0.0, 1.0, t, p) + ahead - net
        w[MARGIN + m + 1] = net - back - _friction(s, 0.0, -1.0, t, p)
        return 0.0
    speed = w[STAGE + 4 + k]
    if lossy:
        load = _driver_torque(a, load, way, q[SIDE + k], p)
        w[MARGIN + 4 * k + 3] = q[SIDE + k] * (load - way * p[a + TURN])
    if way == FREE:
        return (net - load - p[s + VISCOUS_F] * speed) * p[s + J]
    w[MARGIN + m] = way * speed
    w[MARGIN + m + 1] = 1.0
    return float((net - load - _friction(s, speed, float(way), t, p)) * p[s + J])


@_inline
def _rates(t: float, u: float, p: Floats, q: Ints, w: Floats) -> None:
    """Rates of STAGE into RATE, margins of all modes and link torques; u is the fraction of the input sample."""
    n = q[SHAFTS]
    for k in range(n - 1):
        w[FORCE + k] = _link(k, p, q, w)
    for k in range(n):
        w[RATE + k] = w[STAGE + 4 + k]
        s = WIDTH * k
        net = p[s + OFFSET]
        if k > 0:
            net += w[FORCE + k - 1] * w[GIVES + k - 1]
        else:
            net += _drive_torque(t, u, p)
        if p[s + GRAVITY] != 0.0:
            net -= p[s + GRAVITY] * _sincos(w[STAGE + k] + p[s + PHASE])[0]
        j = q[RIPPLES]
        while j < q[RIPPLES + 1]:
            if int(p[j + 4]) == k:
                over = w[STAGE + int(p[j])] if p[j] >= 0.0 else t
                net += p[j + 2] * _sincos(p[j + 1] * over + p[j + 3])[0]
            j += ROW
        w[RATE + 4 + k] = _shaft(k, net, n - 1, t, p, q, w)


@_jit
def _advance(t: float, h: float, u: float, du: float, p: Floats, q: Ints, w: Floats) -> None:
    """One Runge-Kutta step from Y to STAGE of length h (du of the sample); RATE, margins and forces are of its end."""
    half = 0.5 * h
    sixth = h / 6.0
    for i in range(STATES):
        w[TOTAL + i] = w[K1 + i]
        w[STAGE + i] = w[Y + i] + half * w[K1 + i]
    for s in range(4):
        part = 0.5 if s < 2 else 1.0
        _rates(t + part * h, u + part * du, p, q, w)
        if s < 2:
            ahead = h if s == 1 else half
            for i in range(STATES):
                w[TOTAL + i] += 2.0 * w[RATE + i]
                w[STAGE + i] = w[Y + i] + ahead * w[RATE + i]
        elif s == 2:
            for i in range(STATES):
                w[STAGE + i] = w[Y + i] + sixth * (w[TOTAL + i] + w[RATE + i])


@_inline
def _copy(to: int, row: int, size: int, w: Floats) -> None:
    for i in range(size):
        w[to + i] = w[row + i]


@_jit
def _switch(m: int, p: Floats, q: Ints, w: Floats) -> tuple[int, int, int, int]:
    """Change the mode whose margin m ran out. Returns (0 contact, 1 stick, 2 hysteresis, 3 side; which; from; to)."""
    if m >= SHAFT_MARGIN:
        k = (m - SHAFT_MARGIN) // 2
        old = q[WAY + k]
        if old == 0:
            q[WAY + k] = 1 if (m - SHAFT_MARGIN) % 2 == 0 else -1
            if k < q[SHAFTS] - 1:
                a = LINKS + WIDTH * k
                q[SIDE + k] = _driving_side(a, w[FORCE + k] * w[ASKS + k], q[WAY + k], p)
        else:
            w[Y + 4 + k] = 0.0
            q[WAY + k] = 0
        return 1, k, old, q[WAY + k]
    k = m // 4
    if m % 4 >= 2:
        slot = (LOOP if m % 4 == 2 else SIDE) + k
        q[slot] = -q[slot]
        return m % 4, k, -q[slot], q[slot]
    a = LINKS + WIDTH * k
    old = q[CONTACT + k]
    side = 1 if old > 0 else -1
    if old == GAP:
        damped = p[a + LAW] == ELASTO and p[a + D] != 0.0
        q[CONTACT + k] = (LIMITED if damped else BOTH) * (1 if m % 4 == 0 else -1)
    elif old != side * BOTH:
        q[CONTACT + k] = GAP if m % 4 == 1 else side * BOTH
    elif m % 4 == 0:
        q[CONTACT + k] = side * LIMITED
    else:
        q[CONTACT + k] = GAP if p[a + D] == 0.0 or p[a + LAW] == LINEAR else side * APART
    return 0, k, old, q[CONTACT + k]


@_jit
def _record(log: Matrix, count: int, t: float, change: tuple[int, int, int, int]) -> int:
    if count < log.shape[0]:
        log[count, 0] = t
        for i in range(4):
            log[count, 1 + i] = change[i]
    return count + 1


@_jit
def _settle(t: float, u: float, tolerance: float, log: Matrix, count: int, p: Floats, q: Ints, w: Floats) -> int:
    """Rates at the start of a step; modes that are already invalid there are changed at once."""
    for _ in range(MAX_EVENTS_PER_STEP):
        _copy(STAGE, Y, STATES, w)
        _rates(t, u, p, q, w)
        m = -1
        for j in range(MARGINS - 1, -1, -1):
            if w[MARGIN + j] < -tolerance:
                m = j
        if m < 0:
            break
        count = _record(log, count, t, _switch(m, p, q, w))
    _copy(K1, RATE, STATES, w)
    _copy(AT_START, MARGIN, MARGINS, w)
    return count


@_jit
def _locate(m: int, t: float, h: float, value: float, u: float, du: float, p: Floats, q: Ints, w: Floats) -> float:
    """Length of the step after which margin m (`value` < 0 at h) has just run out: Illinois' regula falsi.

    A margin that begins at zero may rise before it runs out, as the speed of a shaft that breaks away and sticks again
    within one step: the bracket then begins where it is found above zero; 0.0 where it nowhere is.
    """
    a = 0.0
    b = h
    at_a = w[AT_START + m]
    at_b = value
    if at_a <= 0.0:
        a = h
        for _ in range(HALVINGS):
            a *= 0.5
            _advance(t, a, u, du * a / h, p, q, w)
            at_a = w[MARGIN + m]
            if at_a > 0.0:
                break
        else:
            return 0.0
    last = 0
    for _ in range(80):
        tau = b - at_b * (b - a) / (at_b - at_a)
        if not a < tau < b:
            tau = 0.5 * (a + b)
        _advance(t, tau, u, du * tau / h, p, q, w)
        if w[MARGIN + m] < 0.0:
            b = tau
            at_b = w[MARGIN + m]
            at_a *= 0.5 if last == -1 else 1.0
            last = -1
        else:
            a = tau
            at_a = w[MARGIN + m]
            at_b *= 0.5 if last == 1 else 1.0
            last = 1
        if b - a <= 1e-12 * h or abs(w[MARGIN + m]) <= 1e-12 * abs(value):
            break
    return tau


@_jit
def _earliest(t: float, h: float, u: float, du: float, p: Floats, q: Ints, w: Floats) -> tuple[float, int]:
    """(length, margin) of the first that runs out within a step whose end values are in AT_END; STAGE is left there."""
    tau = h
    first = -1
    for m in range(MARGINS):
        value = w[AT_END + m]
        if value >= 0.0:
            continue
        if first >= 0:
            _advance(t, tau, u, du * tau / h, p, q, w)
            value = w[MARGIN + m]
        if value < 0.0:
            tau = _locate(m, t, tau, value, u, du * tau / h, p, q, w)
            first = m
            if tau == 0.0:
                break
    return tau, first


@_inline
def _step(
    t: float, h: float, u: float, du: float, tolerance: float, log: Matrix, count: int, p: Floats, q: Ints, w: Floats
) -> tuple[int, int]:
    """Y over one step with every event in it located. Returns (events so far, 1 if the step could not be resolved)."""
    left = h
    _copy(AT_START, MARGIN, MARGINS, w)
    for attempt in range(MAX_EVENTS_PER_STEP + 1):
        part = du * left / h
        _advance(t, left, u, part, p, q, w)
        clean = True
        for j in range(MARGINS):
            clean = clean and w[MARGIN + j] >= 0.0
        if clean or attempt == MAX_EVENTS_PER_STEP:
            break
        _copy(AT_END, MARGIN, MARGINS, w)
        tau, m = _earliest(t, left, u, part, p, q, w)
        if tau > 0.0:
            _copy(Y, STAGE, STATES, w)
            t += tau
            u += part * tau / left
            left -= tau
        count = _record(log, count, t, _switch(m, p, q, w))
        count = _settle(t, u, tolerance, log, count, p, q, w)
    _copy(Y, STAGE, STATES, w)
    _copy(K1, RATE, STATES, w)
    return count, 0 if clean else 1


@_jit
def _command(servo: Floats, reference: Matrix, tick: int, p: Floats, w: Floats, integral: float) -> float:
    """Torque of the servo into the drive: position P, speed PI with anti-windup, both limited. Returns the integral."""
    wanted = reference[1, tick] + servo[0] * (reference[0, tick] - w[Y + 0])
    error = min(max(wanted, -servo[3]), servo[3]) - w[Y + 4]
    torque = servo[1] * (error + integral) + servo[5] * reference[2, tick]
    p[DRIVE] = min(max(torque, -servo[4]), servo[4])
    return integral + servo[2] * error if p[DRIVE] == torque else integral


@_jit
def _initial_modes(p: Floats, q: Ints, w: Floats) -> None:
    """Modes that fit the start state; shafts at rest start stuck and break away at once if they must."""
    for k in range(q[SHAFTS] - 1):
        a = LINKS + WIDTH * k
        x = w[Y + k] * p[a + INV] - w[Y + k + 1]
        j = q[LINES + k]
        while j < q[LINES + k + 1]:
            x -= p[j + 2] * math.sin(p[j + 1] * w[Y + int(p[j])] + p[j + 3])
            j += ROW
        ahead = x - p[a + HALF] - _dent(k, 1.0, p, q, w)[0]
        back = -x - p[a + HALF] - _dent(k, -1.0, p, q, w)[0]
        mode = BOTH if ahead > 0.0 else (-BOTH if back > 0.0 else GAP)
        q[CONTACT + k] = PLAIN if p[a + LAW] == 0.0 else mode
        q[LOOP + k] = 1 if w[Y + 4 + k] * p[a + INV] >= w[Y + 5 + k] else -1
    for k in range(q[SHAFTS]):
        way = int(np.sign(w[Y + 4 + k]))
        frictional = p[WIDTH * k + FRICTIONAL] != 0.0 or (k < q[SHAFTS] - 1 and p[LINKS + WIDTH * k + LOSSY] != 0.0)
        q[WAY + k] = way if frictional else FREE
        q[SIDE + k] = 1


@_jit
def run(
    p: Matrix,
    q: NDArray[np.int64],
    given: Matrix,
    servo: Matrix,
    reference: Matrix,
    grid: Matrix,
    watch: Matrix,
    start: Matrix,
    log: Matrix,
    angle: Matrix,
    speed: Matrix,
    acceleration: Matrix,
    force: Matrix,
    torque: Matrix,
) -> tuple[int, int]:
    """Integrate over the rows of `torque`; `grid` = rate [Hz], steps per sample, tolerance; `watch` becomes the
    fraction done, for another thread. Inputs and servo ticks come once per sample. Returns (events, unresolved).
    """
    n = q[SHAFTS]
    substeps = int(grid[1])
    h = 1.0 / (grid[0] * substeps)
    du = 1.0 / substeps
    samples = torque.shape[0]
    w = np.zeros(W_SIZE)
    w[MARGIN:] = 1.0
    w[:STATES] = start
    w[STAGE : STAGE + STATES] = start
    _initial_modes(p, q, w)
    count = 0
    unresolved = 0
    integral = 0.0
    for i in range(samples):
        watch[0] = i / samples
        t = i / grid[0]
        last = i == samples - 1
        u = 1.0 if last and i > 0 else 0.0
        if given.shape[1] > 1 and not last:
            p[DRIVE], p[DRIVE + 1] = given[0, i], given[0, i + 1] - given[0, i]  # a straight line to the next sample
        if q[KIND] == SERVO:
            before = p[DRIVE]
            integral = _command(servo, reference, i, p, w, integral)
            if q[WAY] != 0:
                w[K1 + 4] += (p[DRIVE] - before) * p[J]
        if i == 0 or (q[KIND] == SERVO and q[WAY] == 0):
            count = _settle(t, u, grid[2], log, count, p, q, w)
        for k in range(n):
            angle[i, k] = w[Y + k]
            speed[i, k] = w[Y + 4 + k]
            acceleration[i, k] = w[K1 + 4 + k]
        for k in range(n - 1):
            force[i, k] = w[FORCE + k]
        torque[i] = _drive_torque(t, u, p)
        if last:
            break
        for j in range(substeps):
            count, lost = _step(t + j * h, h, j * du, du, grid[2], log, count, p, q, w)
            unresolved += lost
    return count, unresolved
