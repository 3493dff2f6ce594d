"""Which cases are wanted, and the statement that selects them."""

from dataclasses import dataclass

from sqlalchemy import Select, select

from casebase.store.models import Case, StoredRecording


@dataclass(frozen=True)
class CaseFilter:
    """Which cases to list; absent means any. Retired ones are left out unless asked for."""

    label: str | None = None
    origin: str | None = None
    axis: str | None = None
    gearbox: str | None = None
    state: str | None = None
    batch: str | None = None
    quarantined: bool | None = None
    verification: str | None = None


def selected(wanted: CaseFilter) -> Select[Case]:
    """Return the statement that selects the cases wanted."""
    statement = select(Case).join(StoredRecording, StoredRecording.id == Case.recording_id)
    for column, value in (
        (StoredRecording.axis, wanted.axis),
        (StoredRecording.gearbox, wanted.gearbox),
        (Case.label, wanted.label),
        (Case.origin, wanted.origin),
        (Case.batch, wanted.batch),
        (Case.state, wanted.state),
        (Case.verification, wanted.verification),
    ):
        if value is not None:
            statement = statement.where(column == value)
    if wanted.state is None:
        statement = statement.where(Case.state != "retired")
    if wanted.quarantined is not None:
        reason = Case.quarantine_reason
        statement = statement.where(reason.is_not(None) if wanted.quarantined else reason.is_(None))
    return statement
