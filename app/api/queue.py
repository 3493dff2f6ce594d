"""The queue: diagnoses that need a person, where an answer teaches the library most first."""

from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field
from sqlalchemy import select

from app.documents import Cursor, DiagnosisAnswer, Limit
from app.http.security import Viewer
from app.service import Reading, TheService
from casebase.errors import ConflictError
from casebase.queue import reason_of, waiting
from casebase.store.models import StoredDiagnosis

router = APIRouter(tags=["diagnoses"])


class WaitingAnswer(BaseModel):
    """A diagnosis that needs a person."""

    place: int = Field(ge=1, description="in the queue, from 1")
    reason: Literal["not_in_library", "ambiguous", "fault"] = Field(
        description="unlike every known kind, not decided, or a likely fault that nobody has confirmed"
    )
    diagnosis: DiagnosisAnswer


class QueueAnswer(BaseModel):
    """A page of the queue. What is answered leaves it."""

    count: int = Field(ge=0, description="how many need a person")
    items: list[WaitingAnswer]
    next_cursor: str | None


@router.get("/queue")
def queue(_: Viewer, service: TheService, session: Reading, limit: Limit = 50, cursor: Cursor = None) -> QueueAnswer:
    """The diagnoses that need a person: `PATCH /diagnoses/{id}` answers one, and it is gone from here.

    First stands where the library knows least. An answer may change the order of the others, so whoever answers while
    reading asks for the first page again.
    """
    ids = list(waiting(session, service.fleet.naming(session)))
    if cursor is not None and cursor not in ids:
        raise ConflictError("the diagnosis of this cursor does not wait any more: ask again without a cursor")
    first = 0 if cursor is None else ids.index(cursor) + 1
    wanted = ids[first : first + limit]
    rows = {row.id: row for row in session.scalars(select(StoredDiagnosis).where(StoredDiagnosis.id.in_(wanted)))}
    items = [
        WaitingAnswer(place=place, reason=reason_of(rows[each].verdict), diagnosis=DiagnosisAnswer.of(rows[each]))
        for place, each in enumerate(wanted, start=first + 1)
    ]
    return QueueAnswer(count=len(ids), items=items, next_cursor=wanted[-1] if first + limit < len(ids) else None)
