"""Where a sound comes from: what was simulated once stays simulated, whoever sends it and under whatever name."""

from collections.abc import Sequence

from sqlalchemy import ColumnElement, and_, exists, select
from sqlalchemy.orm import Session, aliased

from casebase.store.models import Artifact, Case, StoredDiagnosis, StoredRecording

MEASURED, SIMULATED = "measured", "simulated"
DEMO = "demo"
"""Kind of the artifact that names the diagnosis and the recording of the demonstration, which is simulated."""


def simulated(session: Session, recordings: Sequence[StoredRecording]) -> frozenset[str]:
    """Return ids of those recordings whose sound is that of a simulated case, retired or not, or of the demonstration.

    The same sound in another container, rate, gain or coding is the same sound.
    """
    ids = [row.id for row in recordings]
    known = select(StoredRecording.id).where(StoredRecording.id.in_(ids), *is_measured(session))
    return frozenset(ids) - set(session.scalars(known))


def measured(session: Session, recordings: Sequence[StoredRecording]) -> list[StoredRecording]:
    """Return those of the recordings that are not simulated, in their order."""
    known = simulated(session, recordings)
    return [row for row in recordings if row.id not in known]


def is_measured(session: Session) -> tuple[ColumnElement[bool], ...]:
    """Return conditions that leave of all recordings those that `measured` leaves."""
    shown = demonstrations(session)
    same = aliased(StoredRecording)
    is_same = (same.sound_id == StoredRecording.sound_id, same.sound_id != "")
    return (
        ~exists().where(Case.recording_id == StoredRecording.id, Case.origin == SIMULATED),
        ~exists().where(*is_same, Case.recording_id == same.id, Case.origin == SIMULATED),
        StoredRecording.id.not_in(shown),
        ~exists().where(*is_same, same.id.in_(shown)),
    )


def is_retired() -> ColumnElement[bool]:
    """Return the condition that a recording came as a case that counts no more, and was never diagnosed."""
    here, diagnosed = Case.recording_id == StoredRecording.id, StoredDiagnosis.recording_id == StoredRecording.id
    counts = exists().where(here, Case.state != "retired")
    return and_(exists().where(here), ~counts, ~exists().where(diagnosed))


def origin_of(session: Session, recording: StoredRecording) -> str:
    """Return whether a recording was measured or simulated, as far as that is known."""
    return SIMULATED if simulated(session, [recording]) else MEASURED


def demonstrations(session: Session) -> list[str]:
    """Return ids of the recordings of the demonstration, whose sound is simulated."""
    shown = session.scalars(select(Artifact.content).where(Artifact.kind == DEMO))
    return [str(content["recording_id"]) for content in shown]
