"""Steps that people take in the library, and how each is taken back: a verdict, a case kept, a change of cases.

The audit has what stood before each step. Taking a step back writes that again and is an entry of its own: nothing is
ever lost from the audit. Steps are taken back in the opposite order, so that what is written is what stood there.
"""

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.cycle.retain import RETAINED, TAKEN_BACK, kept_document, take_back
from casebase.cycle.revise import CHANGED
from casebase.diagnoses import REVISED, get_diagnosis, restore_revision, revision_document
from casebase.errors import ConflictError, NotFoundError
from casebase.store import audit
from casebase.store.counter import count_change
from casebase.store.models import AuditEntry, Case, new_id, now

KINDS = (REVISED, RETAINED, CHANGED)
UNDONE = "step.taken_back"
TOGETHER = "step-"
"""What the request of a step is called whose entries are taken back together."""

Subject = tuple[str, str]


def step_name() -> str:
    """Return a name for a transaction whose changes are one step."""
    return f"{TOGETHER}{new_id()}"


def last_step(session: Session, subjects: Sequence[Subject]) -> AuditEntry | None:
    """Return the newest step with any of these subjects that was not taken back; None where there is none."""
    steps = [step for subject in subjects for step in standing(session, subject)]
    return max(steps, key=lambda step: step.id, default=None)


def newest_of(session: Session, name: str) -> int | None:
    """Return the id of the last entry of a step by its name; None where it changed nothing."""
    return session.scalar(
        select(AuditEntry.id)
        .where(AuditEntry.request_id == name, AuditEntry.action.in_(KINDS))
        .order_by(AuditEntry.id.desc())
        .limit(1)
    )


def undo(session: Session, entry_id: int) -> list[AuditEntry]:
    """Take a step back, with all that was done together with it; return what was taken back, the newest first.

    Raises:
        NotFoundError: if there is no such step.
        ConflictError: if it was taken back already, or something of it was changed again since; nothing changes then.
    """
    entries = entries_of(session, entry_id)
    if not entries:
        raise NotFoundError(f"no step has the number {entry_id}")
    for one in entries:
        steps = standing(session, (one.subject_kind, one.subject_id))
        if not stands(session, one):
            raise ConflictError("this step was taken back already")
        if steps[-1].id != one.id:
            raise ConflictError(
                f"{one.subject_kind} {one.subject_id} was changed again after this step: take the later one back first"
            )
        before, after = _taken_back(session, one)
        subject = (one.subject_kind, one.subject_id)
        action = TAKEN_BACK if one.action == RETAINED else UNDONE
        audit.record(session, action, subject, before=before, after={**after, "step": one.id})
        session.flush()
    return entries


def entries_of(session: Session, entry_id: int) -> list[AuditEntry]:
    """Return an entry of the audit with all that was done together with it, newest first; none if it is no step."""
    entry = session.get(AuditEntry, entry_id)
    if entry is None or entry.action not in KINDS:
        return []
    if not (entry.request_id or "").startswith(TOGETHER):
        return [entry]
    statement = select(AuditEntry).where(AuditEntry.request_id == entry.request_id, AuditEntry.action.in_(KINDS))
    return list(session.scalars(statement.order_by(AuditEntry.id.desc())))


def stands(session: Session, entry: AuditEntry) -> bool:
    """Return whether a step was not taken back."""
    return entry.id in {step.id for step in standing(session, (entry.subject_kind, entry.subject_id))}


def standing(session: Session, subject: Subject) -> list[AuditEntry]:
    """Return the steps with a subject (kind, id) that were not taken back, oldest first."""
    steps: dict[object, AuditEntry] = {}
    for entry in audit.history(session, *subject):
        if entry.action in KINDS:
            steps[entry.id] = entry
        elif entry.action in (TAKEN_BACK, UNDONE):
            steps.pop(entry.after.get("step"), None)
    return list(steps.values())


def _taken_back(session: Session, step: AuditEntry) -> tuple[dict[str, object], dict[str, object]]:
    """Write again what stood before a step; return what it replaced and what it is now."""
    if step.action == REVISED:
        row = get_diagnosis(session, step.subject_id)
        before = revision_document(row)
        restore_revision(session, row, step.before)
        return before, revision_document(row)
    case = session.get(Case, step.subject_id)
    assert case is not None, "a case is never deleted"
    if step.action == RETAINED:
        before = kept_document(case)
        take_back(session, case)
        return before, kept_document(case)
    before = {name: getattr(case, name) for name in step.before}
    case.library_version, case.updated_at = count_change(session), now()
    for name, value in step.before.items():
        setattr(case, name, value)
    session.flush()
    return before, dict(step.before)
