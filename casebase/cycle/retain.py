"""Retain: a recording is kept, and becomes a case; what is there already is not made twice."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.description import Labelling, RecordingDescription
from casebase.diagnoses import get_diagnosis, labelling_from
from casebase.errors import DuplicateError
from casebase.origins import SIMULATED, origin_of
from casebase.recordings import store_recording
from casebase.sounds import cases_of, other_gearbox
from casebase.store import audit
from casebase.store.audio_store import AudioStore, Content
from casebase.store.counter import count_change
from casebase.store.models import Case, StoredRecording, now
from signals.features import Extraction
from signals.recording import Recording

RETAINED, TAKEN_BACK = "case.retained", "case.taken_back"


class Retain:
    """Adds to the library."""

    def __init__(self, audio: AudioStore) -> None:
        self._audio = audio

    def recording(
        self,
        session: Session,
        source: Path | bytes | Content,
        recording: Recording,
        extraction: Extraction,
        description: RecordingDescription,
    ) -> StoredRecording:
        """Keep a recording, its rows and its file. The same again is the one that is there.

        Args:
            source: the file as it came, bytes or path, or what `audio.content` has read already.
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
        twins = cases_of(session, recording.sound_id)
        undone = [case for case in twins if is_undone(session, case)]
        existing = _existing(session, recording, labelling, [case for case in twins if case not in undone])
        if existing is not None:
            return existing
        fields = asdict(labelling) | {"parameters": dict(labelling.parameters)}
        for case in undone:
            if case.recording_id == recording.id:
                return _kept_again(session, case, fields | {"diagnosis_id": diagnosis_id})
        case = Case(
            recording=recording,
            diagnosis_id=diagnosis_id,
            labelled_by=audit.actor_of(session),
            library_version=count_change(session),
            **fields,
        )
        session.add(case)
        session.flush()
        audit.record(session, RETAINED, ("case", case.id), after=kept_document(case))
        return case

    def diagnosis(
        self,
        session: Session,
        diagnosis_id: str,
        *,
        label: str | None = None,
        verified_by: str | None = None,
        verification: str | None = None,
    ) -> Case:
        """Make a case of a diagnosed recording, with the label it was revised to unless another is given."""
        row = get_diagnosis(session, diagnosis_id)
        labelling = labelling_from(row, label=label, verified_by=verified_by, verification=verification)
        return self.case(session, row.recording, labelling, diagnosis_id=row.id)


def _existing(session: Session, recording: StoredRecording, labelling: Labelling, twins: Sequence[Case]) -> Case | None:
    if labelling.key is not None:
        case = session.scalars(select(Case).where(Case.key == labelling.key)).first()
        if case is not None:
            return case
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


def is_undone(session: Session, case: Case) -> bool:
    """Whether it was taken back that this case was kept: it is then as if it had never been."""
    return case.state == "retired" and audit.history(session, "case", case.id)[-1].action == TAKEN_BACK


def take_back(session: Session, case: Case) -> None:
    """Take back that a case was kept: it is in no search any more, and the same recording can be kept anew."""
    case.library_version, case.state, case.updated_at = count_change(session), "retired", now()
    session.flush()


def _kept_again(session: Session, case: Case, fields: Mapping[str, object]) -> Case:
    before = kept_document(case)
    for name, value in fields.items():
        setattr(case, name, value)
    case.labelled_by, case.updated_at = audit.actor_of(session), now()
    case.library_version = count_change(session)
    session.flush()
    audit.record(session, RETAINED, ("case", case.id), before=before, after=kept_document(case))
    return case


def kept_document(case: Case) -> dict[str, object]:
    """Return what the audit says of a case that is kept, JSON."""
    return {
        "label": case.label,
        "origin": case.origin,
        "state": case.state,
        "recording_id": case.recording_id,
        "verified_by": case.verified_by,
        "verification": case.verification,
        "key": case.key,
    }
