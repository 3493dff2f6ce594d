"""Lists in pages by key: newest first, no page ever skips or repeats a row."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from sqlalchemy import Select
from sqlalchemy.orm import InstrumentedAttribute, Session

from casebase.errors import InvalidCursorError, InvalidRequestError

Row = TypeVar("Row")
LARGEST_PAGE = 1000


@dataclass(frozen=True)
class Page(Generic[Row]):
    """Some rows and the cursor that continues after them; None when there are no more."""

    items: Sequence[Row]
    next_cursor: str | None


def page(
    session: Session,
    statement: Select[Row],
    key: InstrumentedAttribute[str],
    *,
    limit: int = 50,
    cursor: str | None = None,
) -> Page[Row]:
    """Return the page after the cursor, in descending order of an id."""
    if not 1 <= limit <= LARGEST_PAGE:
        raise InvalidRequestError(f"limit must be 1 to {LARGEST_PAGE}, got {limit}")
    if cursor is not None:
        statement = statement.where(key < _checked(cursor))
    rows = session.scalars(statement.order_by(key.desc()).limit(limit + 1)).unique().all()
    items = rows[:limit]
    more = len(rows) > limit
    return Page(items, str(getattr(items[-1], key.key)) if more else None)


def _checked(cursor: str) -> str:
    if len(cursor) != 32 or not set(cursor) <= set("0123456789abcdef"):
        raise InvalidCursorError("this cursor was not made here; leave it out to start at the newest")
    return cursor
