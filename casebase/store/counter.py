"""The counter that goes up with every change of the cases: by it every process sees that something changed."""

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from casebase.store.models import LibraryCounter

_CHANGED = "library_changed"


def library_version(session: Session) -> int:
    """Return the counter."""
    return session.scalars(select(LibraryCounter.value)).one()


def lock(session: Session) -> None:
    """Let nobody else name a file, store a recording or erase one until the transaction ends."""
    session.scalars(select(LibraryCounter.value).with_for_update()).one()


def count_change(session: Session) -> int:
    """Count up, so that every process sees at its next query that something changed; return the new count."""
    session.info[_CHANGED] = True
    counter = update(LibraryCounter).values(value=LibraryCounter.value + 1)
    return session.scalars(counter.returning(LibraryCounter.value)).one()


def has_changed(session: Session) -> bool:
    """Return whether this session changed cases: what it sees may yet be rolled back, and must not be remembered."""
    return _CHANGED in session.info
