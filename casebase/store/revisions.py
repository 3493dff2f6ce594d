"""Descriptions that are kept revision by revision: of axes and of robots, by name."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from casebase.description import check_name
from casebase.errors import ConflictError, NotFoundError
from casebase.store import audit
from casebase.store.models import AxisRevision, RobotRevision
from casebase.store.pagination import Page, page_upwards

Revision = TypeVar("Revision", AxisRevision, RobotRevision)


def add(
    session: Session,
    kind: type[Revision],
    name: str,
    content: Mapping[str, object],
    *,
    note: str | None = None,
    investigation_id: str | None = None,
    based_on: int | None = None,
) -> Revision:
    """Store a description as the next revision; the same `content` (by column) again is no new one.

    Raises:
        ConflictError: if `based_on` is given and is not the current revision.
        InvalidRequestError: if a new one has a name that cannot stand in an address.
    """
    current = find(session, kind, name)
    if current is None:
        check_name("name", name)
    if based_on is not None and (current is None or current.revision != based_on):
        have = "none" if current is None else str(current.revision)
        raise ConflictError(f"{kind.noun} {name!r} is at revision {have}, not {based_on}; look at it and try again")
    if current is not None and all(getattr(current, column) == value for column, value in content.items()):
        return current
    row = kind(
        name=name,
        revision=1 if current is None else current.revision + 1,
        note=note,
        investigation_id=investigation_id,
        created_by=audit.actor_of(session),
        **content,
    )
    session.add(row)
    session.flush()
    audit.record(session, f"{kind.noun}.revised", (kind.noun, name), after={"revision": row.revision, "note": note})
    return row


def find(session: Session, kind: type[Revision], name: str) -> Revision | None:
    """Return the current revision, or None."""
    statement = select(kind).where(kind.name == name)
    return session.scalar(statement.order_by(kind.revision.desc()).limit(1))


def get(session: Session, kind: type[Revision], name: str, revision: int | None = None) -> Revision:
    """Return one revision, the current one by default; raises NotFoundError."""
    row = find(session, kind, name) if revision is None else session.get(kind, (name, revision))
    if row is None:
        raise NotFoundError(
            f"no {kind.noun} {name!r} at revision {revision or 'current'}; POST /{kind.__tablename__} adds one"
        )
    return row


def current(session: Session, kind: type[Revision], *, names: Sequence[str] | None = None) -> Sequence[Revision]:
    """Return the current revision of every name, or of these, by name."""
    wanted = _current(kind) if names is None else _current(kind).where(kind.name.in_(names))
    return session.scalars(wanted.order_by(kind.name)).all()


def current_page(
    session: Session, kind: type[Revision], *, limit: int = 50, cursor: str | None = None
) -> Page[Revision]:
    """Return a page of the current revisions, by name; the cursor is the last name of the page before."""
    return page_upwards(session, _current(kind), kind.name, limit=limit, after=cursor)


def history(session: Session, kind: type[Revision], name: str) -> Sequence[Revision]:
    """Return all revisions of a name, oldest first."""
    return session.scalars(select(kind).where(kind.name == name).order_by(kind.revision)).all()


def history_page(
    session: Session, kind: type[Revision], name: str, *, limit: int = 50, cursor: int | None = None
) -> Page[Revision]:
    """Return a page of a name's revisions, oldest first; the cursor is the last revision of the page before."""
    statement = select(kind).where(kind.name == name)
    return page_upwards(session, statement, kind.revision, limit=limit, after=cursor)


def _current(kind: type[Revision]) -> Select[Revision]:
    newest = select(kind.name, func.max(kind.revision).label("revision"))
    latest = newest.group_by(kind.name).subquery()
    return select(kind).join(latest, (kind.name == latest.c.name) & (kind.revision == latest.c.revision))
