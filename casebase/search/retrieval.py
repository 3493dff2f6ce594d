"""Retrieve: exact search over coded cases in memory, compiled; the rows of the database are the truth."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from casebase.reasoning.novelty import spread_out
from casebase.search.case_table import CaseTable, Mask
from casebase.search.similarity import LIMIT, Floats, Metric, pooled_scales

LARGEST_CODE = 32000
"""Differences of codes fit 16 bits."""
LARGEST_DISTANCE = 46340
"""The square of a coded distance fits 32 bits."""
LANES = 16
VIEWS_KEPT = 4
ENOUGH_FOR_SCALES = 20_000
"""The median of so many cases lies within a hundredth of the spread (1.25 over the root of their number) [1]."""
AT_ONCE = 16
"""Queries that go through the cases together; each takes four bytes a case meanwhile."""


Kinship = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Numbers of what cases share with each other, shape (cases,), and those of queries, shape (queries,)."""
NO_KIN = np.empty((0, 0), np.int32)


@functools.cache
def kernel() -> ModuleType:
    """Return the compiled functions; the first call imports numba."""
    from casebase.search import search_kernel

    return search_kernel


@dataclass(frozen=True, eq=False)
class _View:
    """The cases as a query with certain features sees them; see `search_kernel.nearest` for the arrays.

    Args:
        factor: what brings the weights of these features to sum 1 in a squared distance.
    """

    present: Mask
    extra: Floats
    scaling: Floats
    factor: float


class _Query:
    """Features asked for, shape (n,), and the cases as they see them."""

    def __init__(self, values: Floats, view: _View, metric: Metric) -> None:
        self.values, self.view, self.metric = values, view, metric

    @functools.cached_property
    def point(self) -> NDArray[np.float32]:
        """The query times the roots of the weights, zero where missing, shape (n,)."""
        point = self.metric.scaled(self.values) * self.view.scaling[2]
        return np.where(self.view.present, point, 0.0).astype(np.float32)


class Match:
    """A case found, and why it is near: the contributions add up to the distance.

    Args:
        distance: from the query.
        row: of the case in the table.
    """

    def __init__(self, matrix: "CaseMatrix", query: _Query, row: int, distance: float) -> None:
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
        rows: nearest first, shape (classes, k), -1 where a class has fewer.
        distances: shape (classes, k), infinite there.
    """

    matrix: "CaseMatrix"
    query: _Query
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
        self._values = np.ascontiguousarray(table.values, np.float32)
        count, size = table.values.shape
        self._scaling = np.stack([metric.center, metric.scale, np.sqrt(metric.weights), np.full(size, LIMIT)])
        largest = float(self._scaling[2].max(initial=0.0))
        self.step = (2 * LIMIT + 0.5) * max(largest / LARGEST_CODE, 1 / LARGEST_DISTANCE)
        self._codes = np.zeros((count, -(-size // LANES) * LANES), np.int16)
        self.reach = kernel().code(self._values, self._scaling, self.step, self._codes) + self.step
        self._all = np.zeros(count, np.int16)
        self._views: dict[bytes, _View] = {}

    def search(self, query: NDArray[np.floating], k: int, *, where: Mask | None = None) -> tuple[Match, ...]:
        """Return the k nearest cases, nearest first, equal ones by id.

        Args:
            query: features, shape (n,), NaN where missing.
            k: how many at most.
            where: shape (cases,), the cases that may be found; all by default.
        """
        asked = self._asked(query)
        rows, distances = self._found(asked, k, where)
        pairs = zip(rows.tolist(), distances.tolist(), strict=True)
        return tuple([Match(self, asked, row, distance) for row, distance in pairs])

    def nearest_rows(
        self, query: NDArray[np.floating], k: int, *, where: Mask | None = None
    ) -> tuple[NDArray[np.int64], Floats]:
        """Return the rows of the k nearest cases and their distances, without saying why; else as `search`."""
        return self._found(self._asked(query), k, where)

    def nearest_by_class(self, query: NDArray[np.floating], k: int, *, where: Mask | None = None) -> NearestByClass:
        """Return the k nearest cases of every class; else as `search`."""
        groups = self.table.class_numbers
        if where is not None:
            groups = np.where(where, groups, np.int16(-1))
        asked, k = self._asked(query), min(k, max(1, len(self.table)))
        rows, distances = self._nearest(asked.values[None], groups, len(self.table.classes), k)
        return NearestByClass(self, asked, rows[0], distances[0])

    def nearest_strangers(
        self, queries: NDArray[np.floating], groups: NDArray[np.int16], count: int, k: int, kin: Sequence[Kinship]
    ) -> tuple[NDArray[np.int64], Floats]:
        """Return for every query the k nearest cases of every group that share nothing with it.

        Costs as many passes over the codes as there are queries, several queries at a time.

        Args:
            queries: features, shape (queries, n), NaN where missing.
            groups: number of the group of every case, below 0 if it may not be found, shape (cases,).
            count: how many groups there are.
            kin: numbers of what cases share (gearbox, sound), shape (cases,), with those of the queries.

        Returns:
            Rows, nearest first, shape (queries, count, k), -1 where a group has fewer; distances, infinite there.
        """
        points: Floats = np.asarray(queries, np.float64)
        rows = np.full((len(points), count, k), -1, np.int64)
        distances = np.full(rows.shape, np.inf)
        shared, own = (np.array([pair[side] for pair in kin], np.int32) for side in (0, 1))
        masks, kind = np.unique(np.isfinite(points), axis=0, return_inverse=True)
        for number in range(len(masks)):
            alike = np.flatnonzero(kind.ravel() == number)
            for start in range(0, alike.size, AT_ONCE):
                these = alike[start : start + AT_ONCE]
                found = self._nearest(points[these], groups, count, k, shared, np.ascontiguousarray(own[:, these]))
                rows[these], distances[these] = found
        return rows, distances

    def shares(self, asked: _Query, row: int, distance: float) -> Floats:
        """Return what every feature adds to the distance of a case, shape (n,)."""
        scaled = self.metric.scaled(self.table.values[row])
        missing = np.isnan(scaled)
        case = np.where(missing, 0.0, scaled * self._scaling[2]).astype(np.float32)
        parts = (case - asked.point.astype(np.float64)) ** 2 + missing * self.metric.weights
        return np.asarray(parts * asked.view.present * (asked.view.factor / distance if distance > 0 else 0.0))

    def _found(self, asked: _Query, k: int, where: Mask | None) -> tuple[NDArray[np.int64], Floats]:
        groups = self._all if where is None else where.astype(np.int16) - np.int16(1)
        rows, distances = self._nearest(asked.values[None], groups, 1, max(1, min(k, len(self.table))))
        found = rows[0, 0, rows[0, 0] >= 0]
        return found, distances[0, 0, : found.size]

    def _nearest(
        self,
        queries: Floats,
        groups: NDArray[np.int16],
        count: int,
        k: int,
        kin: NDArray[np.int32] = NO_KIN,
        own: NDArray[np.int32] = NO_KIN,
    ) -> tuple[NDArray[np.int64], Floats]:
        """Return rows and distances of the nearest of every group to queries that have the same features."""
        view = self._view(queries[0])
        rows, distances = kernel().nearest(
            self._codes,
            self._values,
            view.extra,
            view.scaling,
            queries,
            groups,
            count,
            k,
            self.step,
            self.reach,
            view.factor,
            kin,
            own,
        )
        return rows, distances

    def _asked(self, query: NDArray[np.floating]) -> _Query:
        values = np.array(query, dtype=np.float64)
        return _Query(values, self._view(values), self.metric)

    def _view(self, query: Floats) -> _View:
        present = np.isfinite(query)
        key = present.tobytes()
        view = self._views.get(key)
        if view is None:
            view = self._made_view(present)
            if len(self._views) >= VIEWS_KEPT:
                self._views.clear()
            self._views[key] = view
        return view

    def _made_view(self, present: Mask) -> _View:
        weights = np.where(present, self.metric.weights, 0.0)
        extra = np.empty(len(self.table))
        kernel().missing_weight(self._values, weights, extra)
        scaling = self._scaling.copy()
        scaling[2, ~present] = 0.0
        total = float(weights.sum())
        return _View(present, extra, scaling, 1 / total if total > 0 else 0.0)
