"""A full disk and a database that lets nobody write: said so, nothing lost, and well again when there is room."""

import asyncio
import json
import resource
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from sqlite3 import Connection

import httpx
import pytest
from sqlalchemy import event

from app.http.keys import Role, create_key
from app.http.middleware import Metrics
from app.main import create_app
from app.service import Service
from app.settings import settings_of
from benchmarks.harness.sounds import sound

CASES = "/api/v1/cases"
LARGEST_FILE = 5_000_000
"""More than the database and its log have, less than the sound has."""
Calls = Callable[[httpx.AsyncClient], Awaitable[None]]


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    service = Service.open(settings_of(tmp_path / "data"), Metrics())
    yield service
    service.close()


def against(service: Service, calls: Calls) -> None:
    """Make calls as an admin against the service in this process, whose limits are ours to set."""
    with service.library.transaction("test") as session:
        _, key = create_key(session, name="test", role=Role.ADMIN)

    async def run() -> None:
        app = create_app(service=service)
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        headers = {"Authorization": f"Bearer {key}"}
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=transport, base_url="http://test", headers=headers) as client,
        ):
            await calls(client)

    with ThreadPoolExecutor(1) as apart:  # a browser test before this one may have left its loop running in this thread
        apart.submit(asyncio.run, run()).result()


async def add(client: httpx.AsyncClient, seed: int, content: bytes | None = None) -> httpx.Response:
    data = {"metadata": json.dumps({"label": "normal"})}
    return await client.post(CASES, files={"file": ("x.wav", content or sound(seed, seconds=0.5))}, data=data)


async def check_refused(client: httpx.AsyncClient, service: Service, status: int, words: str) -> None:
    """An upload is refused with a problem, and what was there is still all that is there."""
    before = (await client.get(CASES)).json()
    answer = await add(client, 2)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    assert words in answer.json()["detail"]
    assert "nothing of this request was stored" in answer.json()["detail"]
    assert (await client.get(CASES)).json() == before
    assert not list((service.settings.data_dir / "incoming").glob("*"))
    assert not list((service.settings.data_dir / "audio").glob(".part-*"))


@contextmanager
def pragma(service: Service, words: str) -> Iterator[None]:
    """Let every connection to the database begin with this."""
    engine = service.library.engine

    def configure(connection: Connection, _: object) -> None:
        connection.execute(f"PRAGMA {words}")

    event.listen(engine, "connect", configure)
    engine.dispose()
    yield
    event.remove(engine, "connect", configure)
    engine.dispose()


def test_database_without_room(service: Service) -> None:
    async def calls(client: httpx.AsyncClient) -> None:
        assert (await add(client, 1)).status_code == 201
        with pragma(service, "max_page_count=1"):  # which SQLite takes to mean: not one page more
            seed = 100
            while (await add(client, seed)).status_code == 201:  # what room is left in the pages there are
                seed += 1
            await check_refused(client, service, 507, "disk of the service is full")
        assert (await add(client, 3)).status_code == 201

    against(service, calls)


def test_database_that_nobody_may_write(service: Service) -> None:
    async def calls(client: httpx.AsyncClient) -> None:
        assert (await add(client, 1)).status_code == 201
        with pragma(service, "query_only=ON"):
            await check_refused(client, service, 503, "cannot reach or write")
        assert (await add(client, 2)).status_code == 201

    against(service, calls)


def test_disk_without_room_for_the_sound(service: Service) -> None:
    async def calls(client: httpx.AsyncClient) -> None:
        assert (await add(client, 1)).status_code == 201
        _, hard = soft_and_hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, hard))
        try:
            answer = await add(client, 2, b"RIFF" + bytes(LARGEST_FILE))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, soft_and_hard)
        assert answer.status_code == 507, answer.text
        assert "nothing of this request was stored" in answer.json()["detail"]
        assert len((await client.get(CASES)).json()["items"]) == 1
        assert not list((service.settings.data_dir / "incoming").glob("*"))
        assert (await add(client, 2)).status_code == 201

    against(service, calls)
