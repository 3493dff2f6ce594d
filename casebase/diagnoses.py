"""Diagnoses that were given: kept, listed, and confirmed, corrected or rejected by a person."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from typing import Any

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from casebase.alarms import rules
from casebase.description import Labelling, check_choice, check_label, check_verification
from casebase.errors import ConflictError, InvalidRequestError, NotFoundError, StaleVersionError
from casebase.reasoning.detection_limit import NO_LIMITS, Limits
from casebase.reasoning.diagnosis import Diagnosis, Reasoner
from casebase.reasoning.severity import Severity
from casebase.store import audit
from casebase.store.models import DIAGNOSIS_STATES, StoredDiagnosis, StoredRecording, new_id, now
from casebase.store.pagination import Page, page

REVISED = "diagnosis.revised"


@dataclass(frozen=True)
class DiagnosisFilter:
    """Which diagnoses to list; absent means any."""

    verdict: str | None = None
    label: str | None = None
    state: str | None = None
    axis: str | None = None
    gearbox: str | None = None


def store_diagnosis(
    session: Session,
    recording: StoredRecording,
    diagnosis: Diagnosis,
    reasoner: Reasoner,
    severity: Severity | None = None,
    detection_limit: Limits = NO_LIMITS,
    same_as_case: str | None = None,
) -> StoredDiagnosis:
    """Keep a diagnosis as the document that it is shown as.

    Args:
        detection_limit: the smallest fault of each kind that would be heard; see `casebase.reasoning.detection_limit`.
        same_as_case: id of the case that is of the same sound.
    """
    identity = new_id()
    document = {
        "id": identity,
        **diagnosis.to_document(),
        "detection_limit": {label: limit and dict(limit) for label, limit in detection_limit.items()},
        "severity": None if severity is None else severity.to_document(),
        "recording": {**recording_document(recording), "same_as_case": same_as_case},
        "provenance": provenance(reasoner, recording.axis),
    }
    row = StoredDiagnosis(
        id=identity,
        recording=recording,
        verdict=diagnosis.verdict,
        label=diagnosis.label,
        probability=diagnosis.probability,
        document=document,
        created_by=audit.actor_of(session),
    )
    session.add(row)
    session.flush()
    after = {"verdict": diagnosis.verdict, "label": diagnosis.label, "recording_id": recording.id}
    audit.record(session, "diagnosis.given", ("diagnosis", row.id), after=after)
    rules.review(session, recording.axis, recording.gearbox)
    return row


def recording_document(row: StoredRecording) -> dict[str, object]:
    """Return what a diagnosis says of its recording, SI, JSON."""
    return {
        "id": row.id,
        "file_name": row.file_name,
        "samples_sha256": row.samples_sha256,
        "sample_rate_hz": row.sample_rate_hz,
        "channel": row.channel,
        "channels": row.channels,
        "duration_s": row.duration_s,
        "unit": row.unit,
        "axis": row.axis,
        "gearbox": row.gearbox,
        "payload_kg_m2": row.payload_kg_m2,
        "speed_rad_s": row.speed_rad_s,
        "recorded_at": None if row.recorded_at is None else row.recorded_at.isoformat(),
    }


def provenance(reasoner: Reasoner, axis: str | None) -> dict[str, object]:
    """Return what a diagnosis was made with, and how well that did on gearboxes it had not seen."""
    table = reasoner.table
    return {
        "gearcase": version("gearcase"),
        "extractor_version": table.extractor_version,
        "library_version": table.version,
        "cross_validated_accuracy": reasoner.accuracy(axis) if len(table) else None,
        "cases": {
            "measured": int((table.origins == "measured").sum()),
            "simulated": int((table.origins == "simulated").sum()),
        },
        "gearboxes": len(table.gearboxes_known),
        "given_at": now().isoformat(),
    }


def get_diagnosis(session: Session, diagnosis_id: str) -> StoredDiagnosis:
    """Return a diagnosis; raises NotFoundError."""
    row = session.get(StoredDiagnosis, diagnosis_id)
    if row is None:
        raise NotFoundError(f"no diagnosis has the id {diagnosis_id!r}")
    return row


def diagnoses_of(wanted: DiagnosisFilter) -> Select[StoredDiagnosis]:
    """Return the statement that selects diagnoses, with their recordings."""
    statement = select(StoredDiagnosis).join(StoredRecording, StoredRecording.id == StoredDiagnosis.recording_id)
    for column, value in (
        (StoredDiagnosis.verdict, wanted.verdict),
        (StoredDiagnosis.label, wanted.label),
        (StoredDiagnosis.state, wanted.state),
        (StoredRecording.axis, wanted.axis),
        (StoredRecording.gearbox, wanted.gearbox),
    ):
        if value is not None:
            statement = statement.where(column == value)
    return statement


def list_diagnoses(
    session: Session, wanted: DiagnosisFilter, *, limit: int = 50, cursor: str | None = None
) -> Page[StoredDiagnosis]:
    """Return a page of diagnoses, newest first."""
    return page(session, diagnoses_of(wanted), StoredDiagnosis.id, limit=limit, cursor=cursor)


def revise_diagnosis(
    session: Session,
    diagnosis_id: str,
    verdict: str,
    *,
    label: str | None = None,
    verified_by: str | None = None,
    verification: str | None = None,
    note: str | None = None,
    expected_version: int | None = None,
) -> StoredDiagnosis:
    """Say what became of a diagnosis: confirmed, corrected (with the right label), rejected, or open again.

    Raises:
        InvalidRequestError: if `corrected` has no label, another verdict has one that contradicts it, or the
            verification is none.
        StaleVersionError: if the diagnosis is not at the expected version.
    """
    check_choice("verdict", verdict, DIAGNOSIS_STATES)
    check_verification(verification)
    row = get_diagnosis(session, diagnosis_id)
    if expected_version is not None and row.version != expected_version:
        raise StaleVersionError(
            f"diagnosis {diagnosis_id} is at version {row.version}, not {expected_version}; read it again"
        )
    revised = _revised_label(row, verdict, label)
    before = revision_document(row)
    row.state, row.revised_label, row.verified_by, row.note = verdict, revised, verified_by, note
    row.verification, row.revised_by, row.revised_at = verification, audit.actor_of(session), now()
    session.flush()
    audit.record(session, REVISED, ("diagnosis", row.id), before=before, after=revision_document(row))
    rules.review(session, row.recording.axis, row.recording.gearbox)
    return row


def revision_document(row: StoredDiagnosis) -> dict[str, object]:
    """Return what a person said of a diagnosis, JSON: all that a revision changes."""
    return {
        "state": row.state,
        "label": row.revised_label,
        "verified_by": row.verified_by,
        "verification": row.verification,
        "note": row.note,
        "by": row.revised_by,
        "at": None if row.revised_at is None else row.revised_at.isoformat(),
    }


def restore_revision(session: Session, row: StoredDiagnosis, document: Mapping[str, Any]) -> None:
    """Make it again what a person said of a diagnosis."""
    row.state, row.revised_label, row.verified_by = document["state"], document["label"], document["verified_by"]
    row.verification, row.note, row.revised_by = document["verification"], document["note"], document["by"]
    row.revised_at = None if document["at"] is None else datetime.fromisoformat(document["at"])
    session.flush()
    rules.review(session, row.recording.axis, row.recording.gearbox)


def _revised_label(row: StoredDiagnosis, verdict: str, label: str | None) -> str | None:
    if verdict == "corrected":
        if label is None:
            raise InvalidRequestError("a corrected diagnosis needs the right `label`")
        check_label(label)
        return label
    if verdict == "confirmed":
        if row.label is None:
            raise InvalidRequestError(
                f"this diagnosis says {row.verdict} and names no label to confirm; say `corrected` with a label"
            )
        if label not in (None, row.label):
            raise InvalidRequestError(f"confirmed means {row.label!r}; say `corrected` for {label!r}")
        return row.label
    if label is not None:
        raise InvalidRequestError(f"a label goes with `corrected`, not with {verdict!r}")
    return None


def labelling_from(
    row: StoredDiagnosis,
    *,
    label: str | None = None,
    verified_by: str | None = None,
    verification: str | None = None,
) -> Labelling:
    """Return what the recording of a diagnosis is a case of; by default what the diagnosis was revised to.

    Raises:
        ConflictError: if nobody confirmed or corrected it and no label is given.
    """
    known = label or row.revised_label
    if known is None:
        raise ConflictError("this diagnosis was neither confirmed nor corrected: say which `label` the case has")
    return Labelling(known, verified_by=verified_by or row.verified_by, verification=verification or row.verification)
