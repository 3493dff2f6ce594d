"""Reads go on while nothing can be written; what is to be written of keys is written when it can be."""

import asyncio
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import httpx
import pytest

from app.http.keys import KeyNotes, Role, create_key, find_key
from app.http.middleware import Metrics
from app.main import create_app
from app.service import Service
from app.settings import settings_of
from benchmarks.harness.live import LiveServer
from casebase.library import CaseLibrary
from casebase.store.audit import entries
from tests.app.test_full_disk import pragma

KEYS = "/api/v1/keys"
WRONG = {"Authorization": "Bearer gearcase_" + "x" * 43}


@contextmanager
def locked(database: Path) -> Iterator[None]:
    """Hold the database as a long transaction of somebody else would."""
    with closing(sqlite3.connect(database, isolation_level=None)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        yield
        connection.execute("ROLLBACK")


def eventually(client: httpx.Client, key_id: str) -> str | None:
    """When the key is said to have been used, as soon as it is said."""
    for _ in range(200):
        found = next(each for each in client.get(KEYS, params={"limit": 200}).json()["items"] if each["id"] == key_id)
        if found["last_used_at"]:
            return str(found["last_used_at"])
        time.sleep(0.05)
    return None


def test_locked_database_keeps_nobody_from_reading(live_server: LiveServer, admin: httpx.Client) -> None:
    """A key that was never used before, and a wrong one; both answered while the lock is there."""
    made = admin.post(KEYS, json={"name": "reader", "role": "viewer"}).raise_for_status().json()
    assert made["last_used_at"] is None
    fresh = {"Authorization": f"Bearer {made['key']}"}
    with locked(live_server.data_dir / "gearcase.db"):
        for headers, status in ((fresh, 200), (WRONG, 401), (fresh, 200)):
            assert httpx.get(f"{live_server.url}/api/v1/cases", headers=headers, timeout=15).status_code == status
    assert eventually(admin, made["id"])
    audit = admin.get("/api/v1/audit", params={"limit": 200}).json()["items"]
    assert any(entry["action"] == "key.refused" for entry in audit)


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    service = Service.open(settings_of(tmp_path / "data"), Metrics())
    yield service
    service.close()


@pytest.mark.parametrize("words", ["query_only=ON", "max_page_count=1"], ids=["unwritable", "full"])
def test_disk_that_takes_nothing_keeps_nobody_from_reading(service: Service, words: str) -> None:
    with service.library.transaction("test") as session:
        _, key = create_key(session, name="reader", role=Role.VIEWER)

    async def read() -> list[int]:
        app = create_app(service=service)
        transport = httpx.ASGITransport(app)
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=transport, base_url="http://x") as client,
        ):
            client.headers["Authorization"] = f"Bearer {key}"
            found = [(await client.get("/api/v1/cases")).status_code for _ in range(3)]
            return [*found, (await client.get("/api/v1/cases", headers=WRONG)).status_code]

    found: list[int] = []
    with pragma(service, words):
        apart = threading.Thread(target=lambda: found.extend(asyncio.run(read())))
        apart.start()
        apart.join()
    assert found == [200, 200, 200, 401]


def test_notes_that_wait_are_written_at_the_end(tmp_path: Path) -> None:
    library = CaseLibrary.open(tmp_path / "data", None)
    with library.transaction("test") as session:
        row, key = create_key(session, name="reader", role=Role.VIEWER)
    notes = KeyNotes(library)
    for _ in range(20):
        notes.used(row, "reader")
        notes.refused("192.0.2.1", "unknown")
    notes.close()
    with library.reading() as session:
        found = find_key(session, key)
        assert found is not None
        assert found.last_used_at is not None
        assert sum(entry.action == "key.refused" for entry in entries(session)) == 20
    library.close()
