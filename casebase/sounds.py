"""Which recordings are of one sound: known by equal samples, or by fingerprints that differ in few bits and phases that
agree; by the fingerprints alone where the audio of one was erased.

Whatever asks whether something is the same (a case that is there already, a copy that must not count twice, a query
that the library knows) asks for `StoredRecording.sound_id`.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from sqlalchemy import insert, select
from sqlalchemy.orm import Session, undefer

from casebase.store.audio_store import AudioStore
from casebase.store.counter import lock
from casebase.store.models import Case, SoundKey, StoredRecording
from signals.errors import SignalError
from signals.fingerprint import LARGEST_DIFFERENCE, Fingerprint, Words, difference, same_samples
from signals.reading.decode import read_recording
from signals.recording import Recording

MOST_HELD_AGAINST = 256
"""Of the recordings that share a word; those that share most come first."""
MOST_DECODED = 4
"""Of those whose fingerprints differ in few bits; those that differ least."""


def find_sound(session: Session, audio: AudioStore, recording: Recording, prints: Sequence[Fingerprint]) -> str | None:
    """Return the `sound_id` of a recording that sounds the same; None if there is none.

    Nobody else stores a recording until the transaction ends, so that of two of one sound the second sees the first.

    Args:
        prints: what `fingerprints` says of it.
    """
    lock(session)
    equal = select(StoredRecording.sound_id).where(StoredRecording.samples_sha256 == recording.sha256)
    found = session.scalars(equal.order_by(StoredRecording.id).limit(1)).first()
    if found is not None:
        return found
    alike = (row for row in _alike(session, prints) if _has_samples(row, audio, recording))
    return next((row.sound_id for row in alike), None)


def _has_samples(row: StoredRecording, audio: AudioStore, recording: Recording) -> bool:
    """Whether its audio is that of a recording, or cannot be read."""
    try:
        return same_samples(recording, read_recording(audio.path_of(row.file_sha256), channel=row.channel))
    except (SignalError, FileNotFoundError):
        return True


def _alike(session: Session, prints: Sequence[Fingerprint]) -> list[StoredRecording]:
    words = {word for each in prints for word in each.keys}
    holding = select(SoundKey.recording_id).where(SoundKey.word.in_(sorted(words)))
    candidates = Counter(session.scalars(holding))
    likely = [identity for identity, _ in candidates.most_common(MOST_HELD_AGAINST)]
    statement = select(StoredRecording).where(StoredRecording.id.in_(likely)).options(undefer(StoredRecording.sound))
    known = {row.id: row for row in session.scalars(statement)}
    bits = {
        row.id: min(difference(each.words, _words(row.sound)) for each in prints)
        for identity in likely
        if (row := known[identity]).sound
    }
    nearest = sorted((each for each in bits if bits[each] <= LARGEST_DIFFERENCE), key=bits.__getitem__)
    return [known[each] for each in nearest[:MOST_DECODED]]


def keep_sound(session: Session, row: StoredRecording, prints: Sequence[Fingerprint]) -> None:
    """Keep what a recording is looked up by from now on."""
    row.sound = prints[0].words.astype("<u4").tobytes() if prints else b""
    session.flush()
    if prints and prints[0].keys:
        keys = [{"word": word, "recording_id": row.id} for word in prints[0].keys]
        session.execute(insert(SoundKey), keys)


def cases_of(session: Session, sound_id: str) -> Sequence[Case]:
    """Return the cases of a sound, retired ones too, oldest first."""
    statement = select(Case).join(StoredRecording, StoredRecording.id == Case.recording_id)
    return session.scalars(statement.where(StoredRecording.sound_id == sound_id).order_by(Case.id)).all()


def other_gearbox(one: StoredRecording, other: StoredRecording) -> bool:
    """Return whether two recordings are said to be of different gearboxes; one that was not told differs from none."""
    return None not in (one.gearbox, other.gearbox) and one.gearbox != other.gearbox


def _words(sound: bytes) -> Words:
    return np.frombuffer(sound, dtype="<u4")
