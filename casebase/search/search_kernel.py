"""Compiled search: one pass over coded cases, then exact distances of the few that can be among the nearest.

Cases are coded as whole numbers of a step, 16 bits a feature: half the memory of their float32 values, which is what
limits the pass. A code lies at most half a step beside its value, so that the coded distance D' is within a known reach
E of the true one (triangle inequality), and all of the k nearest have D' <= D'_k + 2 E. These are measured again, from
their values, in float64. The values themselves may lie in a file: few of them are looked at.

Importing this module imports numba; `casebase.search.retrieval` does so at the first search. All functions stay in this
file because numba's cache does not see changes in callees of other files.
"""

import math
from typing import Any

import numpy as np
from numba import njit

Array = Any

_jit = njit(cache=True, error_model="numpy", nogil=True)
BLOCK = 256
"""Cases held against every query in turn: their codes fit the processor's first cache."""
FARTHEST = 2147483647


@_jit
def _weighted(value: float, scaling: Array, j: int) -> Any:
    """Return a feature over its scale, clipped and times the root of its weight."""
    scaled = (np.float64(value) - scaling[0, j]) / scaling[1, j]
    return np.float32(min(max(scaled, -scaling[3, j]), scaling[3, j]) * scaling[2, j])


@_jit
def code(values: Array, scaling: Array, step: float, codes: Array) -> float:
    """Fill in the codes of the cases; return how far one lies from its case at most, as a distance.

    Args:
        values: shape (cases, n), float32, NaN where missing: coded as zero.
        scaling: center, scale, root of the weight and limit of every feature, shape (4, n).
        step: of the codes.
        codes: to be filled in, shape (cases, width), int16, zero beyond the features.
    """
    farthest = 0.0
    for row in range(values.shape[0]):
        off = 0.0
        for j in range(values.shape[1]):
            if math.isnan(values[row, j]):
                continue
            weighted = np.float64(_weighted(values[row, j], scaling, j))
            whole = np.rint(weighted / step)
            codes[row, j] = np.int16(whole)
            off += (weighted - whole * step) ** 2
        farthest = max(farthest, off)
    return math.sqrt(farthest)


@_jit
def missing_weight(values: Array, weights: Array, extra: Array) -> None:
    """Fill in the weight of the features that each case does not have, shape (cases,)."""
    for row in range(values.shape[0]):
        total = 0.0
        for j in range(values.shape[1]):
            if math.isnan(values[row, j]):
                total += weights[j]
        extra[row] = total


@_jit
def nearest(
    codes: Array,
    values: Array,
    extra: Array,
    scaling: Array,
    queries: Array,
    groups: Array,
    count: int,
    k: int,
    step: float,
    reach: float,
    factor: float,
    kin: Array,
    own: Array,
) -> tuple[Array, Array]:
    """Return rows and distances of the k nearest cases of every group, nearest first, equal ones by row.

    Args:
        codes: cases over the step, shape (cases, width), int16.
        values: shape (cases, n), float32, NaN where missing.
        extra: what missing features add to the squared distance, shape (cases,), float64.
        scaling: center, scale, root of the weight and limit of every feature, shape (4, n); the root is zero where
            the queries have none.
        queries: shape (queries, n), float64; all have the same features.
        groups: number of the group of every case, below 0 if it may not be found, shape (cases,), int16.
        count: how many groups there are.
        k: how many of each are wanted, at least 1.
        step: of the codes.
        reach: how far codes lie from cases at most, as a distance.
        factor: what brings the weights of the features that the queries have to sum 1.
        kin: numbers of what a case shares with others (gearbox, sound), shape (kinds, cases), int32.
        own: those of the queries, shape (kinds, queries): a query does not find its kin.

    Returns:
        Rows, shape (queries, count, k), -1 where a group has fewer; distances, of that shape, infinite there.
    """
    asked, width = queries.shape[0], codes.shape[1]
    points = np.zeros(queries.shape, np.float32)
    coded = np.zeros((asked, width), np.int16)
    here = np.zeros(width, np.int16)
    margins = np.empty(asked)
    for q in range(asked):
        off = 0.0
        for j in range(queries.shape[1]):
            if scaling[2, j] > 0.0:
                here[j] = -1
                points[q, j] = _weighted(queries[q, j], scaling, j)
                coded[q, j] = np.int16(np.rint(points[q, j] / step))
                off += (points[q, j] - coded[q, j] * step) ** 2
        margins[q] = 2.0 * (reach + math.sqrt(off)) / step + 1.0
    squares = np.empty((asked, codes.shape[0]), np.int32)
    bounds = _coded_squares(codes, extra, 1.0 / step**2, coded, here, groups, count, k, kin, own, squares)
    rows = np.full((asked, count, k), -1, np.int64)
    best = np.full((asked, count, k), np.inf)
    for q in range(asked):
        for group in range(count):
            if bounds[q, group] < FARTHEST:
                bounds[q, group] = np.int32(min((math.sqrt(bounds[q, group]) + margins[q]) ** 2, FARTHEST - 1.0))
        _measured(squares[q], bounds[q], groups, values, extra, scaling, points[q], rows[q], best[q])
    return rows, np.sqrt(best * factor)


@_jit
def _coded_squares(
    codes: Array,
    extra: Array,
    squared_codes: float,
    coded: Array,
    here: Array,
    groups: Array,
    count: int,
    k: int,
    kin: Array,
    own: Array,
    squares: Array,
) -> Array:
    """Fill in the squared distances between codes, the farthest where a case may not be found.

    Returns the k-th smallest of every query and group, shape (queries, count).
    """
    asked, last = coded.shape[0], k - 1
    lowest = np.full((asked, count, k), FARTHEST, np.int32)
    for first in range(0, codes.shape[0], BLOCK):
        for q in range(asked):
            for row in range(first, min(first + BLOCK, codes.shape[0])):
                group = groups[row]
                related = group < 0
                for kind in range(kin.shape[0]):
                    related |= kin[kind, row] == own[kind, q]
                if related:
                    squares[q, row] = FARTHEST
                    continue
                total = np.int32(0)
                for j in range(codes.shape[1]):
                    apart = np.int16(np.int16(codes[row, j] - coded[q, j]) & here[j])
                    total = np.int32(total + np.int32(np.int32(apart) * np.int32(apart)))
                total = np.int32(total + np.int32(extra[row] * squared_codes))
                squares[q, row] = total
                if total < lowest[q, group, last]:
                    place = last
                    while place > 0 and lowest[q, group, place - 1] > total:
                        lowest[q, group, place] = lowest[q, group, place - 1]
                        place -= 1
                    lowest[q, group, place] = total
    return lowest[:, :, last].copy()


@_jit
def _measured(
    squares: Array,
    bounds: Array,
    groups: Array,
    values: Array,
    extra: Array,
    scaling: Array,
    point: Array,
    rows: Array,
    best: Array,
) -> None:
    """Fill in the nearest of every group among the rows within the bounds, by their squared distances in float64.

    Args:
        rows, best: shape (count, k), -1 and infinite to begin with.
    """
    last = best.shape[1] - 1
    for row in range(squares.size):
        if squares[row] == FARTHEST:
            continue
        group = groups[row]
        if squares[row] > bounds[group]:
            continue
        total = extra[row]
        for j in range(point.size):
            if scaling[2, j] > 0.0:
                value = np.float64(0.0)
                if not math.isnan(values[row, j]):
                    value = np.float64(_weighted(values[row, j], scaling, j))
                apart = value - np.float64(point[j])
                total += apart * apart
        if total < best[group, last]:
            place = last
            while place > 0 and best[group, place - 1] > total:
                best[group, place] = best[group, place - 1]
                rows[group, place] = rows[group, place - 1]
                place -= 1
            best[group, place] = total
            rows[group, place] = row
