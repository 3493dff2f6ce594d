"""Whether the service lives and is ready, its metrics, and the page that explains the API."""

import asyncio
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse
from prometheus_client import generate_latest
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError

from app.http.errors import Unavailable
from app.http.reference import reference_page
from app.http.security import Viewer
from app.service import Service, TheService, service_of

PROBES = ThreadPoolExecutor(2, thread_name_prefix="probe")
"""Probes wait for no other request's thread."""

FREE_BYTES = 256 * 1024 * 1024

router = APIRouter(tags=["service"])


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


@router.get("/docs", include_in_schema=False)
def docs(request: Request) -> HTMLResponse:
    """The API explained on one page that needs neither scripts nor network."""
    document: dict[str, Any] = request.app.openapi()
    return HTMLResponse(reference_page(document, str(request.base_url)))
