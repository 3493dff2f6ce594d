"""What an older version left: features and fingerprints are taken again from the audio; old features stay beside."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sqlalchemy import ColumnElement, exists, func, select, update
from sqlalchemy.orm import Session

from casebase import audit
from casebase.counter import count_change
from casebase.description import condition_of
from casebase.errors import ErasedError, NotFoundError
from casebase.library import CaseLibrary
from casebase.models import Case, FeatureRow, StoredRecording
from casebase.recordings import store_features
from casebase.signals.decode import read_recording
from casebase.signals.errors import SignalError
from casebase.signals.features import EXTRACTOR_VERSION, extract
from casebase.signals.fingerprint import fingerprints
from casebase.sounds import join_sounds, keep_sound


@dataclass(frozen=True)
class Renewed:
    """How many recordings got new features or a fingerprint, and why others did not: id -> reason."""

    recordings: int
    failed: dict[str, str]


def outdated(session: Session) -> Sequence[str]:
    """Return ids of the recordings without features of the present extractor or without fingerprint, oldest first."""
    return session.scalars(select(StoredRecording.id).where(_LEFT).order_by(StoredRecording.id)).all()


def count_outdated(session: Session) -> int:
    """Return how many of those have their audio: their cases are not searched, or their copies not known."""
    return _count(session, _LEFT & StoredRecording.erased_at.is_(None))


def count_left_behind(session: Session) -> int:
    """Return how many recordings have no features of the present extractor and no audio to take them from any more."""
    return _count(session, ~_FEATURES & StoredRecording.erased_at.is_not(None))


def _count(session: Session, which: ColumnElement[bool]) -> int:
    return session.scalars(select(func.count()).select_from(StoredRecording).where(which)).one()


_FEATURES = exists().where(
    FeatureRow.recording_id == StoredRecording.id, FeatureRow.extractor_version == EXTRACTOR_VERSION
)
_LEFT = ~_FEATURES | StoredRecording.sound.is_(None)


def renew(
    library: CaseLibrary, actor: str, *, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> Renewed:
    """Extract again what is outdated, each recording in a transaction of its own; can be broken off and resumed."""
    with library.reading() as session:
        waiting = outdated(session)
    failed: dict[str, str] = {}
    for number, recording_id in enumerate(waiting):
        try:
            _renew_one(library, actor, recording_id)
        except (SignalError, NotFoundError, ErasedError) as error:
            failed[recording_id] = str(error)
            _leave_without_fingerprint(library, actor, recording_id)
        progress(number + 1, len(waiting))
    return Renewed(len(waiting) - len(failed), failed)


def _renew_one(library: CaseLibrary, actor: str, recording_id: str) -> None:
    with library.reading() as session:
        row = library.retrieve.recording(session, recording_id)
    recording = read_recording(library.retrieve.audio_path(row), channel=row.channel)
    with library.reading() as session:
        known = session.get(FeatureRow, (recording_id, EXTRACTOR_VERSION)) is not None
    extraction = None if known else extract(recording, condition_of(row.description))
    prints = fingerprints(recording)
    with library.transaction(actor) as session:
        row = library.retrieve.recording(session, recording_id)
        changed = list(join_sounds(session, library.audio, row, recording, prints)) if row.sound is None else []
        if extraction is not None:
            store_features(session, row, extraction)
            changed += session.scalars(select(Case.id).where(Case.recording_id == recording_id))
            after = {"extractor_version": extraction.extractor_version}
            audit.record(session, "recording.renewed", ("recording", recording_id), after=after)
        if changed:
            version = count_change(session)
            session.execute(
                update(Case).where(Case.id.in_(changed)).values(library_version=version, version=Case.version)
            )


def _leave_without_fingerprint(library: CaseLibrary, actor: str, recording_id: str) -> None:
    """What cannot be read has no fingerprint, and is not tried again for one."""
    with library.transaction(actor) as session:
        row = library.retrieve.recording(session, recording_id)
        if row.sound is None:
            keep_sound(session, row, ())
