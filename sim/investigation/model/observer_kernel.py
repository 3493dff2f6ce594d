"""Compiled loop of the guided chain: the motor moves as measured, the load is drawn along its measured angle.

Equations are those of `sim.chain.model`; friction, spring and dents those of `sim.laws`, as in the
simulation. Three differences make the outputs differentiable in every parameter: friction and losses turn their sign
over a finite speed, contact is the continuous branch of ElastoBacklash, and a spring and damper pull the load towards
its encoder. What that guide has to pull is the load torque that the model lacks, so that an error of the model stays
where and when it acts.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

import numpy as np
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from sim import laws
from sim.investigation.data.preprocessing import WIDE_SHARE
from sim.laws import (
    BF1,
    BF2,
    COULOMB_B,
    COULOMB_F,
    CUBIC,
    DRIFT,
    ELASTO,
    ETA1,
    ETA2,
    GRAVITY,
    HALF,
    HYST,
    HYST_X,
    INV,
    LAW,
    LOSSY,
    OFFSET,
    PHASE,
    STRIBECK,
    STRIBECK_EXP,
    STRIBECK_W,
    TWO_PI,
    VISCOUS_B,
    VISCOUS_F,
    C,
    D,
    J,
)

FORGOTTEN = 40.0  # times the way by which a contact gives way: nothing is left of what it held
WIDE = 1.47 / (TWO_PI * WIDE_SHARE)  # reach of that low-pass in samples
TAYLOR = 24  # terms of the exponential: enough for a phase of 3 per step
OPTIONS = {"error_model": "numpy", "fastmath": True, "nogil": True}


def _jit(function):
    return njit(cache=True, **OPTIONS)(laws.keyed(function, WIDE_SHARE))


def _inline(function):
    """A call costs counts of references of every array that is handed over."""
    return njit(cache=True, forceinline=True, **OPTIONS)(laws.keyed(function, WIDE_SHARE))


_law_of_friction = njit(forceinline=True, **OPTIONS)(laws.friction)
_spring = njit(forceinline=True, **OPTIONS)(laws.spring)
_dents = njit(forceinline=True, **OPTIONS)(laws.dents)
_contact = njit(forceinline=True, **OPTIONS)(laws.contact)
_losses = njit(forceinline=True, **OPTIONS)(laws.driver_torque)


@intrinsic
def _room(_context, stages):
    """Pointer to room on the stack for the longest row of numbers of a chain, 4 of each stage and 8.

    What lies on the heap may be changed by any writing, as far as the compiler knows: `run` took a quarter longer.
    """

    def allocated(context, builder, _signature, _arguments):
        return cgutils.alloca_once(builder, context.get_value_type(types.float64), size=4 * stages.count + 8)

    return types.CPointer(types.float64)(stages), allocated


@_inline
def _tanh(x):
    """To 3e-4, by Padé's approximant of order 7 over 6, cut where it reaches 1."""
    x = min(max(x, -4.97), 4.97)
    q = x * x
    return x * (135135.0 + q * (17325.0 + q * (378.0 + q))) / (135135.0 + q * (62370.0 + q * (3150.0 + 28.0 * q)))


@_inline
def _sine_cosine(x):
    """Both to 2e-9, by Taylor's series in the nearest quarter of the turn: faster than one after the other."""
    quarter = math.floor(x * (2.0 / math.pi) + 0.5)
    r = x - quarter * (0.5 * math.pi)
    q = r * r
    s = r * (1.0 + q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0 + q * (1.0 / 362880.0)))))
    c = 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0 + q * (1.0 / 40320.0 - q * (1.0 / 3628800.0)))))
    k = int(quarter)
    odd = k & 1  # no branches: nobody foretells the quarter
    swap = odd * (c - s)
    return (1 - (k & 2)) * (s + swap), (1 - ((k + 1) & 2)) * (c - swap)


@_inline
def _slid(slip, w, width, stretch, h):
    """Share of its friction that a contact holds after time `h` at speed `w`: 1 or -1 once it slides (Dahl 1968).

    It gives way by `stretch` before, and lets go of what it holds at rest in the time in which that is moved at speed
    `width`. Without a stretch, friction is the hyperbolic tangent of the speed over `width`.
    """
    slides = w * h / stretch
    lets = width * h / stretch
    both = math.sqrt(slides * slides + lets * lets)
    goal = _tanh(w / width)
    if both > FORGOTTEN:
        return goal
    return goal + (slip - goal) * math.exp(-both)


@_inline
def _friction(shafts, k, w, way, t):
    return _law_of_friction(
        shafts[k, COULOMB_F], shafts[k, COULOMB_B], shafts[k, VISCOUS_F], shafts[k, VISCOUS_B], shafts[k, STRIBECK],
        shafts[k, STRIBECK_W], shafts[k, STRIBECK_EXP], shafts[k, DRIFT], w, way, t,
    )  # fmt: skip


@_inline
def _passed(phase):
    """Share of a wave of `phase` [rad] per sample that the low-pass of the measured torque lets through."""
    q = 0.5 * (WIDE * phase) ** 2
    part = q / 16.0
    # sixteenth root of the exponential, by its series: the share is right to 2e-4
    root = 1.0 + part * (1.0 + part * (0.5 + part * (1.0 / 6.0)))
    root *= root
    root *= root
    root *= root
    return (1.0 + q) / (root * root)


@_inline
def _external(shafts, ripples, k, angles, w, way, t):
    """Friction, gravity, offset and ripple of shaft k: torque against its motion."""
    torque = _friction(shafts, k, w, way, t) - shafts[k, OFFSET]
    if shafts[k, GRAVITY] != 0.0:
        torque += shafts[k, GRAVITY] * math.sin(angles[k] + shafts[k, PHASE])
    for j in range(ripples.shape[0]):
        if int(ripples[j, 4]) == k:
            over = angles[int(ripples[j, 0])] if ripples[j, 0] >= 0.0 else t
            torque -= ripples[j, 2] * math.sin(ripples[j, 1] * over + ripples[j, 3])
    return torque


@_inline
def _piece(p0, v0, p1, v1, sub, substeps):
    """Coefficients of the cubic between two samples on one of its equal pieces."""
    c2 = 3.0 * (p1 - p0) - 2.0 * v0 - v1
    c3 = 2.0 * (p0 - p1) + v0 + v1
    if substeps == 1:
        return p0, v0, c2, c3
    s = sub / substeps
    r = 1.0 / substeps
    return (
        p0 + s * (v0 + s * (c2 + s * c3)),
        r * (v0 + s * (2.0 * c2 + s * 3.0 * c3)),
        r * r * (c2 + 3.0 * s * c3),
        r * r * r * c3,
    )


@_jit
def _acted(shafts, ripples):
    """Which shafts anything but their links acts on."""
    acted = np.zeros(shafts.shape[0], dtype=np.bool_)
    for k in range(shafts.shape[0]):
        for column in (COULOMB_F, COULOMB_B, VISCOUS_F, VISCOUS_B, STRIBECK, GRAVITY, OFFSET):
            if shafts[k, column] != 0.0:
                acted[k] = True
        for j in range(ripples.shape[0]):
            if int(ripples[j, 4]) == k:
                acted[k] = True
    return acted


@_jit
def propagators(shafts, links, gains, h, step):
    """Exact step of the linear part for every set of closed links, shape (sets, 2m, 2m + 8 + 2m).

    Columns: state (angles, speeds times `h`); a torque on the first and one on the last driven shaft that go as u^q,
    q = 0 to 3, u = t / h; torques on every driven shaft, constant and as u. The response to u^q is q! phi_(q+1) of the
    matrix (Hochbruck, Ostermann, Acta Numerica 19 (2010) 209).
    """
    m = shafts.shape[0] - 1
    size = 2 * m
    matrix = np.zeros((size, size))
    weights = np.zeros((4, size, m))
    for closed in range(step.shape[0]):
        matrix[:] = 0.0
        for k in range(m):
            matrix[k, m + k] = 1.0
        for k in range(m):
            if not (closed >> k) & 1:
                continue
            c, d, inv = links[k, C], links[k, D], links[k, INV]
            after = h * h / shafts[k + 1, J]
            matrix[m + k, k] -= after * c
            matrix[m + k, m + k] -= after * d / h
            if k > 0:
                before = h * h / shafts[k, J]
                matrix[m + k, k - 1] += after * c * inv
                matrix[m + k, m + k - 1] += after * d * inv / h
                matrix[m + k - 1, k] += before * c * inv
                matrix[m + k - 1, m + k] += before * d * inv / h
                matrix[m + k - 1, k - 1] -= before * c * inv * inv
                matrix[m + k - 1, m + k - 1] -= before * d * inv * inv / h
        last = h * h / shafts[m, J]
        matrix[size - 1, m - 1] -= last * gains[0]
        matrix[size - 1, size - 1] -= last * gains[1] / h
        weights[:] = 0.0
        power = np.eye(size)
        factorial = 1.0
        for term in range(TAYLOR):
            if term:
                power = power @ matrix
                factorial *= term
            step[closed, :, :size] += power / factorial
            share = factorial
            times = 1.0
            for q in range(4):
                share *= term + q + 1
                if q:
                    times *= q
                for k in range(m):
                    weights[q, :, k] += power[:, m + k] * (times / share * h * h / shafts[k + 1, J])
        for q in range(4):
            step[closed, :, size + q] = weights[q, :, 0]
            step[closed, :, size + 4 + q] = weights[q, :, m - 1]
        step[closed, :, size + 8 : size + 8 + m] = weights[0]
        step[closed, :, size + 8 + m :] = weights[1]


@_jit
def run(shafts, links, lines, line_first, dents, dent_first, ripples, motion, guide, known, gains,
        widths, stretch, split, dt, substeps, start, out, stages):  # fmt: skip
    """Integrate; rows of `out`: torque that the first mesh asks of the motor, load angle, torque of the guide [N m].

    Springs in contact, guide and measured motion are propagated exactly; what is not linear is predicted from the
    step before, evaluated once at the step's end and corrected there: order 2, and free of error without it.

    `motion`, `guide`: rows angle and speed, cubic in between; `known`: torque that the load is known to ask for
    besides, straight in between, of no rows where none is known; `gains`: stiffness and damping of the guide (0: none);
    `widths`: rows of speeds over which mesh losses and friction of each shaft turn their sign; `stretch`: by which
    shafts give way before friction slides; `split`: share of mesh losses on the driven side while the
    motor drives, and while the load does;
    `start`: angles and speeds of shafts 1 to n - 1, then hysteresis torques; `stages`: a tuple with one entry per link,
    of which only the length is used: the compiler knows it and unrolls the loops over shafts.
    """
    m = len(stages)
    n = m + 1
    size = 2 * m
    samples = motion.shape[1]
    h = dt / substeps
    sets = 1 << m
    width = 2 * size + 8
    rest, slope = size + 8, size + 8 + m  # places of what is not linear
    step = np.zeros((sets, size, width))
    propagators(shafts, links, gains, h, step)
    z = carray(_room(stages), (width,))
    ahead = carray(_room(stages), (size,))
    driven = carray(_room(stages), (n,))
    driver = carray(_room(stages), (n,))
    held = carray(_room(stages), (m,))
    twist = carray(_room(stages), (m,))
    new = carray(_room(stages), (m,))
    slip = carray(_room(stages), (n,))
    angles = np.empty(n)
    speeds = np.empty(n)
    z[:] = 0.0
    z[:m] = start[:m]
    z[m:size] = start[m:size] * h
    held[:] = start[size:]
    twist[:] = 0.0
    slip[:] = 0.0
    acted = _acted(shafts, ripples)
    guided = gains[0] > 0.0
    closed = -1
    first = True
    b0 = b1 = b2 = b3 = 0.0
    for i in range(samples):
        for sub in range(substeps):
            if i == 0 and sub > 0:
                break
            if i > 0:
                # from sample i - 1 to i
                p0, p1 = motion[0, i - 1], motion[0, i]
                v0, v1 = motion[1, i - 1] * dt, motion[1, i] * dt
                a0, a1, a2, a3 = _piece(p0, v0, p1, v1, sub, substeps)
                if guided:
                    g0, g1 = guide[0, i - 1], guide[0, i]
                    n0, n1 = guide[1, i - 1] * dt, guide[1, i] * dt
                    b0, b1, b2, b3 = _piece(g0, n0, g1, n1, sub, substeps)
                s = v = 0.0
                if closed & 1:
                    s = links[0, C] * links[0, INV]
                    v = links[0, D] * links[0, INV] / h
                z[size] = s * a0 + v * a1
                z[size + 1] = s * a1 + v * 2.0 * a2
                z[size + 2] = s * a2 + v * 3.0 * a3
                z[size + 3] = s * a3
                if guided:
                    v = gains[1] / h
                    z[size + 4] = gains[0] * b0 + v * b1
                    z[size + 5] = gains[0] * b1 + v * 2.0 * b2
                    z[size + 6] = gains[0] * b2 + v * 3.0 * b3
                    z[size + 7] = gains[0] * b3
                for q in range(size):  # no view of step[closed]: counting its references takes a fifth of the time
                    total = 0.0
                    for k in range(width):
                        total += step[closed, q, k] * z[k]
                    ahead[q] = total
                angles[0] = a0 + a1 + a2 + a3
                speeds[0] = (a1 + 2.0 * a2 + 3.0 * a3) / h
            else:
                for q in range(size):
                    ahead[q] = z[q]
                angles[0] = motion[0, 0]
                speeds[0] = motion[1, 0]
            for k in range(m):
                angles[k + 1] = ahead[k]
                speeds[k + 1] = ahead[m + k] / h
            t = i * dt if i == 0 else (i - 1) * dt + (sub + 1) * h
            now = 0
            for k in range(m):
                new[k] = 0.0
            for k in range(m):
                straight = angles[k] * links[k, INV] - angles[k + 1]
                straight_rate = speeds[k] * links[k, INV] - speeds[k + 1]
                x = straight
                xd = straight_rate
                before_lever, after_lever = links[k, INV], 1.0  # dx over the angles of both wheels: no power is lost
                for j in range(line_first[k], line_first[k + 1]):
                    shaft = int(lines[j, 0])
                    sine, cosine = _sine_cosine(lines[j, 1] * angles[shaft] + lines[j, 3])
                    height = lines[j, 2] * _passed(lines[j, 1] * speeds[shaft] * dt)
                    slant = height * lines[j, 1] * cosine
                    x -= height * sine
                    xd -= slant * speeds[shaft]
                    if shaft == k:
                        before_lever -= slant
                    else:
                        after_lever += slant
                c = links[k, C]
                touch = True
                if links[k, LAW] == 0.0:
                    force = _spring(x, c, links[k, CUBIC]) + links[k, D] * xd
                else:
                    side = 1.0 if x > 0.0 else -1.0
                    depth = rate = 0.0
                    if dent_first[k + 1] > dent_first[k]:
                        depth, before, after = _dents(dents, dent_first[k], dent_first[k + 1], side, k, angles, 0)
                        rate = before * speeds[k] + after * speeds[k + 1]
                        before_lever -= side * before
                        after_lever += side * after
                    p = side * x - links[k, HALF] - depth
                    force = 0.0
                    touch = p > 0.0
                    if touch:
                        spring = _spring(p, c, links[k, CUBIC])
                        damper = links[k, D] * (side * xd - rate)
                        force = side * _contact(ELASTO, spring, damper, 0)
                if links[k, HYST] != 0.0:
                    if not first:
                        moved = x - twist[k]
                        goal = links[k, HYST] if moved > 0.0 else -links[k, HYST]
                        held[k] = goal + (held[k] - goal) * math.exp(-abs(moved) / links[k, HYST_X])
                    force += held[k]
                twist[k] = x
                linear = 0.0
                if touch:
                    now |= 1 << k
                    linear = links[k, C] * straight + links[k, D] * straight_rate
                driver[k] = force * before_lever
                driven[k] = force * after_lever
                if links[k, LOSSY] != 0.0:
                    way = _tanh(speeds[k + 1] / widths[0, k + 1])
                    drives = force * way > 0.0
                    asked_for = _losses(1.0, 1.0, drives, links[k, ETA1], links[k, ETA2], 0.0, 0.0)
                    before, after = abs(asked_for - 1.0), abs(1.0 - 1.0 / asked_for)
                    share = split[0] if drives else split[1]
                    driver[k] += (1.0 - share) * before * abs(force) * links[k, INV] * way
                    driver[k] += way * (links[k, BF1] if drives else links[k, BF2])
                    driven[k] -= share * after * abs(force) * way
                new[k] += driven[k] - linear
                if k > 0:
                    new[k - 1] -= driver[k] - linear * links[k, INV]
            for k in range(1, n):
                if acted[k]:
                    if first:
                        slip[k] = _tanh(speeds[k] / widths[1, k])
                    else:
                        slip[k] = _slid(slip[k], speeds[k], widths[1, k], stretch, h)
                    new[k - 1] -= _external(shafts, ripples, k, angles, speeds[k], slip[k], t)
            if known.size:
                new[m - 1] -= known[0] if i == 0 else known[i - 1] + (sub + 1) / substeps * (known[i] - known[i - 1])
            asked = driver[0]
            if not first and now == closed:
                for q in range(size):
                    for k in range(m):
                        ahead[q] += step[closed, q, slope + k] * (new[k] - z[rest + k] - z[slope + k])
                if now & 1:
                    asked -= links[0, INV] * (
                        links[0, C] * (ahead[0] - angles[1]) + links[0, D] * (ahead[m] / h - speeds[1])
                    )
                for k in range(m):
                    z[slope + k] = new[k] - z[rest + k]
            else:
                for k in range(m):
                    z[slope + k] = 0.0
            first = False
            closed = now
            for k in range(m):
                z[rest + k] = new[k]
            for q in range(size):
                z[q] = ahead[q]
        out[0, i] = asked
        out[1, i] = z[m - 1]
        if guided:
            out[2, i] = gains[0] * (guide[0, i] - z[m - 1]) + gains[1] * (guide[1, i] - z[size - 1] / h)


@_jit
def motor_torque(shafts, ripples, motion, width, stretch, dt, out):
    """Friction, gravity, offset and ripple of the motor's own shaft as it moves [N m]."""
    angles = np.zeros(shafts.shape[0])
    slip = _tanh(motion[1, 0] / width)
    for i in range(motion.shape[1]):
        if i > 0:
            slip = _slid(slip, motion[1, i], width, stretch, dt)
        angles[0] = motion[0, i]
        out[i] = _external(shafts, ripples, 0, angles, motion[1, i], slip, i * dt)


@_jit
def shaken(shafts, links, gains, turns, late_s, motor, load, out):
    """What springs in contact make of motion; rows of `out`: spectra of the torque asked of the motor, of the guide's.

    Friction is viscous. `turns`: places on the imaginary axis [rad/s]; `motor`, `load`: spectra of the motor's angle
    and of what the load is drawn along, which comes `late_s` later, all of shape (k,).
    """
    m = links.shape[0]
    share = np.empty(m, dtype=np.complex128)
    ahead = np.empty(m, dtype=np.complex128)
    for i in range(turns.size):
        s = complex(0.0, turns[i])
        sine, cosine = _sine_cosine(turns[i] * late_s)
        told = load[i] * complex(cosine, sine)
        pull = gains[0] + gains[1] * s
        behind = pull  # torque per angle of all beyond a shaft
        drawn = pull * told  # and its torque while the shaft stands still
        for k in range(m - 1, -1, -1):
            inv = links[k, INV]
            spring = links[k, C] + links[k, D] * s
            yields = 1.0 / (spring + behind + (shafts[k + 1, J] * s + shafts[k + 1, VISCOUS_F]) * s)
            share[k] = spring * yields * inv
            ahead[k] = drawn * yields
            drawn *= share[k]
            behind = (spring - spring * spring * yields) * inv * inv
        angle = motor[i]
        for k in range(m):
            angle = share[k] * angle + ahead[k]
        out[0, i] = behind * motor[i] - drawn
        out[1, i] = pull * (told - angle)


@_jit
def loudness(shafts, links, gains, turns):
    """Geometric mean over `turns` [rad/s] of |guide torque per error of the load encoder| [N m/rad]."""
    total = 0.0
    for turn in turns:
        s = complex(0.0, turn)
        stiffness = complex(0.0, 0.0)
        for k in range(links.shape[0]):
            soft = 1.0 / (links[k, C] + links[k, D] * s)
            if k > 0:
                soft += links[k, INV] ** 2 / stiffness
            stiffness = 1.0 / soft + shafts[k + 1, J] * s * s + shafts[k + 1, VISCOUS_F] * s
        guide = gains[0] + gains[1] * s
        total += math.log(abs(guide * stiffness / (guide + stiffness)))
    return math.exp(total / turns.size)
