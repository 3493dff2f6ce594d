"""Every operation of the OpenAPI document, asked by every role and by nobody."""

from typing import Any

import httpx
import pytest

from app.http.reference import role_of
from benchmarks.harness.live import ROLES, LiveServer

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
