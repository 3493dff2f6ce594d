"""Wrong inputs of every kind through HTTP, while somebody watches that the service lives and how large it becomes."""

import re
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import httpx

from app.http.security import COOKIE, csrf_token
from benchmarks.bombs.bodies import AXIS
from benchmarks.bombs.inputs import API, Inputs, Sent
from benchmarks.harness.live import LiveServer
from benchmarks.harness.sounds import sound
from benchmarks.harness.wire import connected, forget_peak, head, memory_bytes, peak_bytes

REFUSED_AND_SAID = re.compile(r'"detail"|<h1')


@dataclass
class Tally:
    """What became of the inputs.

    Args:
        answers: kind and status -> count.
        faults: what must not be, one line each.
        live_s: how long each look at `/livez` took [s].
    """

    answers: Counter[tuple[str, int]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    live_s: list[float] = field(default_factory=list)
    grown_bytes: int = 0
    left_bytes: int = 0


@dataclass
class Campaign:
    """One run against one service.

    Args:
        batch: inputs of a kind after which it is looked whether any of those that were refused has left something.
    """

    server: LiveServer
    inputs: Inputs
    batch: int = 20
    tally: Tally = field(default_factory=Tally)

    def run(self, count: int, *, bombs: bool = True) -> None:
        """Send so many inputs, as many of each kind, and the bombs."""
        made = self.inputs.bombs() if bombs else []
        before = memory_bytes(self.server)
        forget_peak(self.server)
        with self.watched(), self.server.client() as client, self.browser() as browser:
            for sent in made:
                self.send("bomb", [sent], client, browser)
            for number in range(0, count, self.batch):
                kind = list(self.inputs.kinds)[number // self.batch % len(self.inputs.kinds)]
                batch = [self.inputs.kinds[kind]() for _ in range(min(self.batch, count - number))]
                self.send(kind, batch, client, browser)
        self.tally.grown_bytes = max(self.tally.grown_bytes, peak_bytes(self.server) - before)
        self.tally.left_bytes = memory_bytes(self.server) - before

    def send(self, kind: str, batch: list[Sent], client: httpx.Client, browser: httpx.Client) -> None:
        """Send inputs, note their answers, and whether something was stored although all were refused."""
        before, taken = self.stored(client), False
        for sent in batch:
            given = dict(sent.given)
            if sent.form:
                given["data"] = {**given.get("data", {}), "csrf": csrf_token(browser.cookies[COOKIE])}
            answer = (browser if sent.form else client).request(sent.method, sent.path, **given)
            self.tally.answers[kind, answer.status_code] += 1
            taken = taken or answer.status_code < 400
            if answer.status_code >= 500:
                self.tally.faults.append(f"{kind}: {answer.status_code} for {str(sent.given)[:300]}")
            elif answer.status_code >= 400 and not REFUSED_AND_SAID.search(answer.text):
                self.tally.faults.append(f"{kind}: {answer.status_code} says nothing: {answer.text[:200]}")
        if not taken and self.stored(client) != before:
            self.tally.faults.append(f"{kind}: a batch that was refused has stored something")

    def stored(self, client: httpx.Client) -> int:
        """The number of the newest entry of the audit log: whatever is stored has one."""
        items = client.get(f"{API}/audit?limit=1").raise_for_status().json()["items"]
        return int(items[0]["id"]) if items else 0

    def browser(self) -> httpx.Client:
        cookies = self.server.session("admin")
        return httpx.Client(base_url=self.server.url, cookies=cookies, headers={"Accept": "text/html"}, timeout=120)

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Look at `/livez` all the while."""
        done = threading.Event()

        def look() -> None:
            # a connection of its own for every look: one that was kept may be closed by either side
            with self.server.client(None, limits=httpx.Limits(max_keepalive_connections=0)) as client:
                while not done.wait(0.1):
                    began = time.monotonic()
                    try:
                        answer = client.get("/livez")
                    except httpx.HTTPError as error:
                        self.tally.faults.append(f"/livez: {error!r}")
                    else:
                        if answer.status_code != 200:
                            self.tally.faults.append(f"/livez: {answer.status_code}")
                    self.tally.live_s.append(time.monotonic() - began)

        watcher = threading.Thread(target=look)
        watcher.start()
        try:
            yield
        finally:
            done.set()
            watcher.join()

    @contextmanager
    def crowd(self, listeners: int, viewers: int) -> Iterator[None]:
        """So many listen to a job, and so many look at spectrograms, again and again."""
        done = threading.Event()
        with self.server.client() as client, ExitStack() as stack:
            job = client.post(f"{API}/simulations", json={"axis": AXIS, "per_label": 1}).raise_for_status()
            for _ in range(listeners):
                listener = stack.enter_context(connected(self.server))
                listener.sendall(head(self.server, "GET", f"{job.headers['location']}/events", "admin"))
            files = {"file": ("seen.wav", sound(5, seconds=30.0), "audio/wav")}
            made = client.post(f"{API}/diagnoses", files=files).raise_for_status().json()
            base = f"{API}/recordings/{made['recording']['id']}"

            def look(number: int) -> None:
                with self.server.client("viewer") as viewer:
                    for turn in range(10**9):
                        if done.is_set():
                            return
                        columns = 10 + (number * 97 + turn) % 1900  # no two alike: none is kept
                        answer = viewer.get(f"{base}/spectrogram?columns={columns}", timeout=600)
                        self.tally.answers["spectrogram", answer.status_code] += 1
                        if answer.status_code != 200:
                            self.tally.faults.append(f"spectrogram: {answer.status_code}")

            threads = [threading.Thread(target=look, args=(number,)) for number in range(viewers)]
            for thread in threads:
                thread.start()
            try:
                yield
            finally:
                done.set()
                for thread in threads:
                    thread.join()
                client.delete(job.headers["location"])
