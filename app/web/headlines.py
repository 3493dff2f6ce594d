"""What investigations found, in a line each, without their documents: those are long, and lists show many."""

from collections.abc import Sequence

from sqlalchemy import ColumnElement, Select, select
from sqlalchemy.orm import Session, defer

from casebase.store.models import StoredInvestigation

Headlined = tuple[StoredInvestigation, str | None]
_DOCUMENT = StoredInvestigation.document


def light() -> Select[StoredInvestigation]:
    """Select investigations without their documents."""
    return select(StoredInvestigation).options(defer(_DOCUMENT))


def headlined(session: Session, rows: Sequence[StoredInvestigation]) -> list[Headlined]:
    """Return each of them with what it found; None with those that found nothing yet."""
    ids = [row.id for row in rows]
    asked = select(StoredInvestigation.id, _DOCUMENT["story", "headline"].as_string())
    asked = asked.where(StoredInvestigation.id.in_(ids))
    told = {identity: headline.removesuffix(".") for identity, headline in session.execute(asked) if headline}
    return [(row, told.get(row.id)) for row in rows]


def newest(session: Session, most: int, *where: ColumnElement[bool]) -> list[Headlined]:
    """Return the newest investigations of which all this holds, with what each found."""
    statement = light().where(*where).order_by(StoredInvestigation.id.desc()).limit(most)
    return headlined(session, session.scalars(statement).all())
