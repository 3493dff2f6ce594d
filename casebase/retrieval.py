"""Retrieve: exact search over one float32 matrix in memory; the rows of the database are the truth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from casebase.models import Case, Extractor, FeatureRow, LibraryCounter, StoredRecording
from casebase.similarity import Floats, Metric

BLOCK = 256
EPSILON = float(np.finfo(np.float32).eps)
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Match:
    """A case found, and why it is near: the contributions add up to the distance."""

    case_id: str
    label: str
    origin: str
    distance: float
    contributions: Mapping[str, float]
    row: int


@dataclass(frozen=True, eq=False)
class CaseTable:
    """All searchable cases at one version of the library, in order of id; arrays have shape (cases,).

    Args:
        version: the library's counter.
        values: features, shape (cases, n), float32, NaN where missing.
        groups: the gearbox; where it is unknown, and for simulated cases, the case itself.
    """

    version: int
    extractor_version: str
    names: tuple[str, ...]
    ids: NDArray[np.str_]
    labels: NDArray[np.str_]
    origins: NDArray[np.str_]
    axes: NDArray[np.str_]
    gearboxes: NDArray[np.str_]
    samples: NDArray[np.str_]
    values: NDArray[np.float32]

    def __len__(self) -> int:
        return int(self.ids.size)

    @cached_property
    def groups(self) -> NDArray[np.str_]:
        own = (self.gearboxes == "") | (self.origins == "simulated")
        return np.where(own, self.ids, self.gearboxes)

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """Labels in the library, sorted."""
        return tuple(sorted({str(label) for label in self.labels}))

    @property
    def text(self) -> tuple[NDArray[np.str_], ...]:
        """The columns of words, in the order of the fields."""
        return (self.ids, self.labels, self.origins, self.axes, self.gearboxes, self.samples)

    def take(self, rows: NDArray[np.intp] | Mask) -> "CaseTable":
        """Return some of the cases."""
        return self.with_columns(self.version, [column[rows] for column in self.text], self.values[rows])

    def with_columns(self, version: int, text: Sequence[NDArray[np.str_]], values: NDArray[np.float32]) -> "CaseTable":
        """Return a table of the same features with other cases."""
        ids, labels, origins, axes, gearboxes, samples = text
        return CaseTable(
            version, self.extractor_version, self.names, ids, labels, origins, axes, gearboxes, samples, values
        )


def load_table(session: Session, extractor_version: str, known: CaseTable | None = None) -> CaseTable:
    """Return the searchable cases now: `known` itself if nothing changed, else only what changed is read."""
    version = session.scalars(select(LibraryCounter.value)).one()
    if known is not None and known.version == version and known.extractor_version == extractor_version:
        return known
    if known is None or known.extractor_version != extractor_version or not len(known):
        return _read(session, extractor_version, version, since=-1)
    changed = _read(session, extractor_version, version, since=known.version)
    touched = session.scalars(select(Case.id).where(Case.library_version > known.version)).all()
    return _merged(known.take(~np.isin(known.ids, np.array(touched, dtype="U32"))), changed)


def _read(session: Session, extractor_version: str, version: int, since: int) -> CaseTable:
    extractor = session.get(Extractor, extractor_version)
    names = () if extractor is None else tuple(str(name) for name in extractor.names)
    rows = session.execute(_statement(extractor_version, since)).all()
    columns = list(zip(*rows, strict=True)) if rows else [()] * 8
    text = [np.array([word or "" for word in column], dtype=np.str_) for column in columns[:6]]
    values = np.empty((len(rows), len(names)), dtype=np.float32)
    if rows:
        values[:] = np.stack(columns[6])
        bits = np.frombuffer(b"".join(columns[7]), dtype=np.uint8).reshape(len(rows), -1)
        values[np.unpackbits(bits, axis=1, count=len(names)).astype(bool)] = np.nan
    ids, labels, origins, axes, gearboxes, samples = text
    return CaseTable(version, extractor_version, names, ids, labels, origins, axes, gearboxes, samples, values)


def _statement(extractor_version: str, since: int) -> Select[*tuple[Any, ...]]:
    columns = (
        Case.id,
        Case.label,
        Case.origin,
        StoredRecording.axis,
        StoredRecording.gearbox,
        StoredRecording.samples_sha256,
        FeatureRow.finite,
        FeatureRow.missing,
    )
    searchable = (Case.state == "confirmed") & Case.quarantine_reason.is_(None)
    return (
        select(*columns)
        .join(StoredRecording, StoredRecording.id == Case.recording_id)
        .join(FeatureRow, FeatureRow.recording_id == Case.recording_id)
        .where(searchable, FeatureRow.extractor_version == extractor_version, Case.library_version > since)
        .order_by(Case.id)
    )


def _merged(kept: CaseTable, changed: CaseTable) -> CaseTable:
    order = np.argsort(np.concatenate([kept.ids, changed.ids]), kind="stable")
    text = [np.concatenate(pair)[order] for pair in zip(kept.text, changed.text, strict=True)]
    return kept.with_columns(changed.version, text, np.concatenate([kept.values, changed.values])[order])


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
        self._root = np.sqrt(metric.weights)
        self._gappy = bool(self.missing.any())
        self.matrix = np.where(self.missing, 0.0, scaled * self._root).astype(np.float32)
        self._offsets: dict[bytes, NDArray[np.float32]] = {}

    def search(self, query: NDArray[np.floating], k: int, *, where: Mask | None = None) -> tuple[Match, ...]:
        """Return the k nearest cases, nearest first, equal ones by id.

        Args:
            query: features, shape (n,), NaN where missing.
            k: how many at most.
            where: shape (cases,), the cases that may be found; all by default.
        """
        rows, sums, parts = self._nearest(query, k, where)
        return tuple(
            self._match(int(row), part, float(total)) for row, part, total in zip(rows, parts, sums, strict=True)
        )

    def nearest_rows(
        self, query: NDArray[np.floating], k: int, *, where: Mask | None = None
    ) -> tuple[NDArray[np.intp], Floats]:
        """Return the rows of the k nearest cases and their distances, without saying why; else as `search`."""
        rows, sums, _ = self._nearest(query, k, where)
        return rows, np.sqrt(sums)

    def nearest_of_many(self, queries: NDArray[np.floating], k: int) -> tuple[NDArray[np.intp], Floats]:
        """Return rows and distances of the k nearest cases of many queries, shape (queries, min(k, cases)) each.

        Args:
            queries: shape (queries, n), no feature missing.
        """
        points = self.metric.scaled(queries) * self._root
        present = np.ones(points.shape[1], dtype=bool)
        squares = (-2.0 * points).astype(np.float32) @ self.matrix.T
        squares += self._offset(present)
        k = min(k, squares.shape[1])
        bounds = np.partition(_block_minima(squares, k), k - 1, axis=1)[:, k - 1]
        bounds = bounds + self._rounding(np.einsum("ij,ij->i", points, points) + np.abs(bounds))
        asked, rows = np.nonzero(squares <= bounds[:, None])
        differences = self.matrix[rows].astype(np.float64) - points.astype(np.float32)[asked]
        sums = np.einsum("ij,ij->i", differences, differences)
        if self._gappy:
            sums += self.missing[rows] @ self.metric.weights
        order = np.lexsort((rows, sums, asked))
        first = np.searchsorted(asked, np.arange(len(points)))[:, None] + np.arange(k)
        return rows[order[first]], np.sqrt(sums[order[first]])

    def _nearest(
        self, query: NDArray[np.floating], k: int, where: Mask | None
    ) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return rows, squared distances and their parts, nearest first."""
        present = np.isfinite(query)
        point, factor = self._point(query, present)
        squares = self._squares(point, present)
        if where is not None:
            squares = np.where(where, squares, np.float32(np.inf))
        rows = self._candidates(squares, k, point)
        if where is not None:
            rows = rows[where[rows]]
        parts = self._parts(point, present, rows) * factor
        sums = parts.sum(axis=1)
        order = np.argsort(sums, kind="stable")[:k]
        return rows[order], sums[order], parts[order]

    def squared_distances(self, query: NDArray[np.floating]) -> Floats:
        """Return the squared distance to every case, shape (cases,), to float32 accuracy."""
        present = np.isfinite(query)
        point, factor = self._point(query, present)
        squares = self._squares(point, present).astype(np.float64) + float(point @ point)
        return np.maximum(squares * factor, 0.0)

    def _point(self, query: NDArray[np.floating], present: Mask) -> tuple[Floats, float]:
        """Return the query times the roots of the weights, zero where missing, and what brings weights to 1."""
        point = self.metric.scaled(query) * self._root
        if present.all():
            return point, 1.0
        weight = float(self.metric.weights[present].sum())
        return np.where(present, point, 0.0), (1.0 / weight if weight > 0 else 0.0)

    def _squares(self, point: Floats, present: Mask) -> NDArray[np.float32]:
        squares: NDArray[np.float32] = self.matrix @ (-2.0 * point).astype(np.float32)
        squares += self._offset(present)
        return squares

    def _offset(self, present: Mask) -> NDArray[np.float32]:
        """Return |x|^2 plus what missing features are expected to add, over the features present in the query."""
        key = present.tobytes()
        offset = self._offsets.get(key)
        if offset is None:
            lengths = np.einsum("ij,ij,j->i", self.matrix, self.matrix, present.astype(np.float32))
            expected = self.missing @ (self.metric.weights * present)
            offset = (lengths + expected).astype(np.float32)
            if len(self._offsets) > 16:
                self._offsets.clear()
            self._offsets[key] = offset
        return offset

    def _candidates(self, squares: NDArray[np.float32], k: int, point: Floats) -> NDArray[np.intp]:
        """Return rows, in order, among which are the k nearest whatever float32 rounded off."""
        if squares.size <= k:
            return np.arange(squares.size)
        bound = float(np.partition(_block_minima(squares[None], k)[0], k - 1)[k - 1])
        return np.flatnonzero(squares <= bound + self._rounding(float(point @ point) + abs(bound)))

    def _rounding(self, size: Any) -> Any:
        """Return what float32 may have rounded off a squared distance among terms of this size."""
        return 4.0 * EPSILON * math.sqrt(len(self.metric.names)) * (2.0 * size + 1.0)

    def _parts(self, point: Floats, present: Mask, rows: NDArray[np.intp]) -> Floats:
        parts = self.matrix[rows].astype(np.float64)
        parts -= point.astype(np.float32)
        parts *= parts
        if self._gappy:
            parts += self.missing[rows] * self.metric.weights
        if not present.all():
            parts *= present
        return parts

    def _match(self, row: int, parts: Floats, square: float) -> Match:
        distance = math.sqrt(square)
        shares = parts / distance if distance > 0 else np.zeros_like(parts)
        contributions = dict(zip(self.table.names, shares.tolist(), strict=True))
        return Match(
            case_id=str(self.table.ids[row]),
            label=str(self.table.labels[row]),
            origin=str(self.table.origins[row]),
            distance=math.fsum(contributions.values()),
            contributions=contributions,
            row=row,
        )


def _block_minima(squares: NDArray[np.float32], k: int) -> NDArray[np.float32]:
    """Return minima over blocks, the k-th smallest of which bounds the k-th smallest of all; few are left as they are.

    Args:
        squares: shape (queries, cases).
    """
    count = squares.shape[1]
    if count < BLOCK * max(k, 4):
        return squares
    whole = count - count % BLOCK
    return np.asarray(squares[:, :whole].reshape(len(squares), -1, BLOCK).min(axis=2))
