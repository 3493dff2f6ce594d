"""The state of a gearbox: what its newest diagnosis says of it, and when it was heard last."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session

from casebase.gearboxes import HEARD_AT
from casebase.models import StoredDiagnosis, StoredRecording
from casebase.origins import demonstrations


@dataclass(frozen=True)
class State:
    """What is known of a gearbox.

    Args:
        faults: labels of the faults that are present, each with its probability.
        size_rad: of the fault that the diagnosis names, at the driven gear [rad]; None where it cannot be said.
        calibrated: whether the probabilities were calibrated on gearboxes.
    """

    axis: str | None
    gearbox: str | None
    diagnosis_id: str
    verdict: str
    faults: tuple[tuple[str, float | None], ...]
    size_rad: float | None
    heard_at: datetime
    calibrated: bool


def state_of(session: Session, axis: str | None, gearbox: str | None) -> State | None:
    """Return the state of a gearbox by its newest diagnosis that nobody rejected; None where there is none.

    The newest is the one of the newest recording, however late that came. What a person said of it counts more than
    what the library said.
    """
    newest = (
        select(StoredDiagnosis, HEARD_AT)
        .join(StoredDiagnosis.recording)
        .where(StoredDiagnosis.state != "rejected")
        .where(StoredRecording.axis == axis, StoredRecording.gearbox == gearbox)
        .order_by(HEARD_AT.desc(), StoredDiagnosis.id.desc())
        .limit(1)
    )
    found = session.execute(newest).unique().first()
    return None if found is None else _state(*found)


def heard_last(
    session: Session, axis: str | None, gearbox: str | None
) -> Iterator[tuple[str | None, str | None, datetime]]:
    """Yield axis, gearbox and when it was heard last of each gearbox that was ever diagnosed.

    Args:
        axis, gearbox: only those of it; of any where None.
    """
    statement = (
        select(StoredRecording.axis, StoredRecording.gearbox, func.max(HEARD_AT))
        .join(StoredDiagnosis, StoredDiagnosis.recording_id == StoredRecording.id)
        .where(or_(StoredRecording.axis.is_not(None), StoredRecording.gearbox.is_not(None)))
        .where(StoredDiagnosis.state != "rejected", StoredRecording.id.not_in(demonstrations(session)))
        .group_by(StoredRecording.axis, StoredRecording.gearbox)
    )
    for column, wanted in ((StoredRecording.axis, axis), (StoredRecording.gearbox, gearbox)):
        if wanted is not None:
            statement = statement.where(column == wanted)
    for each in session.execute(statement):
        yield each[0], each[1], each[2]


def _state(row: StoredDiagnosis, heard_at: datetime) -> State:
    document = row.document
    severity = document.get("severity")
    size_rad = None if severity is None else float(severity["value"])
    common: dict[str, Any] = {
        "axis": row.recording.axis,
        "gearbox": row.recording.gearbox,
        "diagnosis_id": row.id,
        "heard_at": heard_at,
        "calibrated": document["provenance"].get("gearboxes", 0) > 1,
    }
    if row.revised_label is not None:
        size_rad = size_rad if row.revised_label == row.label else None
        return State(verdict="diagnosed", faults=((row.revised_label, 1.0),), size_rad=size_rad, **common)
    faults = tuple((str(each["label"]), each["probability"]) for each in document["faults"])
    return State(verdict=row.verdict, faults=faults, size_rad=size_rad, **common)
