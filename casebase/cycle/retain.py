"""Retain: a recording is kept, and becomes a case; what is there already is not made twice."""

from dataclasses import asdict, replace
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase import audit
from casebase.audio_store import AudioStore, StoredBytes
from casebase.counter import count_change
from casebase.description import Labelling, RecordingDescription
from casebase.diagnoses import get_diagnosis, labelling_from
from casebase.errors import DuplicateError
from casebase.models import Case, StoredRecording
from casebase.origins import SIMULATED, origin_of
from casebase.recordings import store_recording
from casebase.signals.features import Extraction
from casebase.signals.recording import Recording
from casebase.sounds import cases_of, other_gearbox


class Retain:
    """Adds to the library."""

    def __init__(self, audio: AudioStore) -> None:
        self._audio = audio

    def recording(
        self,
        session: Session,
        source: Path | bytes | StoredBytes,
        recording: Recording,
        extraction: Extraction,
        description: RecordingDescription,
    ) -> StoredRecording:
        """Keep a recording: audio on disk first, then its rows. The same again is the one that is there.

        Args:
            source: the file as it came, bytes or path, or what `audio.put` of it has said already.
            recording: what was decoded from it.
            extraction: its features.
            description: how it was taken.
        """
        return store_recording(session, self._audio, source, recording, extraction, description)

    def case(
        self,
        session: Session,
        recording: StoredRecording,
        labelling: Labelling,
        *,
        diagnosis_id: str | None = None,
    ) -> Case:
        """Make a case of a recording. The same sound with the same label and gearbox is the case that is there.

        A simulated sound makes a simulated case, whoever brings it.

        Raises:
            DuplicateError: if the sound is a case already with another label or gearbox, or a retired one.
        """
        if origin_of(session, recording) == SIMULATED:
            labelling = replace(labelling, origin=SIMULATED)
        existing = _existing(session, recording, labelling)
        if existing is not None:
            return existing
        fields = asdict(labelling) | {"parameters": dict(labelling.parameters)}
        case = Case(
            recording=recording,
            diagnosis_id=diagnosis_id,
            labelled_by=audit.actor_of(session),
            library_version=count_change(session),
            **fields,
        )
        session.add(case)
        session.flush()
        audit.record(session, "case.retained", ("case", case.id), after=_summary(case))
        return case

    def diagnosis(
        self, session: Session, diagnosis_id: str, *, label: str | None = None, verified_by: str | None = None
    ) -> Case:
        """Make a case of a diagnosed recording, with the label it was revised to unless another is given."""
        row = get_diagnosis(session, diagnosis_id)
        labelling = labelling_from(row, label=label, verified_by=verified_by)
        return self.case(session, row.recording, labelling, diagnosis_id=row.id)


def _existing(session: Session, recording: StoredRecording, labelling: Labelling) -> Case | None:
    if labelling.key is not None:
        case = session.scalars(select(Case).where(Case.key == labelling.key)).first()
        if case is not None:
            return case
    twins = cases_of(session, recording.sound_id)
    if labelling.key is not None:
        # what is generated is known by its key
        twins = [case for case in twins if case.recording_id == recording.id]
    for case in twins:
        agrees = (case.label, case.origin) == (labelling.label, labelling.origin)
        if agrees and case.state != "retired" and not other_gearbox(case.recording, recording):
            return case
    if not twins:
        return None
    case = min(twins, key=lambda each: each.state == "retired")
    box = case.recording.gearbox
    state = "" if case.state == "confirmed" else f", {case.state}"
    raise DuplicateError(
        f"this sound is case {case.id} already ({case.label}, gearbox {box or 'not given'}{state}); "
        "change that case if it is wrong",
        case_id=case.id,
        label=case.label,
        gearbox=box,
    )


def _summary(case: Case) -> dict[str, object]:
    return {
        "label": case.label,
        "origin": case.origin,
        "state": case.state,
        "recording_id": case.recording_id,
        "verified_by": case.verified_by,
        "key": case.key,
    }
