"""The audit log: who did what, newest first; nobody can change it."""

from typing import Annotated

from fastapi import APIRouter, Query

from app.documents import AuditAnswer, Limit, PageOf
from app.http.security import Admin
from app.service import Reading
from casebase.store import audit

router = APIRouter(tags=["keys and audit"])


@router.get("/audit")
def entries(
    _: Admin,
    session: Reading,
    limit: Limit = 50,
    cursor: Annotated[int | None, Query(ge=1, le=2**63 - 1, description="next_cursor of the page before")] = None,
) -> PageOf[AuditAnswer]:
    """Every change and every refused key."""
    rows = audit.entries(session, limit=limit + 1, before_id=cursor)
    items = [AuditAnswer.model_validate(row) for row in rows[:limit]]
    return PageOf(items=items, next_cursor=str(items[-1].id) if len(rows) > limit else None)
