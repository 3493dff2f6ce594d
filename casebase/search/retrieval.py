"""Retrieve: exact search over weighted cases in memory, compiled; the rows of the database are the truth."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from casebase.reasoning.novelty import spread_out
from casebase.search.case_table import CaseTable, Mask
from casebase.search.similarity import Floats, Metric, pooled_scales

ENOUGH_FOR_SCALES = 20_000
"""The median of so many cases lies within a hundredth of the spread (1.25 over the root of their number) [1]."""
BLOCK = 1 << 14
"""Cases that are weighted together: in float64 they take no more memory than that."""

Kinship = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Numbers of what cases share with each other, shape (cases,), and those of queries, shape (queries,)."""
Found = tuple[NDArray[np.int64], Floats]
"""Rows, nearest first, shape (queries, groups, k), -1 where a group has fewer; distances, infinite there."""


@functools.cache
def compiled() -> Callable[..., Found]:
    """Return `nearest` compiled; the first call imports numba."""
    from numba import njit

    function: Callable[..., Found] = njit(cache=True, error_model="numpy", nogil=True, fastmath={"reassoc"})(nearest)
    return function


def nearest(points: Any, weights: Any, queries: Any, groups: Any, count: int, k: int, kin: Any, own: Any) -> Found:
    """Return rows and squared distances, not yet over the weights that a query has, of the k nearest of every group.

    Equal ones stand by row.

    Args:
        points: cases over their scale times the roots of the weights, shape (cases, n), float32, NaN where missing.
        weights: of the features, shape (n,).
        queries: as the points, shape (queries, n), float64.
        groups: number of the group of every case, below 0 if it may not be found, shape (cases,), int16.
        count: how many groups there are.
        k: how many of each are wanted, at least 1.
        kin: numbers of what a case shares with others (gearbox, sound), shape (kinds, cases).
        own: those of the queries, shape (kinds, queries): a query does not find its kin.
    """
    rows = np.full((len(queries), count, k), -1, np.int64)
    best = np.full((len(queries), count, k), np.inf)
    present = (~np.isnan(queries)).astype(np.float64)
    known = np.where(np.isnan(queries), 0.0, queries)
    for q in range(len(queries)):
        for row in range(len(points)):
            group = groups[row]
            related = group < 0
            for kind in range(len(kin)):
                related |= kin[kind, row] == own[kind, q]
            if related:
                continue
            total = 0.0
            for j in range(points.shape[1]):
                here, point = known[q, j], np.float64(points[row, j])
                apart = here * here + weights[j] if np.isnan(point) else (point - here) ** 2
                total += present[q, j] * apart
            place = k
            while place > 0 and best[q, group, place - 1] > total:
                if place < k:
                    best[q, group, place], rows[q, group, place] = best[q, group, place - 1], rows[q, group, place - 1]
                place -= 1
            if place < k:
                best[q, group, place], rows[q, group, place] = total, row
    return rows, best


class Match:
    """A case found, and why it is near: the contributions add up to the distance.

    Args:
        query: what was asked for, weighted, shape (n,).
        row: of the case in the table.
        distance: from the query.
    """

    def __init__(self, matrix: "CaseMatrix", query: Floats, row: int, distance: float) -> None:
        self._matrix, self._query = matrix, query
        self.row, self.distance = row, distance

    @property
    def case_id(self) -> str:
        """Id of the case."""
        return str(self._matrix.table.ids[self.row])

    @property
    def label(self) -> str:
        """Label of the case."""
        return str(self._matrix.table.labels[self.row])

    @property
    def origin(self) -> str:
        """Measured or simulated."""
        return str(self._matrix.table.origins[self.row])

    @functools.cached_property
    def contributions(self) -> Mapping[str, float]:
        """What every feature adds to the distance."""
        shares = self._matrix.shares(self._query, self.row, self.distance)
        return dict(zip(self._matrix.table.names, shares.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class NearestByClass:
    """The nearest cases of every class to one query.

    Args:
        query: weighted, shape (n,).
        rows: nearest first, shape (classes, k), -1 where a class has fewer.
        distances: shape (classes, k), infinite there.
    """

    matrix: "CaseMatrix"
    query: Floats
    rows: NDArray[np.int64]
    distances: Floats

    def overall(self, k: int) -> tuple[Match, ...]:
        """Return the nearest of all classes, at most as many as were looked for in each."""
        return self._matches(np.ones(len(self.rows), dtype=np.bool_), min(k, self.rows.shape[1]))

    def of(self, label: str) -> Match | None:
        """Return the nearest case of a class."""
        return next(iter(self._matches(self._is(label), 1)), None)

    def other_than(self, label: str) -> Match | None:
        """Return the nearest case of any other class."""
        return next(iter(self._matches(~self._is(label), 1)), None)

    def _is(self, label: str) -> Mask:
        return np.array([each == label for each in self.matrix.table.classes])

    def _matches(self, classes: Mask, k: int) -> tuple[Match, ...]:
        rows, distances = self.rows[classes].ravel(), self.distances[classes].ravel()
        order = np.lexsort((rows, distances))[: min(k, np.count_nonzero(rows >= 0))]
        return tuple(Match(self.matrix, self.query, int(rows[i]), float(distances[i])) for i in order)


def metric_of(table: CaseTable, weights: Floats) -> Metric:
    """Return the distance between cases of a table: scales from its spread within labels, weights as given."""
    rows = spread_out(np.arange(len(table)), ENOUGH_FOR_SCALES)
    return Metric(table.names, *pooled_scales(table.values[rows], table.labels[rows]), weights / weights.sum())


class CaseMatrix:
    """A table made ready for one metric.

    Args:
        table: the cases.
        metric: what a distance is.
    """

    def __init__(self, table: CaseTable, metric: Metric) -> None:
        self.table, self.metric = table, metric
        self._points = np.empty(table.values.shape, np.float32)
        for first in range(0, len(table), BLOCK):
            self._points[first : first + BLOCK] = self._weighted(table.values[first : first + BLOCK])

    def search(self, query: NDArray[np.floating], k: int, *, where: Mask | None = None) -> tuple[Match, ...]:
        """Return the k nearest cases, nearest first, equal ones by id.

        Args:
            query: features, shape (n,), NaN where missing.
            k: how many at most.
            where: shape (cases,), the cases that may be found; all by default.
        """
        groups = np.where(True if where is None else where, 0, -1) + np.zeros(len(self.table), np.int16)
        return self._by_group(query, groups, 1, k).overall(k)

    def nearest_by_class(self, query: NDArray[np.floating], k: int, *, where: Mask | None = None) -> NearestByClass:
        """Return the k nearest cases of every class; else as `search`."""
        groups = np.where(True if where is None else where, self.table.class_numbers, -1)
        return self._by_group(query, groups, len(self.table.classes), k)

    def nearest_strangers(
        self, queries: NDArray[np.floating], groups: NDArray[np.int16], count: int, k: int, kin: Sequence[Kinship]
    ) -> Found:
        """Return for every query the k nearest cases of every group that share nothing with it.

        Costs as many passes over the cases as there are queries.

        Args:
            queries: features, shape (queries, n), NaN where missing.
            groups: number of the group of every case, below 0 if it may not be found, shape (cases,).
            count: how many groups there are.
            kin: numbers of what cases share (gearbox, sound), shape (cases,), with those of the queries.
        """
        shared, own = (np.array([pair[side] for pair in kin], np.int32) for side in (0, 1))
        return self._nearest(self._weighted(queries), groups, count, k, shared, own)

    def shares(self, query: Floats, row: int, distance: float) -> Floats:
        """Return what every feature adds to the distance of a case from a weighted query, shape (n,)."""
        point = self._points[row].astype(np.float64)
        parts = np.where(np.isnan(point), query**2 + self.metric.weights, (point - query) ** 2)
        factor = self._factors(query) / distance if distance > 0 else 0.0
        return np.asarray(np.where(np.isnan(query), 0.0, parts) * factor)

    def _weighted(self, values: NDArray[np.floating]) -> Floats:
        """Return features over their scale times the roots of their weights, shape (..., n), rounded to float32."""
        points = self.metric.scaled(values) * np.sqrt(self.metric.weights)
        return np.asarray(points.astype(np.float32), np.float64)

    def _factors(self, queries: Floats) -> Floats:
        """Return what brings the weights of the features that each query has to sum 1; 0 where it has none."""
        total = np.where(np.isnan(queries), 0.0, self.metric.weights).sum(axis=-1)
        return np.asarray(np.divide(1.0, total, out=np.zeros_like(total), where=total > 0), np.float64)

    def _by_group(self, query: NDArray[np.floating], groups: NDArray[Any], count: int, k: int) -> NearestByClass:
        asked = self._weighted(query)
        none = np.empty((0, 0), np.int32)
        k = max(1, min(k, len(self.table)))
        rows, distances = self._nearest(asked[None], groups, count, k, none, none)
        return NearestByClass(self, asked, rows[0], distances[0])

    def _nearest(
        self, asked: Floats, groups: NDArray[Any], count: int, k: int, kin: NDArray[Any], own: NDArray[Any]
    ) -> Found:
        groups = np.ascontiguousarray(groups, np.int16)
        rows, squares = compiled()(self._points, self.metric.weights, asked, groups, count, k, kin, own)
        return rows, np.sqrt(squares * self._factors(asked)[:, None, None])


def search_once() -> None:
    """Search in a library of one case."""
    word = np.array(["x"])
    table = CaseTable(1, "made", ("f0",), word, word, word, word, word, word, np.zeros((1, 1), np.float32))
    CaseMatrix(table, Metric(("f0",), np.zeros(1), np.ones(1), np.ones(1))).search(np.ones(1), 1)
