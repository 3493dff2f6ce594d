"""CaseTable: all searchable cases at one version of the library, read from the database, which is the truth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from casebase.recordings import feature_values
from casebase.store.models import Case, Extractor, FeatureRow, LibraryCounter, StoredRecording

Mask = NDArray[np.bool_]
MOST_PARTS = 20
PARTS = 10


@dataclass(frozen=True, eq=False)
class CaseTable:
    """All searchable cases at one version of the library, in order of id; arrays have shape (cases,).

    Args:
        version: the library's counter.
        values: features, shape (cases, n), float32, NaN where missing.
        groups: the gearbox; where it is unknown, and for simulated cases, the case itself.
        samples: the sound (`StoredRecording.sound_id`); cases that share it are copies.
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
    def voters(self) -> "CaseTable":
        """The cases that count: of copies the first, and none where copies are labelled differently."""
        return self if self._counting.all() else self.take(self._counting)

    @property
    def contradicting(self) -> int:
        """How many cases do not count because a copy is labelled differently."""
        return int(np.count_nonzero(self._contradicting))

    @cached_property
    def sounds(self) -> NDArray[np.intp]:
        """Number of every case's sound; cases that share it are copies."""
        return numbered(self.samples)

    @cached_property
    def _first(self) -> NDArray[np.intp]:
        """The first case of every sound."""
        return np.unique(self.sounds, return_index=True)[1]

    @cached_property
    def _contradicting(self) -> Mask:
        if self._first.size == len(self):
            return np.zeros(len(self), dtype=np.bool_)
        return np.isin(self.sounds, self.sounds[self.labels != self.labels[self._first][self.sounds]])

    @cached_property
    def _counting(self) -> Mask:
        counting = np.zeros(len(self), dtype=np.bool_)
        counting[self._first] = True
        return np.asarray(counting & ~self._contradicting)

    @cached_property
    def groups(self) -> NDArray[np.str_]:
        own = (self.gearboxes == "") | (self.origins == "simulated")
        return np.where(own, self.ids, self.gearboxes)

    @cached_property
    def parts(self) -> NDArray[np.intp]:
        """The part that each case is held out with: its gearbox, or a tenth of the gearboxes where they are many.

        Simulated cases are parted by themselves, so that their number changes nothing for the measured ones.
        """
        part = np.zeros(len(self), np.intp)
        measured = self.origins == "measured"
        for kind, first in ((measured, 0), (~measured, MOST_PARTS)):
            own = numbered(self.groups[kind])
            part[kind] = first + (own if own.max(initial=-1) < MOST_PARTS else own % PARTS)
        return part

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """Labels in the library, sorted."""
        return tuple(sorted(set(self.labels.tolist())))

    @cached_property
    def class_numbers(self) -> NDArray[np.int16]:
        """Place of every case's label among the classes."""
        return numbered(self.labels).astype(np.int16)

    @property
    def gearboxes_known(self) -> list[str]:
        """Names of the gearboxes that measured cases come from, sorted."""
        return sorted(set(self.gearboxes[(self.origins == "measured") & (self.gearboxes != "")].tolist()))

    @cached_property
    def by_recording(self) -> "CaseTable":
        """The same cases as if each were of a gearbox of its own."""
        return replace(self, gearboxes=np.full(len(self), "", self.gearboxes.dtype))

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


def numbered(words: NDArray[np.str_]) -> NDArray[np.intp]:
    """Return the place of every word among all of them, sorted, each once; takes a sixth of NumPy's time."""
    found = words.tolist()
    places = {word: place for place, word in enumerate(sorted(dict.fromkeys(found)))}
    return np.fromiter(map(places.__getitem__, found), np.intp, words.size)


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
    values = feature_values(columns[6], columns[7]) if rows else np.empty((0, len(names)), dtype=np.float32)
    ids, labels, origins, axes, gearboxes, samples = text
    return CaseTable(version, extractor_version, names, ids, labels, origins, axes, gearboxes, samples, values)


def _statement(extractor_version: str, since: int) -> Select[*tuple[Any, ...]]:
    columns = (
        Case.id,
        Case.label,
        Case.origin,
        StoredRecording.axis,
        StoredRecording.gearbox,
        StoredRecording.sound_id,
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
