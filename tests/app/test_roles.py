"""Every operation of the OpenAPI document, asked by every role and by nobody."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.http.reference import role_of
from app.http.security import COOKIE, CSRF_HEADER, csrf_token
from benchmarks.harness.live import ROLES, LiveServer, started
from benchmarks.harness.site import KNOWN, Site, fill
from sim.experiment.paper_axis import PAPER_AXIS

OPEN = {"/livez", "/readyz"}
METHODS = ("get", "post", "put", "patch", "delete")
ID = "0" * 32


def operations(document: dict[str, Any]) -> list[tuple[str, str, str | None]]:
    return [
        (method, path, role_of(operation))
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
        if method in METHODS
    ]


def filled(path: str) -> str:
    """The path with an id that is nobody's."""
    return "/".join(ID if part.startswith("{") else part for part in path.split("/"))


@pytest.fixture(scope="module")
def everything(live_server: LiveServer) -> list[tuple[str, str, str | None]]:
    with live_server.client(None) as client:
        found = operations(client.get("/openapi.json").raise_for_status().json())
    assert len(found) > 20
    return found


def test_only_health_is_open(everything: list[tuple[str, str, str | None]]) -> None:
    assert {path for _, path, role in everything if role is None} == OPEN


def test_contract_has_these_roles(everything: list[tuple[str, str, str | None]]) -> None:
    roles = {(method, path): role for method, path, role in everything}
    api = "/api/v1"
    assert roles["post", f"{api}/diagnoses"] == "operator"
    assert roles["post", f"{api}/retrievals"] == "viewer"
    assert roles["get", f"{api}/diagnoses"] == roles["get", f"{api}/diagnoses/{{diagnosis_id}}"] == "viewer"
    assert roles["get", f"{api}/diagnoses/{{diagnosis_id}}/report"] == "viewer"
    assert roles["patch", f"{api}/diagnoses/{{diagnosis_id}}"] == "operator"
    assert roles["post", f"{api}/cases"] == "admin"
    assert roles["get", f"{api}/cases"] == roles["get", f"{api}/cases/{{case_id}}"] == "viewer"
    assert roles["patch", f"{api}/cases/{{case_id}}"] == roles["delete", f"{api}/cases/{{case_id}}"] == "admin"
    for view in ("audio", "waveform", "spectrum", "spectrogram", "crest", "features"):
        assert roles["get", f"{api}/recordings/{{recording_id}}/{view}"] == "viewer"
    assert roles["get", f"{api}/library/evaluation"] == roles["get", f"{api}/axes"] == "viewer"
    assert roles["post", f"{api}/axes"] == "admin"
    assert roles["get", f"{api}/queue"] == roles["get", f"{api}/steps"] == "viewer"
    assert roles["post", f"{api}/steps/{{number}}/undo"] == "operator"
    assert roles["get", "/metrics"] == "viewer"


@pytest.mark.parametrize("role", [None, *ROLES])
def test_every_operation_asks_for_its_role(
    live_server: LiveServer, everything: list[tuple[str, str, str | None]], role: str | None
) -> None:
    wrong = []
    with live_server.client(role) as client:
        for method, path, needed in everything:
            code = ask(client, method, filled(path))
            if needed is None:
                right = code == 200
            elif role is None:
                right = code == 401
            elif ROLES.index(role) < ROLES.index(needed):
                right = code == 403
            else:
                right = code not in (401, 403, 500)
            if not right:
                wrong.append((method, path, needed, code))
    assert not wrong


def ask(client: httpx.Client, method: str, path: str) -> int:
    with client.stream(method, path, headers={"Accept": "*/*"}) as answer:
        return answer.status_code


BODIES = {"diagnosis_id": {"verdict": "rejected"}, "case_id": {"note": "changed"}}
BY_ITSELF = {"api_keys", "artifacts", "audit", "sqlite_sequence"}
"""Tables that change where somebody asks and is refused; of keys only when they were used."""


@pytest.fixture
def filled_server(tmp_path: Path) -> Iterator[tuple[LiveServer, dict[str, str]]]:
    """A service with one of everything that can be changed, and its ids by the names that paths have for them."""
    server = started(tmp_path / "data")
    site = Site(server, tmp_path)
    fill(site, KNOWN[:1])
    with server.client() as admin:
        wanted = {"axis": PAPER_AXIS.to_mapping(), "per_label": 1}
        job = admin.post("/api/v1/simulations", json=wanted).raise_for_status().headers["location"]
        other = admin.post("/api/v1/keys", json={"name": "another", "role": "viewer"}).raise_for_status().json()
        listed = {noun: admin.get(f"/api/v1/alarms/{noun}").json() for noun in ("receivers", "rules")}
    yield (
        server,
        {
            "diagnosis_id": site.diagnosis,
            "case_id": site.case,
            "recording_id": site.recorded,
            "name": "bench",
            "job_id": job.rpartition("/")[2],
            "receiver_id": listed["receivers"][0]["id"],
            "rule_id": listed["rules"][0]["id"],
            "key_id": other["id"],
        },
    )
    server.stop()


def stored(server: LiveServer) -> dict[str, list[Any]]:
    """All rows, of keys those that are in force."""
    with closing(sqlite3.connect(server.data_dir / "gearcase.db")) as database:
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        found = {name: database.execute(f"SELECT * FROM {name}").fetchall() for name in {*tables} - BY_ITSELF}
        return found | {"in force": database.execute("SELECT id FROM api_keys WHERE revoked_at IS NULL").fetchall()}


def test_who_is_refused_changes_nothing(filled_server: tuple[LiveServer, dict[str, str]]) -> None:
    """Asked by nobody, by lower roles, and in a browser with the token of another one; the right role may, whoever."""
    server, ids = filled_server
    with server.client(None) as client:
        found = operations(client.get("/openapi.json").json())
    changes = [
        (method, path.format(**ids), next((body for name, body in BODIES.items() if name in path), None), needed or "")
        for method, path, needed in found
        if method not in ("get", "post")
    ]
    sessions = {role: server.session(role)[COOKIE] for role in ROLES}
    other = csrf_token(server.session("admin")[COOKIE])
    before = stored(server)
    for method, path, body, needed in changes:
        askers: list[tuple[str | None, dict[str, str]]] = [(None, {}), (None, as_browser(sessions["admin"], other))]
        for role in ROLES[: ROLES.index(needed)]:
            askers += [(role, {}), (None, as_browser(sessions[role], csrf_token(sessions[role])))]
        for asker, headers in askers:
            with server.client(asker) as client:
                assert client.request(method, path, json=body, headers=headers).status_code in (401, 403), path
    assert stored(server) == before
    with server.client() as admin:
        for role in ROLES:
            server.keys[role] = admin.post("/api/v1/keys", json={"name": "second", "role": role}).json()["key"]
    for method, path, body, needed in changes:
        with server.client(needed) as second:
            assert second.request(method, path, json=body).status_code in (200, 204, 409), path


def as_browser(cookie: str, token: str) -> dict[str, str]:
    return {"Cookie": f"{COOKIE}={cookie}", CSRF_HEADER: token}
