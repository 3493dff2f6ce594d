"""What was learned, version by version: which one is active, how well it did, and the way back."""

from collections.abc import Mapping

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from casebase.store import audit
from casebase.store.models import Artifact


def add_artifact(
    session: Session,
    kind: str,
    content: Mapping[str, object],
    *,
    score: float | None = None,
    score_detail: Mapping[str, object] | None = None,
) -> Artifact:
    """Store the next version of a kind and make it the active one."""
    newest = session.scalar(select(func.max(Artifact.version)).where(Artifact.kind == kind)) or 0
    session.execute(update(Artifact).where(Artifact.kind == kind, Artifact.active).values(active=False))
    row = Artifact(
        kind=kind,
        version=newest + 1,
        content=dict(content),
        score=score,
        score_detail=dict(score_detail or {}),
        active=True,
        created_by=audit.actor_of(session),
    )
    session.add(row)
    session.flush()
    audit.record(session, "artifact.learned", ("artifact", kind), after={"version": row.version, "score": score})
    return row


def active_artifact(session: Session, kind: str) -> Artifact | None:
    """Return the active version of a kind, or None."""
    return session.scalar(select(Artifact).where(Artifact.kind == kind, Artifact.active))
