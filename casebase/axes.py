"""Axis descriptions, revision by revision."""

from collections.abc import Mapping, Sequence

from sqlalchemy import Select, exists, func, or_, select
from sqlalchemy.orm import Session

from casebase import audit
from casebase.description import check_name
from casebase.errors import ConflictError, NotFoundError
from casebase.models import AxisRevision, StoredInvestigation, StoredRecording
from casebase.pages import Page, page_upwards

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
    """Store a description as the next revision; the same document again is no new one.

    Raises:
        ConflictError: if `based_on` is given and is not the current revision.
        InvalidRequestError: if a new axis has a name that cannot stand in an address.
    """
    current = find_axis(session, name)
    if current is None:
        check_name("name", name)
    if based_on is not None and (current is None or current.revision != based_on):
        have = "none" if current is None else str(current.revision)
        raise ConflictError(f"axis {name!r} is at revision {have}, not {based_on}; look at it and try again")
    if current is not None and current.document == dict(document):
        return current
    row = AxisRevision(
        name=name,
        revision=1 if current is None else current.revision + 1,
        document=dict(document),
        note=note,
        investigation_id=investigation_id,
        created_by=audit.actor_of(session),
    )
    session.add(row)
    session.flush()
    audit.record(session, "axis.revised", ("axis", name), after={"revision": row.revision, "note": note})
    return row


def find_axis(session: Session, name: str) -> AxisRevision | None:
    """Return the current revision, or None."""
    statement = select(AxisRevision).where(AxisRevision.name == name)
    return session.scalar(statement.order_by(AxisRevision.revision.desc()).limit(1))


def get_axis(session: Session, name: str, revision: int | None = None) -> AxisRevision:
    """Return one revision, the current one by default; raises NotFoundError."""
    row = find_axis(session, name) if revision is None else session.get(AxisRevision, (name, revision))
    if row is None:
        raise NotFoundError(f"no axis {name!r} at revision {revision or 'current'}; POST /axes adds one")
    return row


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
    return session.scalars(_current().order_by(AxisRevision.name)).all()


def axes_page(session: Session, *, limit: int = 50, cursor: str | None = None) -> Page[AxisRevision]:
    """Return a page of the current revisions, by name; the cursor is the last name of the page before."""
    return page_upwards(session, _current(), AxisRevision.name, limit=limit, after=cursor)


def _current() -> Select[AxisRevision]:
    newest = select(AxisRevision.name, func.max(AxisRevision.revision).label("revision"))
    latest = newest.group_by(AxisRevision.name).subquery()
    joined = (AxisRevision.name == latest.c.name) & (AxisRevision.revision == latest.c.revision)
    return select(AxisRevision).join(latest, joined)


def axis_history(session: Session, name: str) -> Sequence[AxisRevision]:
    """Return all revisions of an axis, oldest first."""
    statement = select(AxisRevision).where(AxisRevision.name == name).order_by(AxisRevision.revision)
    return session.scalars(statement).all()


def history_page(session: Session, name: str, *, limit: int = 50, cursor: int | None = None) -> Page[AxisRevision]:
    """Return a page of an axis' revisions, oldest first; the cursor is the last revision of the page before."""
    statement = select(AxisRevision).where(AxisRevision.name == name)
    return page_upwards(session, statement, AxisRevision.revision, limit=limit, after=cursor)
