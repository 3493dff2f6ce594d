"""Wrong inputs of every kind through HTTP, while somebody watches that the service lives and how large it becomes."""

import json
import re
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import numpy as np

from app.http.security import COOKIE, csrf_token
from benchmarks.bombs.bodies import AXIS
from benchmarks.bombs.inputs import API, Inputs, Sent
from benchmarks.harness.live import LiveServer, sign_in
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
        seconds: kind of a client's request -> how long each took [s].
    """

    answers: Counter[tuple[str, int]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    live_s: list[float] = field(default_factory=list)
    seconds: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
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

    def run(self, count: int, *, alone: bool = True) -> None:
        """Send so many inputs, as many of each kind, and, where nobody else sends anything, the bombs."""
        made = self.inputs.bombs() if alone else []
        before = memory_bytes(self.server)
        forget_peak(self.server)
        with self.watched(), self.server.client() as client, self.browser() as browser:
            for sent in made:
                self.send("bomb", [sent], client, browser, alone)
            for number in range(0, count, self.batch):
                kind = list(self.inputs.kinds)[number // self.batch % len(self.inputs.kinds)]
                batch = [self.inputs.kinds[kind]() for _ in range(min(self.batch, count - number))]
                self.send(kind, batch, client, browser, alone)
        self.tally.grown_bytes = max(self.tally.grown_bytes, peak_bytes(self.server) - before)
        self.tally.left_bytes = memory_bytes(self.server) - before

    def send(self, kind: str, batch: list[Sent], client: httpx.Client, browser: httpx.Client, alone: bool) -> None:
        """Send inputs, note their answers, and whether something was stored although all were refused."""
        before, taken = self.stored(client), False
        for sent in batch:
            given = dict(sent.given)
            if sent.form:
                given["data"] = {**given.get("data", {}), "csrf": csrf_token(browser.cookies[COOKIE])}
            answer = (browser if sent.form else client).request(sent.method, sent.path, **given)
            self.tally.answers[kind, answer.status_code] += 1
            taken = taken or answer.status_code < 400
            if answer.status_code == 503 and not alone:
                continue
            if answer.status_code >= 500:
                self.tally.faults.append(f"{kind}: {answer.status_code} for {str(sent.given)[:300]}")
            elif answer.status_code >= 400 and not REFUSED_AND_SAID.search(answer.text):
                self.tally.faults.append(f"{kind}: {answer.status_code} says nothing: {answer.text[:200]}")
        if alone and not taken and self.stored(client) != before:
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
    def crowd(self, listeners: int, clients: int) -> Iterator[None]:
        """So many listen to a job; so many send recordings, read pages and look at spectrograms, again and again."""
        done = threading.Event()
        with self.server.client() as client, ExitStack() as stack:
            job = client.post(f"{API}/simulations", json={"axis": AXIS, "per_label": 1}).raise_for_status()
            for _ in range(listeners):
                listener = stack.enter_context(connected(self.server))
                listener.sendall(head(self.server, "GET", f"{job.headers['location']}/events", "admin"))
            made = client.post(f"{API}/diagnoses", files=files(5)).raise_for_status().json()
            threads = [threading.Thread(target=self.work, args=(number, made, done)) for number in range(clients)]
            for thread in threads:
                thread.start()
            try:
                yield
            finally:
                done.set()
                for thread in threads:
                    thread.join()
                client.delete(job.headers["location"])

    def work(self, number: int, known: dict[str, Any], done: threading.Event) -> None:
        """What one client does until all are done; where it is refused with `Retry-After` it comes again."""
        random = np.random.default_rng(number)
        pages = ("/fleet", "/diagnoses", "/diagnoses/{}", "/queue", "/library", "/axes", "/library/coverage")
        name = f"client {number}"
        with self.server.client() as admin:
            made = admin.post(f"{API}/keys", json={"name": name, "role": "admin"}).raise_for_status().json()
        self.server.keys[name] = made["key"]
        with self.server.client(name) as client, self.server.client(None) as browser:
            sign_in(browser, made["key"])
            while not done.is_set():
                kind = what = str(random.choice(("diagnosis", "case", "page", "spectrogram"), p=(0.3, 0.1, 0.55, 0.05)))
                began = time.monotonic()
                try:
                    if kind == "page":
                        what = pages[random.integers(len(pages))]
                        answer = browser.get(what.format(known["id"]), headers={"Accept": "text/html"})
                    elif kind == "spectrogram":  # no two alike: none is cached
                        recording, columns = known["recording"]["id"], random.integers(10, 2000)
                        answer = client.get(f"{API}/recordings/{recording}/spectrogram?columns={columns}")
                    else:
                        about = {"gearbox": f"g{random.integers(5)}", **({"label": "normal"} if kind == "case" else {})}
                        sent = {**files(int(random.integers(1 << 30))), "metadata": (None, json.dumps(about))}
                        answer = client.post(f"{API}/{'cases' if kind == 'case' else 'diagnoses'}", files=sent)
                except httpx.TransportError as error:
                    self.tally.faults.append(f"{kind}: {error!r}")
                    continue
                known = answer.json() if answer.is_success and kind == "diagnosis" else known
                self.tally.answers[kind, answer.status_code] += 1
                self.tally.seconds[what].append(time.monotonic() - began)
                if answer.status_code == 503 and "retry-after" in answer.headers:
                    done.wait(float(answer.headers["retry-after"]))
                elif not answer.is_success:
                    self.tally.faults.append(f"{kind}: {answer.status_code} {answer.text[:200]}")


def files(seed: int) -> dict[str, Any]:
    """Parts of a request with a recording of its own."""
    return {"file": ("seen.wav", sound(seed, seconds=8.0), "audio/wav")}
