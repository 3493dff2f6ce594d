"""A changed extractor: features are computed again from the audio; those of the old version stay beside them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sqlalchemy import exists, func, select, update
from sqlalchemy.orm import Session

from casebase import audit
from casebase.description import condition_of
from casebase.errors import NotFoundError
from casebase.library import CaseLibrary
from casebase.models import Case, FeatureRow, StoredRecording
from casebase.recordings import store_features
from casebase.signals.decode import read_recording
from casebase.signals.errors import SignalError
from casebase.signals.features import EXTRACTOR_VERSION, extract


@dataclass(frozen=True)
class Renewed:
    """How many recordings got new features, and why others did not: id -> reason."""

    recordings: int
    failed: dict[str, str]


def outdated(session: Session) -> Sequence[str]:
    """Return ids of the recordings that have no features of the present extractor, oldest first."""
    has = exists().where(
        FeatureRow.recording_id == StoredRecording.id, FeatureRow.extractor_version == EXTRACTOR_VERSION
    )
    return session.scalars(select(StoredRecording.id).where(~has).order_by(StoredRecording.id)).all()


def count_outdated(session: Session) -> int:
    """Return how many recordings have no features of the present extractor: their cases are not searched."""
    has = exists().where(
        FeatureRow.recording_id == StoredRecording.id, FeatureRow.extractor_version == EXTRACTOR_VERSION
    )
    return session.scalars(select(func.count()).select_from(StoredRecording).where(~has)).one()


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
        except (SignalError, NotFoundError) as error:
            failed[recording_id] = str(error)
        progress(number + 1, len(waiting))
    return Renewed(len(waiting) - len(failed), failed)


def _renew_one(library: CaseLibrary, actor: str, recording_id: str) -> None:
    with library.reading() as session:
        row = library.recording(session, recording_id)
    recording = read_recording(library.audio_path(row), channel=row.channel)
    extraction = extract(recording, condition_of(row.description))
    with library.transaction(actor) as session:
        row = library.recording(session, recording_id)
        store_features(session, row, extraction)
        version = library.next_version(session)
        session.execute(
            update(Case).where(Case.recording_id == recording_id).values(library_version=version, version=Case.version)
        )
        after = {"extractor_version": extraction.extractor_version}
        audit.record(session, "recording.renewed", ("recording", recording_id), after=after)
