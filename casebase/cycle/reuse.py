"""Reuse: what the cases say of a recording, and how far that can be relied on."""

from dataclasses import replace
from threading import Lock

from sqlalchemy.orm import Session

from casebase.cycle.retrieve import Retrieve
from casebase.diagnoses import store_diagnosis
from casebase.origins import MEASURED, origin_of
from casebase.reasoning.detection_limit import NO_LIMITS, detection_limits
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.evaluation import Evaluation, evaluate, poor_recordings
from casebase.reasoning.severity import Severity, severity_of
from casebase.sounds import cases_of
from casebase.store.counter import has_changed
from casebase.store.models import Case, StoredDiagnosis, StoredRecording
from signals.features import EXTRACTOR_VERSION, Extraction


class Reuse:
    """Diagnoses with the cases as they are now."""

    def __init__(self, retrieve: Retrieve) -> None:
        self._retrieve = retrieve
        self._reasoners: dict[str, Reasoner] = {}
        self._lock = Lock()
        """One at a time makes what diagnoses: the others that need it then find it made."""

    def reasoner(self, session: Session, extractor_version: str = EXTRACTOR_VERSION) -> Reasoner:
        """Return what diagnoses, for the library as it is now; the same one until something changes."""
        with self._lock:
            table = self._retrieve.table(session, extractor_version)
            known = self._reasoners.get(extractor_version)
            if known is not None and known.table is table:
                return known
            reasoner = Reasoner(table)
            if not has_changed(session):
                self._reasoners[extractor_version] = reasoner
            return reasoner

    def fitted(self, session: Session, axis: str | None, gearbox: str | None) -> Reasoner:
        """Return what diagnoses a recording of a gearbox, with all that is fitted for it: it takes long where cases
        changed, and nobody should be kept from writing meanwhile."""
        reasoner = self.reasoner(session)
        reasoner.model(axis, gearbox)
        return reasoner

    def diagnose(
        self,
        session: Session,
        recording: StoredRecording,
        extraction: Extraction,
        remarks: tuple[str, ...] = (),
        reasoner: Reasoner | None = None,
    ) -> StoredDiagnosis:
        """Diagnose a stored recording by its features and keep the diagnosis, with what else is to be remarked.

        A case of the same sound is named, and does not count.

        Args:
            reasoner: as `fitted` returns it, with the library as it was a moment ago; by default as it is now.
        """
        version = extraction.extractor_version
        reasoner = reasoner or self.reasoner(session, version)
        values = extraction.features.values
        copies = reasoner.table.samples == recording.sound_id
        diagnosis = reasoner.diagnose(extraction, copies, recording.axis, recording.gearbox)
        same = [case for case in cases_of(session, recording.sound_id) if case.state != "retired"]
        told = (*(_told(case) for case in same), *diagnosis.remarks, *remarks, *self._contradictions(session, version))
        diagnosis = replace(diagnosis, remarks=told)
        axis, origin = recording.axis, origin_of(session, recording)
        severity = self.severity(session, extraction, axis, diagnosis.label, origin) if diagnosis.label else None
        limits = detection_limits(session, reasoner.table, axis, values, origin) if extraction.usable else NO_LIMITS
        same_as = same[0].id if same else None
        return store_diagnosis(session, recording, diagnosis, reasoner, severity, limits, same_as)

    def severity(
        self, session: Session, extraction: Extraction, axis: str | None, label: str, origin: str = MEASURED
    ) -> Severity | None:
        """Return the size of a fault, for a diagnosis as for `gearcase size`; None where the library cannot say it."""
        table = self._retrieve.table(session, extraction.extractor_version)
        return severity_of(session, table, axis, label, extraction.features.values, origin)

    def evaluate(
        self,
        session: Session,
        *,
        group: str = "gearbox",
        origin: str = "both",
        without: str | None = None,
        axis: str | None = None,
    ) -> Evaluation:
        """Return the library's own cross-validation; see `casebase.reasoning.evaluation.evaluate`.

        Args:
            without: id of a case that the library is to do without.
            axis: whose cases alone are diagnosed.
        """
        table = self._retrieve.table(session)
        if without is not None:
            everything = self._retrieve.all_cases(session)
            table = everything.take(everything.ids != without).voters
        return evaluate(table, group=group, origin=origin, axis=axis, poor=poor_recordings(session))

    def _contradictions(self, session: Session, extractor_version: str) -> tuple[str, ...]:
        count = self._retrieve.all_cases(session, extractor_version).contradicting
        words = f"{count} cases do not count, for their sound is a case of another label too: see the review"
        return (words,) if count else ()


def _told(case: Case) -> str:
    return f"this is case {case.id} ({case.label}, gearbox {case.recording.gearbox or 'not given'})"
