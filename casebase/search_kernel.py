"""Compiled search: one pass over coded cases, then exact distances of the few that can be among the nearest.

Cases are coded as whole numbers of a step, 16 bits a feature: half the memory of float32, which is what limits the
pass. A code lies at most half a step beside its value, so that the coded distance D' is within a known reach E of the
true one (triangle inequality), and all of the k nearest have D' <= D'_k + 2 E. These are measured again in float64.

Importing this module imports numba; `casebase.retrieval` does so at the first search. All functions stay in this file
because numba's cache does not see changes in callees of other files.
"""

import math
from typing import Any

import numpy as np
from numba import njit

Array = Any

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def nearest(
    codes: Array,
    cases: Array,
    extra: Array,
    scaling: Array,
    query: Array,
    groups: Array,
    count: int,
    k: int,
    step: float,
    reach: float,
    factor: float,
) -> tuple[Array, Array]:
    """Return rows and distances of the k nearest cases of every group, nearest first, equal ones by row.

    Args:
        codes: cases over the step, shape (cases, width), int16; zero in features that the query does not have.
        cases: values, shape (cases, n), float32.
        extra: what missing features add to the squared distance, shape (cases,), float64.
        scaling: center, scale, root of the weight and limit of every feature, shape (4, n); the root is zero where
            the query has none.
        query: shape (n,), float64.
        groups: number of the group of every case, below 0 if it may not be found, shape (cases,), int16.
        count: how many groups there are.
        k: how many of each are wanted, at least 1.
        step: of the codes.
        reach: how far codes lie from cases at most, as a distance.
        factor: what brings the weights of the features that the query has to sum 1.

    Returns:
        Rows, shape (count, k), -1 where a group has fewer; distances, shape (count, k), infinite there.
    """
    point = np.zeros(query.size, np.float32)
    coded = np.zeros(codes.shape[1], np.int16)
    off = 0.0
    for j in range(query.size):
        if scaling[2, j] > 0.0:
            scaled = (query[j] - scaling[0, j]) / scaling[1, j]
            point[j] = min(max(scaled, -scaling[3, j]), scaling[3, j]) * scaling[2, j]
            coded[j] = np.int16(np.rint(point[j] / step))
            off += (point[j] - coded[j] * step) ** 2
    squares = np.empty(codes.shape[0], np.int32)
    bounds = _coded_squares(codes, extra, 1.0 / step**2, coded, groups, count, k, squares)
    margin = 2.0 * (reach + math.sqrt(off)) / step + 1.0
    for group in range(count):
        if bounds[group] < 2147483647:
            bounds[group] = np.int32(min((math.sqrt(bounds[group]) + margin) ** 2, 2147483646.0))
    rows, best = _measured(squares, bounds, groups, cases, extra, scaling, point, count, k)
    return rows, np.sqrt(best * factor)


@_jit
def _coded_squares(
    codes: Array,
    extra: Array,
    squared_codes: float,
    coded: Array,
    groups: Array,
    count: int,
    k: int,
    squares: Array,
) -> Array:
    """Fill in the squared distances between codes; return the k-th smallest of every group, shape (count,)."""
    lowest = np.full((count, k), 2147483647, np.int32)
    last = k - 1
    for row in range(codes.shape[0]):
        group = groups[row]
        if group < 0:
            continue
        total = np.int32(0)
        for j in range(codes.shape[1]):
            apart = np.int16(codes[row, j] - coded[j])
            total = np.int32(total + np.int32(np.int32(apart) * np.int32(apart)))
        total = np.int32(total + np.int32(extra[row] * squared_codes))
        squares[row] = total
        if total < lowest[group, last]:
            place = last
            while place > 0 and lowest[group, place - 1] > total:
                lowest[group, place] = lowest[group, place - 1]
                place -= 1
            lowest[group, place] = total
    return lowest[:, last].copy()


@_jit
def _measured(
    squares: Array,
    bounds: Array,
    groups: Array,
    cases: Array,
    extra: Array,
    scaling: Array,
    point: Array,
    count: int,
    k: int,
) -> tuple[Array, Array]:
    """Return the k nearest of every group among the rows within the bounds, by their distances in float64."""
    rows = np.full((count, k), -1, np.int64)
    best = np.full((count, k), np.inf)
    last = k - 1
    for row in range(squares.size):
        group = groups[row]
        if group < 0 or squares[row] > bounds[group]:
            continue
        total = extra[row]
        for j in range(point.size):
            if scaling[2, j] > 0.0:
                apart = np.float64(cases[row, j]) - np.float64(point[j])
                total += apart * apart
        if total < best[group, last]:
            place = last
            while place > 0 and best[group, place - 1] > total:
                best[group, place] = best[group, place - 1]
                rows[group, place] = rows[group, place - 1]
                place -= 1
            best[group, place] = total
            rows[group, place] = row
    return rows, best
