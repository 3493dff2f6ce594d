"""Retrieve: exact search over one matrix in memory, compiled; the rows of the database are the truth."""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from casebase.case_table import CaseTable, Mask
from casebase.similarity import LIMIT, Floats, Metric

LARGEST_CODE = 32000
"""Differences of codes fit 16 bits."""
LARGEST_DISTANCE = 46340
"""The square of a coded distance fits 32 bits."""
LANES = 16
VIEWS_KEPT = 4


@functools.cache
def kernel() -> ModuleType:
    """Return the compiled functions; the first call imports numba."""
    from casebase import search_kernel

    return search_kernel


@dataclass(frozen=True, eq=False)
class _View:
    """The matrix as a query with certain features sees it; see `search_kernel.nearest` for the arrays.

    Args:
        factor: what brings the weights of these features to sum 1 in a squared distance.
    """

    present: Mask
    codes: NDArray[np.int16]
    extra: Floats
    scaling: Floats
    factor: float


class _Query:
    """Features asked for, shape (n,), and the matrix as they see it."""

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

    def voting(self, k: int) -> Floats:
        """Return the squared distances of the k nearest of every class, shape (classes, k), infinite where fewer."""
        squares = self.distances[:, :k] ** 2
        return np.pad(squares, ((0, 0), (0, k - squares.shape[1])), constant_values=np.inf)

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


class CaseMatrix:
    """A table made ready for one metric.

    Args:
        table: the cases.
        metric: what a distance is.
    """

    def __init__(self, table: CaseTable, metric: Metric) -> None:
        self.table, self.metric = table, metric
        scaled = metric.scaled(table.values)
        self.missing = np.isnan(scaled)
        root = np.sqrt(metric.weights)
        self.matrix = np.where(self.missing, 0.0, scaled * root).astype(np.float32)
        count, size = self.matrix.shape
        largest = float(root.max(initial=0.0))
        self.step = (2 * LIMIT + 0.5) * max(largest / LARGEST_CODE, 1 / LARGEST_DISTANCE)
        self._codes = np.zeros((count, -(-size // LANES) * LANES), np.int16)
        self._codes[:, :size] = np.rint(self.matrix / np.float32(self.step))
        off = self.matrix - self._codes[:, :size] * np.float32(self.step)
        self.reach = math.sqrt(float(np.einsum("ij,ij->i", off, off).max(initial=0.0))) * 1.001 + self.step
        self._gappy = bool(self.missing.any())
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
        asked = self._asked(query)
        return NearestByClass(self, asked, *self._nearest(asked, groups, len(self.table.classes), k))

    def squared_distances(self, query: NDArray[np.floating]) -> Floats:
        """Return the squared distance to every case, shape (cases,)."""
        asked = self._asked(query)
        apart = self.matrix - asked.point
        apart *= asked.view.present
        squares = np.einsum("ij,ij->i", apart, apart) + asked.view.extra
        return np.asarray(squares * asked.view.factor, dtype=np.float64)

    def shares(self, asked: _Query, row: int, distance: float) -> Floats:
        """Return what every feature adds to the distance of a case, shape (n,)."""
        apart = self.matrix[row] - asked.point.astype(np.float64)
        parts = apart * apart
        if self._gappy:
            parts += self.missing[row] * self.metric.weights
        return np.asarray(parts * asked.view.present * (asked.view.factor / distance if distance > 0 else 0.0))

    def _found(self, asked: _Query, k: int, where: Mask | None) -> tuple[NDArray[np.int64], Floats]:
        groups = self._all if where is None else where.astype(np.int16) - np.int16(1)
        rows, distances = self._nearest(asked, groups, 1, k)
        found = rows[0] if rows[0, -1] >= 0 else rows[0, rows[0] >= 0]
        return found, distances[0, : found.size]

    def _nearest(
        self, asked: _Query, groups: NDArray[np.int16], count: int, k: int
    ) -> tuple[NDArray[np.int64], Floats]:
        view = asked.view
        k = max(1, min(k, len(self.table)))
        rows, distances = kernel().nearest(
            view.codes,
            self.matrix,
            view.extra,
            view.scaling,
            asked.values,
            groups,
            count,
            k,
            self.step,
            self.reach,
            view.factor,
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
        metric, size = self.metric, present.size
        weights = np.where(present, metric.weights, 0.0)
        codes = self._codes
        if not present.all():
            codes = codes.copy()
            codes[:, :size][:, ~present] = 0
        extra = self.missing @ weights if self._gappy else np.zeros(len(self.table))
        scaling = np.stack([metric.center, metric.scale, np.sqrt(weights), np.full(size, LIMIT)])
        total = float(weights.sum())
        return _View(present, codes, extra, scaling, 1 / total if total > 0 else 0.0)
