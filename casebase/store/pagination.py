"""Lists in pages by key: no page ever skips or repeats a row."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from sqlalchemy import ColumnElement, Select, String, or_
from sqlalchemy.orm import InstrumentedAttribute, Session

from casebase.errors import InvalidCursorError, InvalidRequestError

Row = TypeVar("Row")
Item = TypeVar("Item")
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
    _check_limit(limit)
    if cursor is not None:
        statement = statement.where(key < check_cursor(cursor))
    rows = session.scalars(statement.order_by(key.desc()).limit(limit + 1)).unique().all()
    return cut(rows, limit, lambda row: str(getattr(row, key.key)))


def searched(
    session: Session,
    statement: Select[Any],
    columns: Sequence[ColumnElement[Any]],
    words: Sequence[Sequence[str]],
    *,
    by: ColumnElement[Any] | None,
    first: int,
    most: int,
) -> Sequence[Any]:
    """Return the rows after the first ones, by a column, or else the newest first.

    Args:
        words: of each, one spelling stands in one of the columns of text.
    """
    key, wanted = statement.column_descriptions[0]["entity"].id, statement
    texts = [column for column in columns if isinstance(column.type, String)]
    for spellings in words:
        wanted = wanted.where(or_(*(text.icontains(one, autoescape=True) for text in texts for one in spellings)))
    order = (key.desc(),) if by is None else (by.nulls_last(), key.desc())
    # ids alone are sorted: a row may have a long document
    ids = session.scalars(wanted.with_only_columns(key).order_by(*order).offset(first).limit(most)).all()
    rows = session.scalars(statement.where(key.in_(ids))).unique()
    return sorted(rows, key=lambda row: ids.index(row.id))


def page_upwards(
    session: Session, statement: Select[Row], key: InstrumentedAttribute[Any], *, limit: int, after: object
) -> Page[Row]:
    """Return the page of rows above this value of a key, all from the lowest where it is None, in ascending order."""
    _check_limit(limit)
    if after is not None:
        statement = statement.where(key > after)
    rows = session.scalars(statement.order_by(key).limit(limit + 1)).unique().all()
    return cut(rows, limit, lambda row: str(getattr(row, key.key)))


def cut(rows: Sequence[Item], limit: int, cursor_of: Callable[[Item], str]) -> Page[Item]:
    """Return a page of rows of which, if there are more, one more than the limit was fetched."""
    items = rows[:limit]
    return Page(items, cursor_of(items[-1]) if len(rows) > limit else None)


def check_cursor(cursor: str) -> str:
    """Return a cursor that is an id; raises InvalidCursorError."""
    if len(cursor) != 32 or not set(cursor) <= set("0123456789abcdef"):
        raise InvalidCursorError("this cursor was not made here; leave it out to start at the first page")
    return cursor


def _check_limit(limit: int) -> None:
    if not 1 <= limit <= LARGEST_PAGE:
        raise InvalidRequestError(f"limit must be 1 to {LARGEST_PAGE}, got {limit}")
