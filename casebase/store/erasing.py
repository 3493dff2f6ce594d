"""Erasing audio: the bytes go, and what shows them; rows, features, diagnoses, cases and the audit stay.

A sound is erased in every file that it came in, and those for all recordings that have them. Bytes that were erased are
not kept again when they come again.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.library import CaseLibrary
from casebase.recordings import DISCARDED
from casebase.store import audit
from casebase.store.counter import lock
from casebase.store.models import Case, StoredRecording, now


@dataclass(frozen=True)
class Erased:
    """What was erased.

    Args:
        recordings: ids of all recordings whose audio is gone.
    """

    id: str
    erased_at: datetime
    erased_by: str
    recordings: tuple[str, ...]


def erase(
    library: CaseLibrary, session: Session, recording_id: str, reason: str = "asked for", *, other_files: bool = True
) -> Erased:
    """Erase the audio of a recording; again changes nothing. The bytes go when the transaction is committed.

    Args:
        other_files: erase the same sound in other containers, rates and gains as well.

    Raises:
        NotFoundError: if there is no such recording.
    """
    lock(session)  # nobody stores the same bytes meanwhile
    row = library.retrieve.recording(session, recording_id)
    alike = StoredRecording.sound_id == row.sound_id if other_files else StoredRecording.id == row.id
    files = select(StoredRecording.file_sha256).where(alike)
    rows = session.scalars(select(StoredRecording).where(StoredRecording.file_sha256.in_(files))).all()
    at, by = now(), audit.actor_of(session)
    for each in rows:
        if each.erased_at is None:
            each.erased_at, each.erased_by = at, by
            after = {"file_sha256": each.file_sha256, "reason": reason}
            audit.record(session, "recording.erased", ("recording", each.id), after=after)
    session.flush()
    session.info.setdefault(DISCARDED, set()).update(each.file_sha256 for each in rows)
    assert row.erased_at is not None
    return Erased(row.id, row.erased_at, row.erased_by or by, tuple(sorted(each.id for each in rows)))


def outlived(session: Session, days: int, keep: Collection[str] = ()) -> Sequence[str]:
    """Return ids of recordings whose audio is older than so many days, one for each file; never the file of a case.

    Args:
        keep: ids of recordings whose files are kept besides.
    """
    kept = select(StoredRecording.file_sha256).where(
        StoredRecording.id.in_(select(Case.recording_id)) | StoredRecording.id.in_(sorted(keep))
    )
    young = select(StoredRecording.file_sha256).where(StoredRecording.created_at >= now() - timedelta(days=days))
    statement = select(StoredRecording.id, StoredRecording.file_sha256).where(
        StoredRecording.erased_at.is_(None),
        StoredRecording.file_sha256.not_in(kept),
        StoredRecording.file_sha256.not_in(young),
    )
    first = {sha256: identity for identity, sha256 in session.execute(statement.order_by(StoredRecording.id.desc()))}
    return sorted(first.values())


def expire(library: CaseLibrary, actor: str, days: int, keep: Collection[str] = ()) -> list[str]:
    """Erase what has outlived so many days, each file in a transaction of its own; return ids of the recordings.

    Files that were to go with an earlier erasure, and were left by a crash, go as well.
    """
    with library.reading() as session:
        waiting = outlived(session, days, keep)
    gone: list[str] = []
    for recording_id in waiting:
        with library.transaction(actor) as session:
            if not _is_case(session, recording_id):  # it may have become one meanwhile
                gone += erase(library, session, recording_id, f"kept for {days} days", other_files=False).recordings
    discard_left(library)
    return gone


def _is_case(session: Session, recording_id: str) -> bool:
    own = select(StoredRecording.file_sha256).where(StoredRecording.id == recording_id).scalar_subquery()
    same = select(Case.id).join(StoredRecording, StoredRecording.id == Case.recording_id)
    return session.scalars(same.where(StoredRecording.file_sha256 == own).limit(1)).first() is not None


def discard_left(library: CaseLibrary, *, remove: bool = True) -> int:
    """Return how many files were erased whose bytes a crash left, and delete them unless told not to."""
    with library.reading() as session:
        hashes = session.scalars(
            select(StoredRecording.file_sha256).where(StoredRecording.erased_at.is_not(None)).distinct()
        ).all()
    left = [sha256 for sha256 in hashes if library.audio.path_of(sha256).is_file()]
    if remove:
        for sha256 in left:
            library.audio.discard(sha256)
    return len(left)
