"""The service: whether it lives and is ready, its metrics, what it takes, its keys, and who did what."""

import asyncio
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response, status
from prometheus_client import generate_latest
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from app.documents import AuditAnswer, Cursor, Identifier, KeyAnswer, KeyRequest, Limit, NewKey, PageOf, page_of
from app.http import keys
from app.http.errors import Unavailable
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Viewer
from app.service import Reading, Service, TheService, service_of
from casebase.store import audit
from signals.reading.decode import LIMITS

PROBES = ThreadPoolExecutor(2, thread_name_prefix="probe")
"""Probes wait for no other request's thread."""

FREE_BYTES = 256 * 1024 * 1024

router, inside = APIRouter(tags=["service"]), APIRouter()
"""Outside and inside `/api/v1`."""
SHOWN = {
    "accept_lossy", "upload_bytes", "document_bytes", "anonymous_bytes", "metadata_bytes", "form_parts",
    "header_timeout_s", "body_timeout_s", "upload_timeout_s", "uploads_per_key", "uploads_at_once", "looks_per_key",
    "looks_at_once", "page_items", "failed_keys", "idempotency_hours",
}  # fmt: skip


@router.get("/livez")
async def live() -> dict[str, str]:
    """The process answers, also while all threads are busy."""
    return {"status": "alive"}


@router.get("/readyz")
async def ready(request: Request) -> dict[str, str]:
    """The service can do its work: all is loaded, and database, data folder and disk are as they should be."""
    wrong = await asyncio.get_running_loop().run_in_executor(PROBES, faults, service_of(request))
    if wrong:
        raise Unavailable(" ".join(wrong))
    return {"status": "ready"}


def faults(service: Service) -> list[str]:
    """Return a sentence for each thing that keeps the service from its work."""
    found = []
    if not service.upkeep.loaded.is_set():
        found.append("What diagnoses need is still being loaded: ask again in a second.")
    try:
        with service.library.reading() as session:
            session.execute(text("SELECT value FROM library_counter"))
    except SQLAlchemyError as error:
        found.append(f"The database does not answer ({type(error).__name__}): check that it runs and is migrated.")
    folder = service.library.data_dir
    if not os.access(folder, os.W_OK):
        found.append("The data folder cannot be written: check that it exists and who owns it.")
    elif shutil.disk_usage(folder).free < FREE_BYTES:
        found.append(f"Less than {FREE_BYTES >> 20} MiB are free where the data folder lies: make room.")
    return found


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def metrics(_: Viewer, service: TheService) -> Response:
    """Counters in Prometheus' text format."""
    return Response(generate_latest(service.metrics.registry), media_type=CONTENT_TYPE_PLAIN_0_0_4)


@inside.get("/limits", tags=["service"])
def limits(_: Viewer, service: TheService) -> dict[str, bool | int | float | str | dict[str, float]]:
    """Sizes [byte], times [s] and counts that requests must keep to; `decoding`: those of one recording."""
    decoding = {name: value for name, value in asdict(LIMITS).items() if name != "lossy"}
    return {**service.settings.model_dump(include=SHOWN), "decoding": decoding}


@inside.get("/keys", tags=["keys and audit"])
def list_keys(_: Admin, session: Reading, limit: Limit = 50, cursor: Cursor = None) -> PageOf[KeyAnswer]:
    """Keys, oldest first, revoked ones too; never the keys themselves."""
    return page_of(keys.keys_page(session, limit=limit, cursor=cursor), KeyAnswer.model_validate)


@inside.post("/keys", status_code=status.HTTP_201_CREATED, response_model=NewKey, tags=["keys and audit"])
def create_key(_: Admin, body: KeyRequest, once: OnlyOnce) -> Response:
    """Make a key. It is in this answer and nowhere else."""

    def work(session: Session) -> Made:
        row, key = keys.create_key(session, name=body.name, role=body.role)
        shown = KeyAnswer.model_validate(row).model_dump()
        return Made(NewKey(**shown, key=key), repeated=NewKey(**shown, key=None))

    return once.run(work, body.model_dump())


@inside.delete("/keys/{key_id}", tags=["keys and audit"])
def revoke_key(admin: Admin, service: TheService, key_id: Identifier) -> KeyAnswer:
    """Revoke a key for good; the last admin key in force stays."""
    with service.library.transaction(admin.actor) as session:
        return KeyAnswer.model_validate(keys.revoke_key(session, key_id))


@inside.get("/audit", tags=["keys and audit"])
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
