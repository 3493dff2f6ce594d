"""What must hold when many come at once, when somebody is slow, and when the power goes."""

import http.client
import json
import shutil
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import httpx
import pytest

from benchmarks.harness.live import LiveServer, started
from benchmarks.harness.sounds import sound
from sim.experiment.paper_axis import PAPER_AXIS

CASES = "/api/v1/cases"
BOUNDARY = "between"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service under a path of its own, as behind a proxy, that waits 3 s for a body."""
    environment = {"GEARCASE_ROOT_PATH": "/gearcase", "GEARCASE_UPLOAD_TIMEOUT_S": "3"}
    server = started(tmp_path_factory.mktemp("stress") / "data", **environment)
    yield server
    if server.running:
        server.stop()


def add(client: httpx.Client, content: bytes, gearbox: str) -> httpx.Response:
    """Add a case, again where the service is busy and says when to come again."""
    data = {"metadata": json.dumps({"label": "normal", "gearbox": gearbox})}
    while (answer := client.post(CASES, files={"file": ("x.wav", content)}, data=data)).status_code == 503:
        time.sleep(int(answer.headers["retry-after"]))
    return answer


def test_hundred_uploads_at_once_are_all_taken_a_few_at_a_time(server: LiveServer) -> None:
    contents = [sound(seed, seconds=0.5) for seed in range(100)]
    incoming, most, done = server.data_dir / "incoming", 0, threading.Event()

    def watch() -> None:
        nonlocal most
        while not done.is_set():
            most = max(most, len(list(incoming.glob("*"))) if incoming.exists() else 0)
            time.sleep(0.002)

    def send(number: int) -> int:
        with server.client() as client:
            return add(client, contents[number], f"g{number}").status_code

    watcher = threading.Thread(target=watch)
    watcher.start()
    with ThreadPoolExecutor(100) as pool:
        codes = list(pool.map(send, range(100)))
    done.set()
    watcher.join()
    assert codes == [201] * 100
    assert 1 <= most <= 4  # uploads_per_key
    assert not list(incoming.glob("*"))


def test_kill_9_loses_no_acknowledged_upload(server: LiveServer) -> None:
    acknowledged: dict[str, bytes] = {}

    def send(worker: int) -> None:
        with server.client() as client:
            for number in range(1000):
                content = sound(1000 * worker + number, seconds=0.2)
                try:
                    answer = add(client, content, f"g{worker}-{number}")
                except httpx.TransportError:
                    return
                acknowledged[answer.raise_for_status().json()["recording"]["id"]] = content

    threads = [threading.Thread(target=send, args=(worker,)) for worker in range(4)]
    for thread in threads:
        thread.start()
    while len(acknowledged) < 20:
        time.sleep(0.01)
    server.kill()
    for thread in threads:
        thread.join()
    server.start()
    server.until_ready()
    with server.client() as client:
        for recording, content in acknowledged.items():
            assert client.get(f"/api/v1/recordings/{recording}/audio").content == content


def begun(server: LiveServer, role: str = "admin") -> http.client.HTTPConnection:
    """An upload whose body has only begun."""
    connection = http.client.HTTPConnection(urlsplit(server.url).netloc, timeout=60)
    connection.putrequest("POST", f"/gearcase{CASES}")
    connection.putheader("Authorization", f"Bearer {server.keys[role]}")
    connection.putheader("Content-Type", f"multipart/form-data; boundary={BOUNDARY}")
    connection.putheader("Content-Length", str(len(body())))
    connection.endheaders()
    connection.send(body()[:50])
    return connection


def body() -> bytes:
    file = b'Content-Disposition: form-data; name="file"; filename="x.wav"\r\n\r\n' + sound(5, seconds=0.5)
    text = b'Content-Disposition: form-data; name="metadata"\r\n\r\n{"label": "normal"}'
    mark = f"--{BOUNDARY}".encode()
    return mark + b"\r\n" + file + b"\r\n" + mark + b"\r\n" + text + b"\r\n" + mark + b"--\r\n"


def test_slow_uploads_of_one_key_do_not_keep_others_out(server: LiveServer) -> None:
    with server.client() as admin:
        other = admin.post("/api/v1/keys", json={"name": "other", "role": "admin"}).json()["key"]
    slow = [begun(server) for _ in range(8)]
    with httpx.Client(base_url=server.url, headers={"Authorization": f"Bearer {other}"}, timeout=30) as client:
        assert add(client, sound(100_006, seconds=0.5), "g").status_code == 201
    for connection in slow:
        connection.close()


def test_readiness_tells_the_truth(server: LiveServer) -> None:
    away = server.data_dir.with_name("away")
    server.until_ready()
    with server.client(None) as client:
        assert client.get("/readyz").json() == {"status": "ready"}
        shutil.move(server.data_dir, away)
        answer = client.get("/readyz")
        shutil.move(away, server.data_dir)
        assert answer.status_code == 503
        assert "data folder" in answer.json()["detail"]
        assert client.get("/readyz").status_code == 200


def test_behind_a_proxy_that_strips_the_path_or_leaves_it(server: LiveServer) -> None:
    with server.client() as client:
        client.base_url = server.url.removesuffix("/gearcase")
        for number, prefix in enumerate(("", "/gearcase")):
            data = {"metadata": json.dumps({"label": "normal", "gearbox": str(number)})}
            answer = client.post(f"{prefix}{CASES}", files={"file": ("x.wav", sound(200_007 + number))}, data=data)
            assert answer.status_code == 201
            assert answer.headers["location"].startswith(f"/gearcase{CASES}/")
            assert client.get(answer.headers["location"]).status_code == 200
        assert client.put(f"/gearcase{CASES}").headers["allow"] == "GET, POST"
        assert client.get(f"/gearcase{CASES}", params={"colour": "red"}).status_code == 422


def test_stop_finishes_what_has_begun_and_waits_for_no_listener(server: LiveServer) -> None:
    """An upload is taken to its end; a listener to a job that nobody works on, and learning under way, are not."""
    with server.client() as client:
        job = client.post("/api/v1/simulations", json={"axis": PAPER_AXIS.to_mapping(), "per_label": 1})
        address = job.raise_for_status().headers["location"].removeprefix("/gearcase")
        with client.stream("GET", f"{address}/events") as events:
            events.raise_for_status()
            connection = begun(server)
            assert client.get("/livez").status_code == 200  # whoever came before this is being served
            assert server.process is not None
            server.process.send_signal(signal.SIGTERM)
            server.logged("Shutting down")
            connection.send(body()[50:])
            answer = connection.getresponse()
            assert answer.status in (200, 201)  # the sound may be a case of a test before
            assert json.load(answer)["label"] == "normal"
            connection.close()
            assert "event: end" not in list(events.iter_lines())
    assert server.ended() == 0
    assert '"level": "error"' not in server.log().partition('"Shutting down"')[2]
