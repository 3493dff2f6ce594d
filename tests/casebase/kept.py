"""Recordings of gearboxes as rows, without a sound: what was heard when, with features and a diagnosis."""

from collections.abc import Mapping
from datetime import datetime

import numpy as np
from sqlalchemy.orm import Session

from casebase.labels import BASELINES
from casebase.store.models import Extractor, FeatureRow, StoredDiagnosis, StoredRecording, new_id
from signals.features import EXTRACTOR_VERSION, NAMES

LISTS = ("hypotheses", "labels", "neighbours", "evidence", "remarks", "disturbances", "quality")
UNKNOWN = {"fault": {"present": None, "probability": None}, "novelty": {"distance": None, "threshold": None}}


def keep(
    session: Session,
    axis: str | None,
    gearbox: str | None,
    at: datetime | None,
    features: Mapping[str, float],
    label: str | None = None,
    *,
    verdict: str = "diagnosed",
    state: tuple[float | None, float | None] = (None, None),
    **document: object,
) -> StoredRecording:
    """Store a recording, its features, 0 where none is given, and a diagnosis of it where it has a label or verdict.

    Args:
        document: what else the diagnosis says.
    """
    identity = new_id()
    recording = StoredRecording(
        id=identity,
        fingerprint=identity,
        samples_sha256=identity,
        sound_id=identity,
        file_sha256=identity,
        file_name=f"{gearbox}.wav",
        media_type="audio/wav",
        byte_count=1,
        sample_rate_hz=8000.0,
        channel=0,
        channels=1,
        duration_s=20.0,
        unit="1",
        usable=True,
        quality=[],
        axis=axis,
        gearbox=gearbox,
        speed_rad_s=state[0],
        payload_kg_m2=state[1],
        recorded_at=at,
        description={},
        created_by="test",
    )
    if session.get(Extractor, EXTRACTOR_VERSION) is None:
        session.add(Extractor(version=EXTRACTOR_VERSION, names=list(NAMES)))
    values = np.array([features.get(name, 0.0) for name in NAMES], np.float32)
    row = FeatureRow(recording_id=identity, extractor_version=EXTRACTOR_VERSION, finite=values, motion={}, events=[])
    row.missing = np.packbits(np.zeros(len(NAMES), bool)).tobytes()
    session.add_all((recording, row))
    if label is not None or verdict != "diagnosed":
        said = {"verdict": verdict, "label": label, "probability": 0.95}
        faults = [{"label": label, "probability": 0.95}] if label not in (None, *BASELINES) else []
        document = {**{name: [] for name in LISTS}, **UNKNOWN, "faults": faults, **document}
        document |= {**said, "severity": None, "id": identity, "provenance": {"gearboxes": 5}}
        document["recording"] = {"axis": axis, "gearbox": gearbox}
        given = StoredDiagnosis(
            id=identity, recording=recording, verdict=verdict, label=label, probability=0.95, created_by="test"
        )
        given.document = document
        session.add(given)
    session.flush()
    return recording
