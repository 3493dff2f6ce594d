"""What old clients, monitors and flaky networks do to an HTTP service, and what they are to get."""

import json
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from fastapi.routing import APIRoute

from app.api import operation
from app.main import PAGES, ROUTERS
from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import sound
from sim.experiment.paper_axis import PAPER_AXIS

DIAGNOSES = "/api/v1/diagnoses"
MARK = "\ufeff".encode()
BOUNDARY = "field"
TYPE = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
OWN = ("date", "x-request-id", "content-length", "transfer-encoding")
"""Headers that belong to one answer, or to its body."""


def paths() -> list[str]:
    """Every path with GET, an id that is nobody's in it."""
    found = {"/openapi.json", "/static/gearcase.css", "/nowhere"}
    for routers, prefix in ((ROUTERS, "/api/v1"), ((operation.router,), ""), (PAGES, "")):
        for router in routers:
            for route in router.routes:
                if isinstance(route, APIRoute) and "GET" in route.methods:
                    parts = (prefix + route.path).split("/")
                    found.add("/".join("0" * 32 if part.startswith("{") else part for part in parts))
    assert len(found) > 50
    return sorted(found)


@pytest.mark.parametrize(("role", "accept"), [(None, "*/*"), ("admin", "*/*"), ("admin", "text/html")])
def test_head_is_get_without_the_body(live_server: LiveServer, role: str | None, accept: str) -> None:
    """By key, and as a browser asks: the same status, the same headers, for everybody the same refusals."""
    with live_server.client(role) as client:
        client.headers["Accept"] = accept
        if role is not None:
            client.cookies.update(live_server.session(role))
        for path in paths():
            before = seen(client, "GET", path)
            head = seen(client, "HEAD", path)  # what is being computed may get ready meanwhile
            assert head[-1] == b""
            assert head[:-1] in (
                before[:-1],
                seen(client, "GET", path)[:-1],
            )


def seen(client: httpx.Client, method: str, path: str) -> tuple[str, int, set[str], bytes]:
    """What comes back: path, status, names of headers, content.

    By a connection of its own: one that has waited too long on a busy machine is closed by the service.
    """
    answer = client.request(method, path, headers={"Connection": "close"})
    return path, answer.status_code, {*answer.headers} - {*OWN}, answer.content


def test_probes_may_use_head_on_the_front_page(live_server: LiveServer) -> None:
    with live_server.client(None) as client:
        for path in ("/livez", "/readyz", "/openapi.json", "/docs", "/static/gearcase.css"):
            head, whole = client.head(path), client.get(path)
            assert head.status_code == 200
            assert int(head.headers["content-length"]) == len(whole.content)
        assert client.head("/").status_code == client.get("/").status_code < 400
        assert client.head("/livez", headers={"X-Request-ID": "probe-1"}).status_code == 200
    entry = json.loads(live_server.logged("probe-1"))
    assert (entry["method"], entry["status"]) == ("HEAD", 200)
    with live_server.client("viewer") as client:
        assert 'method="HEAD",route="/livez",status="200"' in client.get("/metrics").text


def test_head_of_what_streams_ends(live_server: LiveServer) -> None:
    """A live stream of a job that nobody works on, and a file of which a range is asked for, which is of GET alone."""
    with live_server.client() as client:
        job = client.post("/api/v1/simulations", json={"axis": PAPER_AXIS.to_mapping(), "per_label": 1})
        events = job.raise_for_status().headers["location"] + "/events"
        head = client.head(events)
        assert (head.status_code, head.content) == (200, b"")
        assert head.headers["content-type"].startswith("text/event-stream")
        client.delete(job.headers["location"]).raise_for_status()
        content = sound(70)
        made = client.post(DIAGNOSES, files={"file": ("x.wav", content)}).raise_for_status().json()
        audio = f"/api/v1/recordings/{made['recording']['id']}/audio"
        head = client.head(audio, headers={"Range": "bytes=0-9"})
        assert (head.status_code, int(head.headers["content-length"])) == (200, len(content))
        assert client.get(audio).content == content  # the connection is in step


def form(*parts: tuple[str, bytes]) -> bytes:
    """A multipart body whose parts have these Content-Dispositions."""
    lines = [b"".join((b"--field\r\nContent-Disposition: ", head.encode(), b"\r\n\r\n", body)) for head, body in parts]
    return b"\r\n".join([*lines, b"--field--\r\n"])


def sent(client: httpx.Client, *parts: tuple[str, bytes]) -> httpx.Response:
    return client.post(DIAGNOSES, content=form(*parts), headers=TYPE)


def about(**known: str) -> tuple[str, bytes]:
    """The part that says how a recording was taken."""
    return 'form-data; name="metadata"', json.dumps(known).encode()


@pytest.fixture
def admin(live_server: LiveServer) -> Iterator[httpx.Client]:
    with live_server.client("admin") as client:
        yield client


@pytest.mark.parametrize("seconds", [0.5, 8.0], ids=["as small as a text", "larger than a text may be"])
def test_file_without_a_name_is_told_to_have_one(admin: httpx.Client, seconds: float) -> None:
    answer = sent(admin, ('form-data; name="file"', sound(71, seconds=seconds)))
    assert (answer.status_code, answer.headers["content-type"]) == (400, "application/problem+json")
    assert "give the part `file` a file name" in answer.json()["detail"].replace("Give", "give")


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("filename*=UTF-8''m%C3%BChle%20a.wav", "mühle a.wav"),
        ("filename*=utf-8'de'm%c3%bchle.wav", "mühle.wav"),
        ("filename*=\"UTF-8''m%C3%BChle.wav\"", "mühle.wav"),
        ("filename*=iso-8859-1''m%FChle.wav", "mühle.wav"),
        ("filename=\"m_hle.wav\"; filename*=UTF-8''m%C3%BChle.wav", "mühle.wav"),
        ("filename*=UTF-8''..%2F..%2Fa%22b%5Cc.wav", "c.wav"),
        ('filename="mühle.wav"', "mühle.wav"),
        ("filename=recording.wav", "recording.wav"),
        ('filename="m%C3%BChle 50%.wav"', "mühle 50%.wav"),
        ('filename="a%FFb.wav"', "a%FFb.wav"),
        ('filename="=?UTF-8?B?bcO8aGxlLndhdg==?="', "mühle.wav"),
        ('filename="C:\\sounds\\a.wav"', "a.wav"),
        ('filename=""', "unnamed"),
    ],
)
def test_file_name_as_clients_write_it(admin: httpx.Client, given: str, name: str) -> None:
    answer = sent(admin, (f'form-data; name="file"; {given}', sound(72, seconds=1.0)), about(gearbox=given))
    assert answer.status_code == 201, answer.text
    assert answer.json()["recording"]["file_name"] == name


@pytest.mark.parametrize(
    ("disposition", "encoding"),
    [
        ('name="metadata"', "utf-8-sig"),
        ('name="metadata"; filename="m.json"', "utf-8-sig"),
        ('name="metadata"; filename="m.json"', "utf-16"),
    ],
)
def test_metadata_may_begin_with_a_byte_order_mark(admin: httpx.Client, disposition: str, encoding: str) -> None:
    metadata = '{"gearbox": "würze"}'.encode(encoding)
    file = ('form-data; name="file"; filename="x.wav"', sound(73, seconds=1.0))
    answer = sent(admin, file, (f"form-data; {disposition}", metadata))
    assert answer.status_code == 201, answer.text
    assert answer.json()["recording"]["gearbox"] == "würze"


def test_json_and_toml_bodies_may_begin_with_a_byte_order_mark(admin: httpx.Client) -> None:
    json_type, toml_type = ({"Content-Type": f"application/{kind}"} for kind in ("json", "toml"))
    key = admin.post("/api/v1/keys", content=MARK + b'{"name": "marked", "role": "viewer"}', headers=json_type)
    assert key.status_code == 201
    toml = b'name = "marked"\r\n[motor]\r\ninertia_kg_m2 = 0.6\r\n[load]\r\ninertia_kg_m2 = 20\r\n'
    assert admin.post("/api/v1/axes", content=MARK + toml, headers=toml_type).status_code == 201
    made = admin.post(DIAGNOSES, files={"file": ("x.wav", sound(74))}).raise_for_status().json()
    body = MARK + json.dumps({"diagnosis_id": made["id"], "label": "normal"}).encode()
    answer = admin.post("/api/v1/cases", content=body, headers=json_type)
    assert answer.status_code == 201, answer.text
    admin.delete(f"/api/v1/cases/{answer.json()['id']}").raise_for_status()


def test_body_that_is_no_text_is_a_problem(admin: httpx.Client) -> None:
    answer = admin.post("/api/v1/cases", content=b"\xff\xfe\xff", headers={"Content-Type": "application/json"})
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")


def open_files(server: LiveServer) -> list[str]:
    """What the service has open of files that have no name any more, as uploads have."""
    assert server.process is not None
    folder = Path(f"/proc/{server.process.pid}/fd")
    links = []
    for each in folder.iterdir():
        try:
            links.append(os.readlink(each))
        except FileNotFoundError:
            continue
    return [link for link in links if link.endswith("(deleted)")]


@pytest.mark.parametrize(
    ("path", "kind", "body"),
    [
        (DIAGNOSES, TYPE["Content-Type"], form(('form-data; name="file"; filename="x.wav"', bytes(3_000_000)))[:-20]),
        ("/api/v1/cases", TYPE["Content-Type"], b""),
        ("/api/v1/keys", "application/json", b'{"name": '),
    ],
)
def test_client_that_leaves_in_mid_upload_is_499_and_no_error(
    live_server: LiveServer, path: str, kind: str, body: bytes
) -> None:
    address = urlsplit(live_server.url)
    name = f"left-{path.rsplit('/', 1)[-1]}"
    before = len(live_server.log())
    with live_server.client() as client:
        recordings = [each["recording"]["id"] for each in client.get(DIAGNOSES).json()["items"]]
        keys = len(client.get("/api/v1/keys").json()["items"])
    assert address.hostname is not None
    with socket.create_connection((address.hostname, address.port or 80)) as connection:
        head = (
            f"POST {path} HTTP/1.1",
            f"Host: {address.netloc}",
            f"Authorization: Bearer {live_server.keys['admin']}",
            f"X-Request-ID: {name}",
            f"Content-Type: {kind}",
            f"Content-Length: {len(body) + (900_000 if kind == TYPE['Content-Type'] else 100)}",
        )
        connection.sendall("\r\n".join((*head, "", "")).encode() + body)
    entry = json.loads(live_server.logged(name))
    assert (entry["event"], entry["status"], entry["level"]) == ("request", 499, "info")
    written = live_server.log()[before:]
    assert "Traceback" not in written
    assert '"level": "error"' not in written
    with live_server.client() as client:
        assert f'route="{path.removeprefix("/api/v1")}",status="499"' in client.get("/metrics").text
        assert [each["recording"]["id"] for each in client.get(DIAGNOSES).json()["items"]] == recordings
        assert len(client.get("/api/v1/keys").json()["items"]) == keys
    assert not list((live_server.data_dir / "incoming").glob("*"))
    assert not open_files(live_server)
