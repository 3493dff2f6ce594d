"""Axes by name: their descriptions, revision by revision, and what else knows of them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches

from sqlalchemy import Exists, delete, exists, or_, select
from sqlalchemy.orm import Session

from casebase.errors import ConflictError
from casebase.origins import is_retired
from casebase.store import audit, revisions
from casebase.store.models import AxisRevision, StoredInvestigation, StoredRecording

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


def remove_axis(session: Session, name: str) -> None:
    """Remove all revisions of an axis that no recording and no investigation names.

    Raises:
        NotFoundError: if there is no such axis.
        ConflictError: if one names it.
    """
    row = get_axis(session, name)
    if session.scalar(select(or_(*_named(name)))):
        raise ConflictError(f"axis {name!r} is named by recordings or investigations, so it stays")
    session.execute(delete(AxisRevision).where(AxisRevision.name == name))
    audit.record(session, "axis.removed", ("axis", name), before={"revision": row.revision})


def is_axis(session: Session, name: str) -> bool:
    """Whether an axis is known by this name: described, investigated, or named by a recording."""
    return bool(session.scalar(select(or_(exists().where(AxisRevision.name == name), *_named(name)))))


def _named(name: str) -> tuple[Exists, ...]:
    """Whether recordings, and whether investigations name an axis."""
    return exists().where(StoredRecording.axis == name), exists().where(StoredInvestigation.axis == name)


def unknown_axis(session: Session, name: str) -> str:
    """Say that there is no axis of a name, which known one may be meant, and which are described."""
    described = [row.name for row in list_axes(session)]
    known = f"described are {', '.join(described[:SHOWN])}" if described else "none is described yet"
    near = near_names(name, axis_names(session))
    meant = f"; near it is {' or '.join(map(repr, near))}" if near else ""
    return f"no axis is known as {name!r}{meant}; {known}{' and others' if len(described) > SHOWN else ''}"


def near_names(name: str, known: Iterable[str]) -> list[str]:
    """Return known names that a new one may be a misspelling of; another number is another thing.

    >>> near_names("Pres-4", ["press-3", "press-4", "lift-4"]), near_names("g8", ["g7"])
    (['press-4'], [])
    """
    alike = {_letters(one): one for one in known if re.findall(r"\d+", one) == re.findall(r"\d+", name)}
    return [alike[letters] for letters in get_close_matches(_letters(name), alike)]


def _letters(name: str) -> str:
    return re.sub(r"[\W\d_]", "", name.lower())


def axis_names(session: Session) -> Sequence[str]:
    """Return the names of the axes that are described or that recordings name."""
    recorded = select(StoredRecording.axis).where(StoredRecording.axis.is_not(None), ~is_retired())
    return session.scalars(select(AxisRevision.name).union(recorded)).all()


def list_axes(session: Session) -> Sequence[AxisRevision]:
    """Return the current revision of every axis, by name."""
    return revisions.current(session, AxisRevision)
