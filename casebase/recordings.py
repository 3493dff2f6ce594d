"""Recordings and their features as rows; a missing feature is a bit beside its vector, for databases take no NaN."""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Select, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from casebase.description import RecordingDescription
from casebase.sounds import find_sound, keep_sound
from casebase.store import audit
from casebase.store.audio_store import AudioStore, Content
from casebase.store.database import strict_json
from casebase.store.models import Extractor, FeatureRow, StoredInvestigation, StoredJob, StoredRecording, new_id, now
from signals.features import Extraction, FeatureVector
from signals.fingerprint import fingerprints
from signals.recording import Recording

IMPORTS = "imports"
"""Kind of the jobs that import bundles."""
DISCARDED = "discarded_files"
"""In a session's `info`: hashes of the files that are to go when it is committed."""


def store_recording(
    session: Session,
    audio: AudioStore,
    source: Path | bytes | Content,
    recording: Recording,
    extraction: Extraction,
    description: RecordingDescription,
) -> StoredRecording:
    """Keep a recording; see `Retain.recording`."""
    content = source if isinstance(source, Content) else audio.content(source)
    document = description.to_document()
    fingerprint = _fingerprint(content.sha256, recording.channel, document)
    existing = session.scalar(select(StoredRecording).where(StoredRecording.fingerprint == fingerprint))
    if existing is not None:
        store_features(session, existing, extraction)
        if existing.erased_at is None:
            audio.keep(session, content)
        return existing
    condition = description.condition
    prints = fingerprints(recording)
    identity = new_id()
    sound_id = find_sound(session, audio, recording, prints) or identity
    erased = session.scalars(erased_bytes(content.sha256).limit(1)).first()
    row = StoredRecording(
        id=identity,
        sound_id=sound_id,
        fingerprint=fingerprint,
        samples_sha256=recording.sha256,
        file_sha256=content.sha256,
        file_name=description.file_name[-255:],
        media_type=description.media_type[:100],
        byte_count=content.byte_count,
        sample_rate_hz=recording.sample_rate_hz,
        channel=recording.channel,
        channels=recording.channels,
        duration_s=recording.duration_s,
        unit=recording.unit,
        usable=extraction.usable,
        quality=[flag.to_document() for flag in extraction.quality],
        axis=description.axis,
        gearbox=description.gearbox,
        payload_kg_m2=condition.payload_kg_m2,
        speed_rad_s=condition.speed_rad_s,
        recorded_at=description.recorded_at,
        description=document,
        created_by=audit.actor_of(session),
        erased_at=erased and erased.erased_at,
        erased_by=erased and erased.erased_by,
    )
    _know_extractor(session, extraction)
    try:
        with session.begin_nested():
            session.add_all((row, _feature_row(row.id, extraction)))
            keep_sound(session, row, prints)
    except IntegrityError:
        # somebody stored the same at the same time
        return session.scalars(select(StoredRecording).where(StoredRecording.fingerprint == fingerprint)).one()
    audit.record(session, "recording.stored", ("recording", row.id), after={"file_sha256": content.sha256})
    if erased is None:
        audio.keep(session, content)
    return row


def erased_bytes(file_sha256: str) -> Select[StoredRecording]:
    """Return the statement that selects the recordings of a file whose audio was erased."""
    return select(StoredRecording).where(
        StoredRecording.file_sha256 == file_sha256, StoredRecording.erased_at.is_not(None)
    )


def unspoken(session: Session, hashes: Collection[str], *recordings: ColumnElement[bool]) -> list[str]:
    """Return those of some files that no row speaks of.

    Args:
        recordings: which ones are looked at; all by default.
    """
    spoken = set(session.scalars(select(StoredRecording.file_sha256).where(*recordings)))
    for inputs in session.scalars(select(StoredInvestigation.inputs)):
        for part in inputs.values():
            files = part if isinstance(part, list) else [part]
            spoken |= {str(file["sha256"]) for file in files if isinstance(file, dict)}
    spoken.update(bundles_under_way(session))
    return [sha256 for sha256 in hashes if sha256 not in spoken]


def bundles_under_way(session: Session) -> list[str]:
    """Return the file of each import that is not over, or that was cancelled less than a day ago and may be resumed."""
    resumable = (StoredJob.state == "cancelled") & (StoredJob.finished_at > now() - timedelta(days=1))
    return _bundles(session, StoredJob.finished_at.is_(None) | resumable)


def bundles_left(session: Session, audio: AudioStore) -> list[str]:
    """Return the files of imports that are over which are still there."""
    return [each for each in _bundles(session, StoredJob.finished_at.is_not(None)) if audio.path_of(each).is_file()]


def _bundles(session: Session, jobs: ColumnElement[bool]) -> list[str]:
    parameters = session.scalars(select(StoredJob.parameters).where(StoredJob.kind == IMPORTS, jobs))
    return [str(asked["sha256"]) for asked in parameters]


def store_features(session: Session, row: StoredRecording, extraction: Extraction) -> FeatureRow:
    """Keep the features of one extractor version; they are there once."""
    version = extraction.extractor_version
    existing = session.get(FeatureRow, (row.id, version))
    if existing is not None:
        return existing
    _know_extractor(session, extraction)
    features = _feature_row(row.id, extraction)
    session.add(features)
    session.flush()
    return features


def _know_extractor(session: Session, extraction: Extraction) -> None:
    version = extraction.extractor_version
    if session.get(Extractor, version) is None:
        # somebody may make it known at the same time
        with suppress(IntegrityError), session.begin_nested():
            session.add(Extractor(version=version, names=list(extraction.features.names)))


def _feature_row(recording_id: str, extraction: Extraction) -> FeatureRow:
    values = np.asarray(extraction.features.values, dtype=np.float32)
    missing = ~np.isfinite(values)
    return FeatureRow(
        recording_id=recording_id,
        extractor_version=extraction.extractor_version,
        finite=np.where(missing, np.float32(0), values),
        missing=np.packbits(missing).tobytes(),
        motion=asdict(extraction.motion),
        events=[dict(vars(event)) for event in extraction.events],
    )


def named_features(row: FeatureRow, names: Sequence[object]) -> dict[str, float | None]:
    """Return the features of one stored row by name, None where missing."""
    return FeatureVector(tuple(map(str, names)), feature_values([row.finite], [row.missing])[0]).to_dict()


def feature_values(finite: Sequence[NDArray[np.float32]], missing: Sequence[bytes]) -> NDArray[np.float32]:
    """Return the features of stored rows, shape (rows, n), NaN where missing.

    Args:
        finite, missing: `FeatureRow.finite` and `FeatureRow.missing` of every row, at least one.
    """
    values = np.array(finite, dtype=np.float32)
    bits = np.frombuffer(b"".join(missing), dtype=np.uint8).reshape(len(values), -1)
    values[np.unpackbits(bits, axis=1, count=values.shape[1]).astype(bool)] = np.nan
    return values


def _fingerprint(file_sha256: str, channel: int, document: Mapping[str, object]) -> str:
    how_taken = {name: value for name, value in document.items() if name not in ("file_name", "media_type")}
    parts = (file_sha256, str(channel), strict_json(dict(sorted(how_taken.items()))))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
