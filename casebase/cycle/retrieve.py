"""Retrieve: recordings and cases as they are stored, the table of cases, and its searches with any weights."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from casebase.errors import ErasedError, NotFoundError
from casebase.reasoning.plausibility import Expected, measured
from casebase.search.case_filter import CaseFilter, selected
from casebase.search.case_table import CaseTable, load_table
from casebase.search.retrieval import CaseMatrix, metric_of
from casebase.search.similarity import Floats
from casebase.store import audit
from casebase.store.audio_store import AudioStore
from casebase.store.counter import has_changed, library_version
from casebase.store.models import AuditEntry, Case, FeatureRow, StoredRecording
from casebase.store.pagination import Page, page
from signals.features import EXTRACTOR_VERSION

MATRICES_KEPT = 4


class Retrieve:
    """Reads what is stored; the table of cases and what was measured of an axis are kept until cases change."""

    def __init__(self, audio: AudioStore) -> None:
        self._audio = audio
        self._tables: dict[str, CaseTable] = {}
        self._measured: dict[str, tuple[int, Expected]] = {}
        self._matrices: tuple[CaseMatrix, ...] = ()

    def recording(self, session: Session, recording_id: str) -> StoredRecording:
        """Return a recording; raises NotFoundError."""
        row = session.get(StoredRecording, recording_id)
        if row is None:
            raise NotFoundError(f"no recording has the id {recording_id!r}")
        return row

    def audio_path(self, row: StoredRecording) -> Path:
        """Return the file of a recording as it came in.

        Raises:
            ErasedError: if it was erased.
            NotFoundError: if it is missing.
            DamagedError: if its bytes are not those that came in.
        """
        if row.erased_at is not None:
            raise ErasedError(
                f"the audio of this recording was erased on {row.erased_at:%Y-%m-%d} by {row.erased_by}; its features, "
                "diagnoses and cases are still here"
            )
        return self._audio.whole(row.file_sha256)

    def features(self, session: Session, row: StoredRecording) -> FeatureRow:
        """Return the features of a recording; raises NotFoundError if they are not of the present extractor."""
        stored = session.get(FeatureRow, (row.id, EXTRACTOR_VERSION))
        if stored is None:
            raise NotFoundError(
                "The features of this recording are of an older extractor; `gearcase doctor` says what to do."
            )
        return stored

    def case(self, session: Session, case_id: str) -> Case:
        """Return a case, retired ones too; raises NotFoundError."""
        row = session.get(Case, case_id)
        if row is None:
            raise NotFoundError(f"no case has the id {case_id!r}")
        return row

    def cases(self, session: Session, wanted: CaseFilter, *, limit: int = 50, cursor: str | None = None) -> Page[Case]:
        """Return a page of cases, newest first."""
        return page(session, selected(wanted), Case.id, limit=limit, cursor=cursor)

    def history(self, session: Session, case_id: str) -> Sequence[AuditEntry]:
        """Return all that happened to a case, oldest first; raises NotFoundError."""
        return audit.history(session, "case", self.case(session, case_id).id)

    def counts(self, session: Session) -> Mapping[tuple[str, str], int]:
        """Return how many searchable cases there are per label and origin."""
        statement = select(Case.label, Case.origin, func.count()).where(
            Case.state == "confirmed", Case.quarantine_reason.is_(None)
        )
        rows = session.execute(statement.group_by(Case.label, Case.origin)).all()
        return {(label, origin): count for label, origin, count in rows}

    def table(self, session: Session, extractor_version: str = EXTRACTOR_VERSION) -> CaseTable:
        """Return all cases that count as they are now, copies once; only what changed is read."""
        return self.all_cases(session, extractor_version).voters

    def all_cases(self, session: Session, extractor_version: str = EXTRACTOR_VERSION) -> CaseTable:
        """Return the same with copies and with cases whose sound is a case of another label too."""
        table = load_table(session, extractor_version, self._tables.get(extractor_version))
        if not has_changed(session):
            self._tables[extractor_version] = table
        return table

    def matrix(self, session: Session, weights: Floats) -> CaseMatrix:
        """Return the cases of `table`, at least one, ready to be searched with these weights of their features.

        Scales are those of all cases. The last few are kept until cases change.
        """
        table = self.table(session)
        current = tuple(matrix for matrix in self._matrices if matrix.table is table)
        shares = weights / weights.sum()
        kept = next((matrix for matrix in current if np.array_equal(matrix.metric.weights, shares)), None)
        if kept is not None:
            return kept
        metric = current[0].metric.with_weights(weights) if current else metric_of(table, weights)
        made = CaseMatrix(table, metric)
        if not has_changed(session):
            self._matrices = (*current, made)[-MATRICES_KEPT:]
        return made

    def measured(self, session: Session, axis: str) -> Expected:
        """Return what the measured cases of an axis say of its motion; read again when cases have changed."""
        version = library_version(session)
        kept = self._measured.get(axis)
        if kept is not None and kept[0] == version:
            return kept[1]
        found = measured(session, axis)
        if found != Expected() and not has_changed(session):
            self._measured[axis] = (version, found)
        return found
