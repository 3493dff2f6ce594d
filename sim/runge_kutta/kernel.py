"""Compiled inner loop of Runge-Kutta over components: steps of order 8 over one law q'' = P x + Q w with G w = -H x.

G, H and the inequalities are affine in the values of curves, numbers that depend on one row of the state each:
G = G0 + c1 G1 + ... All functions stay in this file because numba's cache does not see changes in callees of others;
loops stand where slices would do because they compile ten times as fast.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from sim.rotational.curves import Curve, Shape

if TYPE_CHECKING:
    from numpy.typing import NDArray

STAGES = DOP853.n_stages
A, B, C = (np.ascontiguousarray(part) for part in (DOP853.A, DOP853.B, DOP853.C))
A_EXTRA, C_EXTRA, D = (np.ascontiguousarray(part) for part in (DOP853.A_EXTRA, DOP853.C_EXTRA, DOP853.D))
E3, E5 = np.ascontiguousarray(DOP853.E3), np.ascontiguousarray(DOP853.E5)
SAFETY, LEAST_FACTOR, MOST_FACTOR = 0.9, 0.2, 10.0
"""Control of the step as in Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.4."""

TABLE, RECIPROCAL, DRIVER, SQUARE, SIGNED_SQUARE, INVERSE, EXP, SINE, COSINE, LINEAR, EDDY = (int(x) for x in Shape)

_jit = njit(cache=True, error_model="numpy", nogil=True)


@lru_cache(maxsize=1024)
def packed(curves: tuple[Curve, ...]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Shapes, lengths and signs of curves, shape (n, 3), and their tables, filled up with zeros."""
    kinds = np.array([(curve.shape, len(curve.table), bool(curve.positive)) for curve in curves], np.int64)
    columns = max((len(row) for curve in curves for row in curve.table), default=0)
    tables = np.zeros((len(curves), max((len(curve.table) for curve in curves), default=0), columns))
    for table, curve in zip(tables, curves, strict=True):
        for i, row in enumerate(curve.table):
            table[i, : len(row)] = row
    return kinds.reshape(-1, 3), tables


@_jit
def _interpolated(table, length, column, s):
    if length == 1:
        return table[0, column]
    i = 0
    while i < length - 2 and s >= table[i + 1, 0]:
        i += 1
    share = (s - table[i, 0]) / (table[i + 1, 0] - table[i, 0])
    return table[i, column] + share * (table[i + 1, column] - table[i, column])


@_jit
def value(kinds, tables, j, s):
    """Value of curve j at s; nan where it must be above zero and is not. Formulas: `sim.rotational.curves.Shape`."""
    shape = kinds[j, 0]
    if shape in (TABLE, RECIPROCAL):
        found = _interpolated(tables[j], kinds[j, 1], 1, max(s, 0.0))
        if kinds[j, 2] == 1 and found <= 0.0:
            return np.nan
        return found if shape == TABLE else 1.0 / found
    if shape == DRIVER:
        w = max(s, 0.0)
        eta1 = _interpolated(tables[j], kinds[j, 1], 1, w)
        eta2 = _interpolated(tables[j], kinds[j, 1], 2, w)
        bearing1 = _interpolated(tables[j], kinds[j, 1], 3, w)
        if eta1 == 1.0 and eta2 == 1.0:
            return bearing1 / 2
        return (bearing1 - _interpolated(tables[j], kinds[j, 1], 4, w)) / (eta1 - 1.0 / eta2)
    if shape == SQUARE:
        return s * s
    if shape == SIGNED_SQUARE:
        return s * abs(s)
    if shape == INVERSE:
        return 1.0 / max(abs(s), 1.0)
    if shape == EDDY:
        return 2.0 * s / (1.0 + s * s)
    if shape == EXP:
        return np.tanh(50.0 * s)
    within = min(max(s, -1.0), 1.0)
    if shape == SINE:
        return np.sin(0.5 * np.pi * within)
    if shape == COSINE:
        return np.sign(s) * (1.0 - np.cos(0.5 * np.pi * within))
    return within


@_jit
def full(moving, elapsed, signals, x):
    """Fill x, whole states: angles and speeds, signals `elapsed` [s] after their pieces began, one."""
    columns, swings, pieces = signals
    n = moving.shape[0]
    for i in range(n):
        x[i] = moving[i]
    for i in range(pieces.shape[0]):
        x[n + i] = pieces[i]
    x[x.shape[0] - 1] = 1.0
    for i in range(columns.shape[0]):
        column, w, d = n + columns[i], swings[i, 0], swings[i, 1]
        s, r = x[column], x[column + 1]
        if w == 0.0:
            x[column] = s + r * elapsed
        else:
            left = np.exp(-d * elapsed)
            cosine, sine, b = left * np.cos(w * elapsed), left * np.sin(w * elapsed), (r + d * s) / w
            x[column] = s * cosine + b * sine
            x[column + 1] = r * cosine - (d * b + w * s) * sine


@_jit
def coefficients(x, curves):
    """Values of all curves at the state x, after a one: what G0, H0 are multiplied with."""
    kinds, tables, rows = curves
    out = np.ones(1 + rows.shape[0])
    for j in range(rows.shape[0]):
        out[1 + j] = value(kinds, tables, j, _dot(rows[j], x))
    return out


@_jit
def _dot(row, x):
    total = 0.0
    for i in range(x.shape[0]):
        total += row[i] * x[i]
    return total


@_jit
def _mixed(c, parts):
    out = np.zeros(parts.shape[1:])
    for j in range(parts.shape[0]):
        for r in range(parts.shape[1]):
            for i in range(parts.shape[2]):
                out[r, i] += c[j] * parts[j, r, i]
    return out


@_jit
def _solved(a, b):
    """Solution of a z = b by Gaussian elimination with pivots, of a few unknowns; a and b are used up."""
    m = b.shape[0]
    for k in range(m):
        pivot = k
        for r in range(k + 1, m):
            if abs(a[r, k]) > abs(a[pivot, k]):
                pivot = r
        for i in range(m):
            a[k, i], a[pivot, i] = a[pivot, i], a[k, i]
        b[k], b[pivot] = b[pivot], b[k]
        for r in range(k + 1, m):
            factor = a[r, k] / a[k, k]
            for i in range(k, m):
                a[r, i] -= factor * a[k, i]
            b[r] -= factor * b[k]
    for k in range(m - 1, -1, -1):
        for i in range(k + 1, m):
            b[k] -= a[k, i] * b[i]
        b[k] /= a[k, k]
    return b


@_jit
def chosen(x, c, law):
    """What changes of the unknowns at x, shape (m,)."""
    left, right = law[2], law[3]
    if left.shape[1] == 0:
        return np.zeros(0)
    rows = _mixed(c, right)
    wanted = np.empty(left.shape[1])
    for r in range(left.shape[1]):
        wanted[r] = -_dot(rows[r], x)
    return _solved(_mixed(c, left), wanted)


@_jit
def _rate(moving, elapsed, law, curves, signals, x, out):
    """Fill out with the time derivative of angles and speeds."""
    full(moving, elapsed, signals, x)
    f = out.shape[0] // 2
    c = coefficients(x, curves)
    if not np.isfinite(c.sum()):
        for i in range(f):
            out[i] = moving[f + i]
            out[f + i] = np.nan
        return
    w = chosen(x, c, law)
    for i in range(f):
        out[i] = moving[f + i]
        out[f + i] = _dot(law[0][i], x) + _dot(law[1][i], w)


@_jit
def rate(moving, elapsed, law, curves, signals):
    """Time derivative of angles and speeds, shape (2 freedom,)."""
    out = np.empty_like(moving)
    _rate(moving, elapsed, law, curves, signals, np.empty(moving.shape[0] + signals[2].shape[0] + 1), out)
    return out


@_jit
def margins(moving, elapsed, scale, law, curves, signals):
    """Values of all inequalities at states (k, 2 freedom) and times (k,), and the sizes of their terms."""
    states = np.empty((elapsed.shape[0], scale.shape[0]))
    values = np.empty((elapsed.shape[0], law[4].shape[1]))
    sizes = np.empty_like(values)
    for k in range(elapsed.shape[0]):
        x = states[k]
        full(moving[k], elapsed[k], signals, x)
        c = coefficients(x, curves)
        w = chosen(x, c, law)
        by_state, by_choice = _mixed(c, law[4]), _mixed(c, law[5])
        for r in range(values.shape[1]):
            values[k, r] = _dot(by_state[r], x) + _dot(by_choice[r], w)
            size = 0.0
            for i in range(x.shape[0]):
                size += abs(by_state[r, i]) * max(scale[i], abs(x[i]))
            for i in range(w.shape[0]):
                size += abs(by_choice[r, i] * w[i])
            sizes[k, r] = size
    return states, values, sizes


@_jit
def unknown(states, law, curves):
    """Coefficients (k, 1 + curves) and what changes of the unknowns (k, m) at whole states (k, n)."""
    c = np.empty((states.shape[0], 1 + curves[2].shape[0]))
    w = np.empty((states.shape[0], law[2].shape[1]))
    for k in range(states.shape[0]):
        values = coefficients(states[k], curves)
        choice = chosen(states[k], values, law)
        for j in range(values.shape[0]):
            c[k, j] = values[j]
        for j in range(choice.shape[0]):
            w[k, j] = choice[j]
    return c, w


@_jit
def _moved(y, h, weights, count, stages, out):
    """Fill out with y + h times the weighted sum of the first `count` stages."""
    for i in range(y.shape[0]):
        total = 0.0
        for r in range(count):
            total += weights[r] * stages[r, i]
        out[i] = y[i] + h * total


@_jit
def step(t, y, f, h, bound, longest, began, rtol, atol, law, curves, signals, stages):
    """One step that keeps the tolerance: time, state, its derivative, the step taken (0.0: none can), the next to try.

    `stages` (16, 2 freedom) keeps the derivatives of all stages for the interpolant.
    """
    x = np.empty(y.shape[0] + signals[2].shape[0] + 1)
    new, slope = np.empty_like(y), np.empty_like(y)
    least = 10.0 * abs(np.nextafter(t, np.inf) - t)
    h = max(min(h, longest), least)
    most = MOST_FACTOR
    for i in range(y.shape[0]):
        stages[0, i] = f[i]
    while h >= least:
        end = min(t + h, bound)
        h = end - t
        for s in range(1, STAGES):
            _moved(y, h, A[s], s, stages, new)
            _rate(new, t + C[s] * h - began, law, curves, signals, x, stages[s])
        _moved(y, h, B, STAGES, stages, new)
        _rate(new, end - began, law, curves, signals, x, slope)
        for i in range(y.shape[0]):
            stages[STAGES, i] = slope[i]
        fifth, third = 0.0, 0.0
        for i in range(y.shape[0]):
            size = atol[i] + rtol * max(abs(y[i]), abs(new[i]))
            a, b = 0.0, 0.0
            for r in range(STAGES + 1):
                a += E5[r] * stages[r, i]
                b += E3[r] * stages[r, i]
            fifth += (a / size) ** 2
            third += (b / size) ** 2
        weighted = fifth + 0.01 * third
        error = 0.0 if weighted == 0.0 else h * fifth / np.sqrt(weighted * y.shape[0])
        if error < 1.0:
            factor = most if error == 0.0 else min(most, SAFETY * error**-0.125)
            return end, new, slope, h, h * factor
        h *= max(LEAST_FACTOR, SAFETY * error**-0.125) if np.isfinite(error) else LEAST_FACTOR
        most = 1.0
    return t, y, f, 0.0, h


@_jit
def interpolant(t, y, h, new, slope, began, law, curves, signals, stages):
    """Coefficients of the interpolant of a step that was taken, shape (7, 2 freedom); see `interpolated`."""
    x = np.empty(y.shape[0] + signals[2].shape[0] + 1)
    at = np.empty_like(y)
    for e in range(A_EXTRA.shape[0]):
        _moved(y, h, A_EXTRA[e], STAGES + 1 + e, stages, at)
        _rate(at, t + C_EXTRA[e] * h - began, law, curves, signals, x, stages[STAGES + 1 + e])
    out = np.empty((3 + D.shape[0], y.shape[0]))
    for i in range(y.shape[0]):
        out[0, i] = new[i] - y[i]
        out[1, i] = h * stages[0, i] - out[0, i]
        out[2, i] = 2.0 * out[0, i] - h * (slope[i] + stages[0, i])
        for d in range(D.shape[0]):
            total = 0.0
            for r in range(stages.shape[0]):
                total += D[d, r] * stages[r, i]
            out[3 + d, i] = h * total
    return out


@_jit
def interpolated(shares, y, terms):
    """States within a step at `shares` (k,) of it, shape (k, 2 freedom)."""
    out = np.empty((shares.shape[0], y.shape[0]))
    for k in range(shares.shape[0]):
        for i in range(y.shape[0]):
            total = 0.0
            for term in range(terms.shape[0]):
                share = shares[k] if term % 2 == 0 else 1.0 - shares[k]
                total = (total + terms[terms.shape[0] - 1 - term, i]) * share
            out[k, i] = y[i] + total
    return out
