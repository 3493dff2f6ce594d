"""Key, role, size and time are decided before the body is read; what the body calls itself changes none of it."""

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest
from fastapi.routing import RouteContext, iter_route_contexts

from app.http.request_limits import limits_of
from app.main import create_app
from app.settings import Settings
from benchmarks.harness.live import LiveServer, sign_in, started
from benchmarks.harness.wire import (
    chunked,
    connected,
    descriptors,
    forget_peak,
    head,
    memory_bytes,
    peak_bytes,
    pushed,
    received,
    settled,
    status,
)

MEBIBYTE = 1024 * 1024
WHOLE = 200 * MEBIBYTE
AT_ONCE = 8
MEMORY = 50_000_000
"""How much the service may grow while eight connections send 200 MiB each [byte]."""
ON_THE_WAY = 32 * MEBIBYTE
"""More than the buffers of a connection hold: who could send more was read."""

FORM = "multipart/form-data; boundary=x"
BEGINNING = b'--x\r\nContent-Disposition: form-data; name="file"; filename="x.wav"\r\n\r\n'
CHANGES = ("POST", "PUT", "PATCH", "DELETE")
OPEN = {("POST", "/sign-in")}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service that waits a second for a body, and two for an upload."""
    environment = {"GEARCASE_BODY_TIMEOUT_S": "1", "GEARCASE_UPLOAD_TIMEOUT_S": "2"}
    server = started(tmp_path_factory.mktemp("door") / "data", **environment)
    settled(server)
    yield server
    server.stop()


def blocks() -> Iterator[bytes]:
    block = bytes(MEBIBYTE)
    yield BEGINNING
    yield from (block for _ in range(WHOLE // MEBIBYTE))


def sends_200_mib(
    server: LiveServer, path: str, role: str | None, *, declared: bool, kind: str = FORM, method: str = "POST"
) -> tuple[bytes, int]:
    """Send a large body without looking; return what came back and how much went."""
    size = {"Content_Length": str(WHOLE + len(BEGINNING))} if declared else {"Transfer_Encoding": "chunked"}
    with connected(server) as connection:
        connection.sendall(head(server, method, path, role, Content_Type=kind, **size))
        sent = pushed(connection, blocks() if declared else chunked(blocks()))
        return received(connection), sent


def eight_times(
    server: LiveServer, path: str, role: str | None, *, declared: bool, kind: str = FORM, method: str = "POST"
) -> list[int]:
    """The statuses of eight at once that the service neither kept in memory nor on disk nor read."""
    forget_peak(server)
    before = memory_bytes(server)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        found = list(
            pool.map(
                lambda _: sends_200_mib(server, path, role, declared=declared, kind=kind, method=method), range(AT_ONCE)
            )
        )
    assert peak_bytes(server) - before < MEMORY
    assert max(sent for _, sent in found) < ON_THE_WAY
    assert not [link for link in descriptors(server) if link.endswith("(deleted)")]
    assert all(b"\r\nconnection: close\r\n" in answer.lower() for answer, _ in found)
    assert all(b"application/problem+json" in answer for answer, _ in found)
    return [status(answer) for answer, _ in found]


@pytest.mark.parametrize("declared", [True, False], ids=["declared", "in chunks"])
@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", "/api/v1/keys"),
        ("POST", "/api/v1/cases"),
    ],
)
def test_without_a_key_nothing_is_read(server: LiveServer, method: str, path: str, declared: bool) -> None:
    assert eight_times(server, path, None, declared=declared, method=method) == [401] * AT_ONCE


@pytest.mark.parametrize("declared", [True, False], ids=["declared", "in chunks"])
@pytest.mark.parametrize(
    ("path", "role", "kind"),
    [
        ("/api/v1/keys", "admin", FORM),
        ("/api/v1/cases", "admin", "application/json"),
        ("/library/change", None, FORM),
        ("/sign-in", None, "application/x-www-form-urlencoded"),
    ],
)
def test_size_is_that_of_the_route(server: LiveServer, path: str, role: str | None, kind: str, declared: bool) -> None:
    """Also where the body calls itself an upload, and where a route that takes uploads is sent something else."""
    if path == "/library/change":  # a page: who is not signed in is led to the sign-in
        answer, sent = sends_200_mib(server, path, role, declared=declared, kind=kind)
        assert status(answer) == 303
        assert sent < ON_THE_WAY
        return
    assert eight_times(server, path, role, declared=declared, kind=kind) == [413] * AT_ONCE


def test_sign_in_takes_a_key_and_little_else(server: LiveServer) -> None:
    with server.client(None) as browser:
        key = server.keys["viewer"]
        assert sign_in(browser, key).status_code == 303
        too_long = browser.post(
            "/sign-in", data={"key": key, "next": "/" + "x" * 10_000}, headers={"Accept": "text/html"}
        )
    assert too_long.status_code == 413
    assert too_long.headers["content-type"].startswith("text/html")


def changing_routes() -> list[tuple[str, str, RouteContext]]:
    """Every method and path that may have a body, an id that is nobody's in the path."""
    found = []
    for route in iter_route_contexts(create_app(Settings()).routes):
        path = "/".join("0" * 32 if part.startswith("{") else part for part in (route.path or "").split("/"))
        found += [(method, path, route) for method in sorted(route.methods or ()) if method in CHANGES]
    assert len(found) > 30
    return found


def test_every_route_that_takes_a_body_has_a_guard_or_is_known_to_be_open() -> None:
    assert {(method, path) for method, path, route in changing_routes() if not limits_of(route).guards} == OPEN


def test_uploads_are_where_the_contract_has_them() -> None:
    assert {path for _, path, route in changing_routes() if limits_of(route).takes_upload} == {
        "/api/v1/diagnoses",
        "/api/v1/retrievals",
        "/api/v1/cases",
        "/api/v1/investigations",
        "/api/v1/robots",
        "/diagnoses/new",
        "/library/add",
        "/library/import",
        "/investigations/new",
        "/investigations/columns",
        "/investigations/preview",
        f"/axes/{'0' * 32}/first-hour/recordings",
    }


@pytest.mark.parametrize("kind", [FORM, "application/json", "application/x-www-form-urlencoded"])
def test_every_route_refuses_by_the_headers_alone(server: LiveServer, kind: str) -> None:
    """Not one byte of the body is sent, so none can have been needed."""
    wrong = []
    for method, path, _ in changing_routes():
        if (method, path) in OPEN:
            continue
        with connected(server) as connection:
            connection.sendall(head(server, method, path, None, Content_Type=kind, Content_Length="1000"))
            code = status(connection.recv(65_536))
        if code != (401 if path.startswith("/api/") else 303):
            wrong.append((method, path, code))
    assert not wrong


@pytest.mark.parametrize(
    ("path", "role", "kind", "seconds"),
    [
        ("/api/v1/keys", "admin", "application/json", "1 s"),
        ("/api/v1/cases", "admin", FORM, "2 s"),
        ("/sign-in", None, "application/x-www-form-urlencoded", "1 s"),
    ],
)
def test_body_that_trickles_is_given_up(
    server: LiveServer, path: str, role: str | None, kind: str, seconds: str
) -> None:
    with connected(server) as connection:
        connection.sendall(head(server, "POST", path, role, Content_Type=kind, Content_Length="1000"))
        connection.sendall(BEGINNING)
        connection.settimeout(0.2)
        answer = b""
        while not answer:
            try:
                answer = connection.recv(65_536)
            except TimeoutError:
                connection.sendall(b" ")
        connection.settimeout(30)
        answer += received(connection)
    assert status(answer) == 408
    assert seconds in json.loads(answer.partition(b"\r\n\r\n")[2])["detail"]


def test_refusal_is_read_by_ordinary_clients_and_the_next_request_goes_on(server: LiveServer) -> None:
    """One that sends all before it reads, as most do, and somewhat more than is allowed."""
    with server.client() as client:
        for size in (MEBIBYTE + 1, 2 * MEBIBYTE, 20 * MEBIBYTE):
            answer = client.post("/api/v1/keys", content=bytes(size), headers={"Content-Type": "application/json"})
            assert answer.status_code == 413
        assert client.get("/api/v1/keys").status_code == 200
    with httpx.Client(base_url=server.url) as nobody:
        assert nobody.post("/api/v1/keys", json={"name": "x", "role": "viewer"}).status_code == 401
        assert nobody.get("/livez").status_code == 200
