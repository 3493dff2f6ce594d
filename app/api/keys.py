"""Keys: made, listed and revoked by admins."""

from fastapi import APIRouter, Response, status
from sqlalchemy.orm import Session

from app.documents import Cursor, Identifier, KeyAnswer, KeyRequest, Limit, NewKey, PageOf, page_of
from app.http import keys
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin
from app.service import Reading, TheService

router = APIRouter(tags=["keys and audit"])


@router.get("/keys")
def list_keys(_: Admin, session: Reading, limit: Limit = 50, cursor: Cursor = None) -> PageOf[KeyAnswer]:
    """Keys, oldest first, revoked ones too; never the keys themselves."""
    return page_of(keys.keys_page(session, limit=limit, cursor=cursor), KeyAnswer.model_validate)


@router.post("/keys", status_code=status.HTTP_201_CREATED, response_model=NewKey)
def create_key(_: Admin, body: KeyRequest, once: OnlyOnce) -> Response:
    """Make a key. It is in this answer and nowhere else."""

    def work(session: Session) -> Made:
        row, key = keys.create_key(session, name=body.name, role=body.role)
        shown = KeyAnswer.model_validate(row).model_dump()
        return Made(NewKey(**shown, key=key), repeated=NewKey(**shown, key=None))

    return once.run(work, body.model_dump())


@router.delete("/keys/{key_id}")
def revoke_key(admin: Admin, service: TheService, key_id: Identifier) -> KeyAnswer:
    """Revoke a key for good; the last admin key in force stays."""
    with service.library.transaction(admin.actor) as session:
        return KeyAnswer.model_validate(keys.revoke_key(session, key_id))
