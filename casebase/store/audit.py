"""Who did what: every change of the library leaves one row that nobody can alter."""

from collections.abc import Iterable, Mapping, Sequence
from contextvars import ContextVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.store.models import AuditEntry

ACTOR, REQUEST, RECORDED = "actor", "request_id", "recorded"
STORED: ContextVar[list[str] | None] = ContextVar("stored", default=None)
"""Where somebody wants to know it: the actions that were stored for good since then, of whichever thread."""


def record(
    session: Session,
    action: str,
    subject: tuple[str, str],
    *,
    before: Mapping[str, object] | None = None,
    after: Mapping[str, object] | None = None,
) -> None:
    """Add an entry for a subject (kind, id) in the session's name."""
    session.info.setdefault(RECORDED, []).append(action)
    session.add(
        AuditEntry(
            actor=actor_of(session),
            action=action,
            subject_kind=subject[0],
            subject_id=subject[1],
            before=dict(before or {}),
            after=dict(after or {}),
            request_id=session.info.get(REQUEST),
        )
    )


def stored(actions: Iterable[str]) -> None:
    """Note that these actions are stored for good, for whoever has to say later whether anything was."""
    found = STORED.get()
    if found is not None:
        found.extend(actions)


def actor_of(session: Session) -> str:
    """Return in whose name the session acts."""
    return str(session.info[ACTOR])


def history(session: Session, kind: str, subject_id: str) -> Sequence[AuditEntry]:
    """Return all entries of a subject, oldest first."""
    statement = select(AuditEntry).where(AuditEntry.subject_kind == kind, AuditEntry.subject_id == subject_id)
    return session.scalars(statement.order_by(AuditEntry.id)).all()


def entries(session: Session, *, limit: int = 100, before_id: int | None = None) -> Sequence[AuditEntry]:
    """Return the newest entries, or those before an id."""
    statement = select(AuditEntry).order_by(AuditEntry.id.desc()).limit(limit)
    if before_id is not None:
        statement = statement.where(AuditEntry.id < before_id)
    return session.scalars(statement).all()
