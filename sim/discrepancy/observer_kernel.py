"""Compiled loop of the guided chain: the motor moves as measured, the load is drawn along its measured angle.

Equations and flat arrays are those of `sim.chain` (see `pack` there), with three differences that make the outputs
differentiable in every parameter: friction and losses turn their sign over a finite speed, contact is the continuous
branch of ElastoBacklash, and a spring and damper pull the load towards its encoder. What that guide has to pull is
the load torque that the model lacks, so that an error of the model stays where and when it acts.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

import numpy as np
from numba import njit

TWO_PI = 2.0 * math.pi
(J, COULOMB_F, COULOMB_B, VISCOUS_F, VISCOUS_B, STRIBECK, STRIBECK_W, STRIBECK_EXP, DRIFT, GRAVITY, PHASE,
 OFFSET) = range(12)  # fmt: skip
INV, C, D, HALF, LAW, ETA1, ETA2, BF1, BF2, TURN, LOSSY, CUBIC, HYST, HYST_X = range(14)

_jit = njit(cache=True, error_model="numpy", fastmath=True, nogil=True)


@_jit
def _sign(x):
    """Smooth sign, cheaper than tanh."""
    return x / math.sqrt(1.0 + x * x)


@_jit
def _friction(shafts, k, w, width, t):
    way = _sign(w / width)
    ahead = 0.5 * (1.0 + way)
    level = ahead * shafts[k, COULOMB_F] + (1.0 - ahead) * shafts[k, COULOMB_B]
    viscous = ahead * shafts[k, VISCOUS_F] + (1.0 - ahead) * shafts[k, VISCOUS_B]
    if shafts[k, STRIBECK] != 0.0:
        v = abs(w) / shafts[k, STRIBECK_W]
        power = v * v if shafts[k, STRIBECK_EXP] == 2.0 else v ** shafts[k, STRIBECK_EXP]
        level += shafts[k, STRIBECK] * math.exp(-power)
    return (level * way + viscous * w) * (1.0 + shafts[k, DRIFT] * t)


@_jit
def _dent(dents, first, last, side, angles, speeds):
    depth = 0.0
    rate = 0.0
    for j in range(first, last):
        if dents[j, 4] == side:
            shaft = int(dents[j, 0])
            r = angles[shaft] - dents[j, 1]
            r -= TWO_PI * math.floor(r / TWO_PI + 0.5)
            u = r / dents[j, 2]
            if abs(u) < 1.0:
                depth += dents[j, 3] * math.cos(0.5 * math.pi * u)
                rate -= 0.5 * dents[j, 3] * math.pi * math.sin(0.5 * math.pi * u) * speeds[shaft] / dents[j, 2]
    return depth, rate


@_jit
def _external(shafts, ripples, k, angles, w, width, t):
    """Friction, gravity, offset and ripple of shaft k: torque against its motion."""
    torque = _friction(shafts, k, w, width, t) - shafts[k, OFFSET]
    if shafts[k, GRAVITY] != 0.0:
        torque += shafts[k, GRAVITY] * math.sin(angles[k] + shafts[k, PHASE])
    for j in range(ripples.shape[0]):
        if int(ripples[j, 4]) == k:
            torque -= ripples[j, 2] * math.sin(ripples[j, 1] * angles[int(ripples[j, 0])] + ripples[j, 3])
    return torque


@_jit
def run(shafts, links, lines, line_first, waves, wave_first, dents, dent_first, ripples, motion, guide, gains, widths,
        split, dt, substeps, start, out):  # fmt: skip
    """Integrate; rows of `out`: torque that the first mesh asks of the motor, load angle, torque of the guide [N m].

    `motion`, `guide`: rows angle and speed, cubic in between; `gains`: stiffness and damping of the guide (0: none);
    `widths`: speed over which friction of each shaft turns its sign; `split`: share of mesh losses on the driven side;
    `start`: angles and speeds of shafts 1 to n - 1, then hysteresis torques.
    """
    n = shafts.shape[0]
    m = n - 1
    samples = motion.shape[1]
    y = start.copy()
    size = y.shape[0]
    stage = np.empty(size)
    total = np.empty(size)
    dy = np.empty(size)
    angles = np.empty(n)
    speeds = np.empty(n)
    driven = np.zeros(n)
    driver = np.zeros(n)
    h = dt / substeps
    guided = gains[0] > 0.0
    pull = 0.0
    for i in range(samples):
        nxt = min(i + 1, samples - 1)
        p0, p1 = motion[0, i], motion[0, nxt]
        m0, m1 = motion[1, i] * dt, motion[1, nxt] * dt
        if guided:
            g0, g1 = guide[0, i], guide[0, nxt]
            n0, n1 = guide[1, i] * dt, guide[1, nxt] * dt
        for sub in range(substeps):
            for s in range(4):
                u = (sub + (0.0 if s == 0 else (1.0 if s == 3 else 0.5))) / substeps
                if nxt == i:
                    u = 0.0
                u2 = u * u
                u3 = u2 * u
                a0 = 2.0 * u3 - 3.0 * u2 + 1.0
                a1 = u3 - 2.0 * u2 + u
                a2 = 3.0 * u2 - 2.0 * u3
                a3 = u3 - u2
                b0 = 6.0 * (u2 - u) / dt
                b1 = (3.0 * u2 - 4.0 * u + 1.0) / dt
                b3 = (3.0 * u2 - 2.0 * u) / dt
                angles[0] = a0 * p0 + a1 * m0 + a2 * p1 + a3 * m1
                speeds[0] = b0 * (p0 - p1) + b1 * m0 + b3 * m1
                part = 0.0 if s == 0 else (h if s == 3 else 0.5 * h)
                for q in range(size):
                    stage[q] = y[q] if s == 0 else y[q] + part * dy[q]
                for k in range(m):
                    angles[k + 1] = stage[k]
                    speeds[k + 1] = stage[m + k]
                t = (i + u) * dt
                if guided:
                    pull = gains[0] * (a0 * g0 + a1 * n0 + a2 * g1 + a3 * n1 - angles[m]) + gains[1] * (
                        b0 * (g0 - g1) + b1 * n0 + b3 * n1 - speeds[m]
                    )
                for k in range(m):
                    x = angles[k] * links[k, INV] - angles[k + 1]
                    xd = speeds[k] * links[k, INV] - speeds[k + 1]
                    for j in range(line_first[k], line_first[k + 1]):
                        shaft = int(lines[j, 0])
                        phase = lines[j, 1] * angles[shaft] + lines[j, 3]
                        x -= lines[j, 2] * math.sin(phase)
                        xd -= lines[j, 2] * lines[j, 1] * math.cos(phase) * speeds[shaft]
                    c = links[k, C]
                    for j in range(wave_first[k], wave_first[k + 1]):
                        c += links[k, C] * waves[j, 2] * math.cos(waves[j, 1] * angles[int(waves[j, 0])] + waves[j, 3])
                    if links[k, LAW] == 0.0:
                        f = c * x * (1.0 + links[k, CUBIC] * x * x) + links[k, D] * xd
                    else:
                        side = 1.0 if x > 0.0 else -1.0
                        depth, rate = 0.0, 0.0
                        if dent_first[k + 1] > dent_first[k]:
                            depth, rate = _dent(dents, dent_first[k], dent_first[k + 1], side, angles, speeds)
                        p = side * x - links[k, HALF] - depth
                        f = 0.0
                        if p > 0.0:
                            spring = c * p * (1.0 + links[k, CUBIC] * p * p)
                            damper = links[k, D] * (side * xd - rate)
                            f = side * (spring + min(max(damper, -spring), spring))
                    if links[k, HYST] != 0.0:
                        z = stage[2 * m + k]
                        turn = 1.0 if xd > 0.0 else -1.0
                        f += z
                        dy[2 * m + k] = xd * (1.0 - turn * z / links[k, HYST]) * links[k, HYST] / links[k, HYST_X]
                    else:
                        dy[2 * m + k] = 0.0
                    way = _sign(speeds[k + 1] / widths[k + 1])
                    driver[k] = f * links[k, INV]
                    driven[k] = f
                    if links[k, LOSSY] != 0.0:
                        drives = f * way > 0.0
                        before = 1.0 / links[k, ETA1] - 1.0 if drives else 1.0 - links[k, ETA2]
                        after = 1.0 - links[k, ETA1] if drives else 1.0 / links[k, ETA2] - 1.0
                        driver[k] += (1.0 - split) * before * abs(f) * links[k, INV] * way
                        driver[k] += way * (links[k, BF1] if drives else links[k, BF2])
                        driven[k] -= split * after * abs(f) * way
                for k in range(1, n):
                    torque = driven[k - 1] - _external(shafts, ripples, k, angles, speeds[k], widths[k], t)
                    torque += -driver[k] if k < m else pull
                    dy[k - 1] = speeds[k]
                    dy[m + k - 1] = torque / shafts[k, J]
                if s == 0:
                    for q in range(size):
                        total[q] = dy[q]
                    if sub == 0:
                        out[0, i] = driver[0]
                        out[1, i] = angles[m]
                        out[2, i] = pull
                elif s == 3:
                    for q in range(size):
                        y[q] += h / 6.0 * (total[q] + dy[q])
                else:
                    for q in range(size):
                        total[q] += 2.0 * dy[q]


@_jit
def motor_torque(shafts, ripples, motion, width, dt, out):
    """Friction, gravity, offset and ripple of the motor's own shaft as it moves [N m]."""
    angles = np.zeros(shafts.shape[0])
    for i in range(motion.shape[1]):
        angles[0] = motion[0, i]
        out[i] = _external(shafts, ripples, 0, angles, motion[1, i], width, i * dt)
