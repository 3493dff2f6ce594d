"""What investigations found, in a line each, without their documents: those are long, and lists show many."""

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import Select, select
from sqlalchemy.orm import Session, defer

from app.web.words import investigation_headline
from casebase.models import StoredInvestigation

Headlined = tuple[StoredInvestigation, str | None]
_DOCUMENT = StoredInvestigation.written


def light() -> Select[StoredInvestigation]:
    """Select investigations without their documents."""
    return select(StoredInvestigation).options(defer(_DOCUMENT))


def headlined(session: Session, rows: Sequence[StoredInvestigation]) -> list[Headlined]:
    """Return each of them with what it found; None with those that found nothing yet."""
    ids = [row.id for row in rows]
    told = _DOCUMENT["story", "headline"].as_string()
    asked = select(StoredInvestigation.id, _DOCUMENT["verdict"].as_string(), told)
    parts: dict[str, Mapping[str, Any]] = {
        identity: {"verdict": verdict, "story": {"headline": headline}}
        for identity, verdict, headline in session.execute(asked.where(StoredInvestigation.id.in_(ids)))
        if verdict is not None
    }
    untold = [identity for identity, part in parts.items() if not part["story"]["headline"]]
    if untold:  # of a version that told no story
        findings = select(StoredInvestigation.id, _DOCUMENT["findings"]).where(StoredInvestigation.id.in_(untold))
        for identity, found in session.execute(findings):
            parts[identity] = {**parts[identity], "findings": found or ()}
    return [(row, investigation_headline(parts[row.id]) if row.id in parts else None) for row in rows]
