"""Clients that only half ask: they are ended in time, make room for others, and do not fill the log."""

import json
import resource
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import httpx
import pytest

from benchmarks.harness.live import LiveServer, started
from benchmarks.harness.sounds import sound
from benchmarks.harness.wire import connected, descriptors, head, process_folder, received, settled, status

MOST = 16
CROWD = 60
HALF_A_HEAD = b"GET /livez HTTP/1.1\r\nX-Long: "
CASES = "/api/v1/cases"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service of few connections that waits a second for headers and little more for bodies."""
    environment = {
        "GEARCASE_CONNECTIONS": str(MOST),
        "GEARCASE_HEADER_TIMEOUT_S": "1",
        "GEARCASE_BODY_TIMEOUT_S": "2",
        "GEARCASE_UPLOAD_TIMEOUT_S": "10",
    }
    server = started(tmp_path_factory.mktemp("connections") / "data", **environment)
    settled(server)
    yield server
    server.stop()


@contextmanager
def crowd(server: LiveServer, number: int, begun: bytes) -> Iterator[list[socket.socket]]:
    """So many connections that have sent this and wait."""
    with ExitStack() as stack:
        connections = [stack.enter_context(connected(server)) for _ in range(number)]
        for connection in connections:
            with suppressed():
                connection.sendall(begun)
        yield connections


@contextmanager
def suppressed() -> Iterator[None]:
    """What a client sees whose connection has been closed already."""
    try:
        yield
    except ConnectionError:
        return


def lives(server: LiveServer) -> bool:
    return httpx.get(f"{server.url}/livez", timeout=30).status_code == 200


def sockets(server: LiveServer) -> int:
    return sum(link.startswith("socket:") for link in descriptors(server))


@pytest.mark.parametrize("begun", [b"", HALF_A_HEAD], ids=["nothing", "half a head"])
def test_head_that_never_comes_ends_the_connection(server: LiveServer, begun: bytes) -> None:
    with crowd(server, MOST // 2, begun) as connections:
        assert {received(connection) for connection in connections} == {b""}


def test_head_that_trickles_is_not_waited_for(server: LiveServer) -> None:
    """Also behind a request that was answered, on the same connection."""
    with connected(server) as connection:
        connection.sendall(head(server, "GET", "/livez", None))
        answer = b""
        while not answer.endswith(b"}"):
            answer += connection.recv(65_536)
        assert status(answer) == 200
        connection.settimeout(0.1)
        connection.sendall(HALF_A_HEAD)
        with suppressed():
            while True:
                try:
                    assert connection.recv(10) == b""
                    break
                except TimeoutError:
                    connection.sendall(b"x")


@pytest.mark.parametrize("asks", ["nothing", "half a head", "half a sign-in", "half a body without a key"])
def test_crowd_that_waits_makes_room(server: LiveServer, asks: str) -> None:
    """Four times as many as there may be, and somebody who asks is answered at once."""
    form = {"Content_Type": "application/x-www-form-urlencoded", "Content_Length": "1000"}
    begun = {
        "nothing": b"",
        "half a head": HALF_A_HEAD,
        "half a sign-in": head(server, "POST", "/sign-in", None, **form) + b"key=",
        "half a body without a key": head(server, "POST", "/api/v1/keys", None, **form),
    }[asks]
    before = sockets(server)
    with crowd(server, CROWD, begun):
        assert lives(server)
        assert sockets(server) <= before + MOST + 1
        with server.client() as client:
            assert client.get(CASES).status_code == 200


def upload(server: LiveServer) -> tuple[bytes, bytes]:
    """An upload with a key: its head and the beginning of its body, and the rest."""
    request = httpx.Request(
        "POST", server.url, files={"file": ("x.wav", sound(300_001))}, data={"metadata": '{"label": "normal"}'}
    )
    body, kind = request.read(), request.headers["content-type"]
    begun = head(server, "POST", CASES, "admin", Content_Type=kind, Content_Length=str(len(body)), Connection="close")
    return begun + body[:1000], body[1000:]


def test_upload_under_way_is_not_what_makes_room(server: LiveServer) -> None:
    begun, rest = upload(server)
    with connected(server) as connection:
        connection.sendall(begun)
        assert lives(server)  # which comes after it
        with crowd(server, CROWD, HALF_A_HEAD):
            assert lives(server)
        connection.sendall(rest)
        assert status(received(connection)) in (200, 201)


def test_who_comes_while_all_are_at_work_is_told(server: LiveServer) -> None:
    begun, _ = upload(server)
    with crowd(server, MOST, begun):
        time.sleep(0.5)  # until the keys of all have been seen
        answer = httpx.get(f"{server.url}/livez")
        assert answer.status_code == 503
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["status"] == 503
    for _ in range(100):
        if httpx.get(f"{server.url}/livez").status_code == 200:
            break
        time.sleep(0.05)
    assert lives(server)


def test_without_descriptors_the_log_stays_small_and_the_service_recovers(server: LiveServer) -> None:
    """It lives again as soon as those who only wait have been ended, without anybody's help."""
    assert server.process is not None
    limits = resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE)
    before = len(server.log())
    used = {int(each.name) for each in (process_folder(server) / "fd").iterdir()}
    few = [number for number in range(1000) if number not in used][4]
    with ExitStack() as stack:
        resource.prlimit(server.process.pid, resource.RLIMIT_NOFILE, (few, limits[1]))
        stack.callback(resource.prlimit, server.process.pid, resource.RLIMIT_NOFILE, limits)
        stack.enter_context(crowd(server, MOST - 2, HALF_A_HEAD))
        server.logged("connections cannot be accepted")
        assert lives(server)
    written = server.log()[before:]
    assert written.count("connections cannot be accepted") == 1
    assert len(written) < 10_000
    assert "Traceback" not in written


def test_methods_and_paths_that_clients_make_up_are_one_label(server: LiveServer) -> None:
    with server.client() as client:
        for number in range(20):
            assert client.request(f"MADEUP{number}", CASES).status_code == 405
            assert client.get(f"/made-up-{number}").status_code == 404
        counted = client.get("/metrics").text
    assert "MADEUP" not in counted
    assert "made-up" not in counted
    assert 'gearcase_requests_total{method="other",route="/cases",status="405"} 20.0' in counted
    assert 'gearcase_requests_total{method="GET",route="other",status="404"} 20.0' in counted


def test_line_of_the_log_is_bounded(server: LiveServer) -> None:
    with server.client() as client:
        client.get("/" + "x" * 50_000, headers={"X-Request-ID": "long-path"})
    line = server.logged("long-path")
    assert len(line) < 3_000
    assert "characters left out" in json.loads(line)["path"]
