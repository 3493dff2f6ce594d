"""What was learned, version by version: which one is active, how well it did, and the way back."""

from collections.abc import Mapping, Sequence

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
    after: int | None = None,
) -> Artifact:
    """Store the next version of a kind and make it the active one.

    Args:
        after: the version that was the newest when the work began; IntegrityError if another one came in between.
    """
    newest = newest_version(session, kind) if after is None else after
    _deactivate(session, kind)
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


def newest_version(session: Session, kind: str) -> int:
    """Return the highest version of a kind, 0 if there is none."""
    return session.scalar(select(func.max(Artifact.version)).where(Artifact.kind == kind)) or 0


def active_artifact(session: Session, kind: str) -> Artifact | None:
    """Return the active version of a kind, or None."""
    return session.scalar(select(Artifact).where(Artifact.kind == kind, Artifact.active))


def list_artifacts(session: Session, kind: str) -> Sequence[Artifact]:
    """Return all versions of a kind, newest first."""
    return session.scalars(select(Artifact).where(Artifact.kind == kind).order_by(Artifact.version.desc())).all()


def _deactivate(session: Session, kind: str) -> None:
    session.execute(update(Artifact).where(Artifact.kind == kind, Artifact.active).values(active=False))
