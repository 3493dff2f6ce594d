"""The same service on PostgreSQL: what SQLite serialises by itself must hold there as well."""

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from benchmarks.harness.live import LiveServer, started
from benchmarks.harness.sounds import sound

pytestmark = pytest.mark.postgres
CASES, DIAGNOSES = "/api/v1/cases", "/api/v1/diagnoses"


@pytest.fixture
def server(postgres_database_url: str, tmp_path: Path) -> Iterator[LiveServer]:
    server = started(tmp_path / "data", GEARCASE_DATABASE_URL=postgres_database_url)
    yield server
    server.stop()


def together(server: LiveServer, path: str, count: int, headers: dict[str, str]) -> list[httpx.Response]:
    """Send the same recording as often at once."""

    def send(_: int) -> httpx.Response:
        data = {"metadata": json.dumps({"label": "normal"} if path == CASES else {})}
        with server.client() as client:
            return client.post(path, files={"file": ("x.wav", sound(1))}, data=data, headers=headers)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(send, range(count)))


def test_service_on_postgresql(server: LiveServer) -> None:
    cases = together(server, CASES, 4, {})
    # whoever comes when the case is there already is told so
    assert {201} <= {answer.status_code for answer in cases} <= {200, 201}
    assert len({answer.json()["id"] for answer in cases}) == 1
    diagnoses = together(server, DIAGNOSES, 4, {"Idempotency-Key": "at once"})
    assert [answer.status_code for answer in diagnoses] == [201] * 4
    assert len({answer.content for answer in diagnoses}) == 1
    with server.client() as client:
        path = cases[0].headers["location"]
        assert client.patch(path, json={"note": "x"}, headers={"If-Match": '"1"'}).status_code == 200
        assert client.patch(path, json={"note": "y"}, headers={"If-Match": '"1"'}).status_code == 412
        assert client.get(CASES, params={"gearbox": "\0"}).status_code == 422
        assert client.get(f"{DIAGNOSES}/{diagnoses[0].json()['id']}").json() == diagnoses[0].json()
    server.until_ready()
