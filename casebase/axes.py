"""Axes by name: their descriptions, revision by revision, and what else knows of them."""

from collections.abc import Mapping, Sequence

from sqlalchemy import exists, or_, select
from sqlalchemy.orm import Session

from casebase import revisions
from casebase.models import AxisRevision, StoredInvestigation, StoredRecording

SHOWN = 10
"""Names of axes that are told, at most."""


def add_axis(
    session: Session,
    name: str,
    document: Mapping[str, object],
    *,
    note: str | None = None,
    investigation_id: str | None = None,
    based_on: int | None = None,
) -> AxisRevision:
    """Store a description as the next revision, as `revisions.add`."""
    return revisions.add(
        session, AxisRevision, name, {"document": dict(document)},
        note=note, investigation_id=investigation_id, based_on=based_on,
    )  # fmt: skip


def find_axis(session: Session, name: str) -> AxisRevision | None:
    """Return the current revision, or None."""
    return revisions.find(session, AxisRevision, name)


def get_axis(session: Session, name: str, revision: int | None = None) -> AxisRevision:
    """Return one revision, the current one by default; raises NotFoundError."""
    return revisions.get(session, AxisRevision, name, revision)


def is_axis(session: Session, name: str) -> bool:
    """Whether an axis is known by this name: described, investigated, or named by a recording."""
    known = (
        exists().where(AxisRevision.name == name),
        exists().where(StoredRecording.axis == name),
        exists().where(StoredInvestigation.axis == name),
    )
    return bool(session.scalar(select(or_(*known))))


def unknown_axis(session: Session, name: str) -> str:
    """Say that there is no axis of a name, and which are described."""
    described = [row.name for row in list_axes(session)]
    known = f"described are {', '.join(described[:SHOWN])}" if described else "none is described yet"
    return f"no axis is known as {name!r}; {known}{' and others' if len(described) > SHOWN else ''}"


def list_axes(session: Session) -> Sequence[AxisRevision]:
    """Return the current revision of every axis, by name."""
    return revisions.current(session, AxisRevision)
