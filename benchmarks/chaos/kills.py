"""Random kills under load: nothing that was acknowledged is lost, nothing is doubled, nothing is left behind.

Clients order over HTTP, each thing under a key of its own, again and again until it is acknowledged. Meanwhile the
service, its worker, or both are killed with -9 and started again.
"""

import os
import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import httpx
from sqlalchemy import func, select

from app.http.middleware import Metrics
from app.jobs.jobs import OVER
from app.service import Service
from app.settings import Settings
from benchmarks.chaos.orders import API, Options, ghosts, investigation, simulation, upload
from benchmarks.harness.live import LiveServer, started
from casebase.store.models import Case, StoredDiagnosis, StoredInvestigation, StoredJob

CLIENTS = 3
CASES_OF_A_SIMULATION = 2
KINDS: dict[str, Callable[[int], Options]] = {
    "cases": lambda seed: upload(seed, label=("normal", "notch")[seed % 2], gearbox=f"g{seed % 5}"),
    "diagnoses": lambda seed: upload(seed),
    "simulations": lambda seed: simulation(seed, CASES_OF_A_SIMULATION),
    "investigations": lambda seed: investigation(1.0 + seed / 1e6),
}
OFTEN = ("cases", "cases", "diagnoses", "diagnoses", "simulations", "investigations")
AGAIN_S = 0.2
ENDING_S = 600.0


@dataclass
class Load:
    """Clients that order until they are told to stop."""

    server: LiveServer
    seed: int
    kinds: Sequence[str] = OFTEN
    stop: threading.Event = field(default_factory=threading.Event)
    acknowledged: dict[str, tuple[str, str]] = field(default_factory=dict)
    """By key: the kind, and where it is."""
    refused: list[str] = field(default_factory=list)
    repeated: int = 0

    def order(self, number: int) -> None:
        chance = random.Random(f"{self.seed} {number}")
        headers = {"Authorization": f"Bearer {self.server.keys['admin']}"}
        count = 0
        while not self.stop.is_set():
            count += 1
            kind, key = chance.choice(self.kinds), f"{number}-{count}"
            self._until_acknowledged(kind, key, KINDS[kind](1 + 100_000 * number + count), headers)

    def _until_acknowledged(self, kind: str, key: str, options: Options, headers: dict[str, str]) -> None:
        first = True
        while True:
            try:
                answer = httpx.post(
                    f"{self.server.url}{API}/{kind}",
                    headers={**headers, "Idempotency-Key": key},
                    timeout=60.0,
                    **options,
                )
            except httpx.TransportError:
                first = False
                time.sleep(AGAIN_S)
                continue
            if answer.status_code == 503:
                time.sleep(AGAIN_S)
                continue
            if answer.status_code >= 400:
                self.refused.append(f"{kind} {key}: {answer.status_code} {answer.text[:300]}")
            else:
                self.acknowledged[key] = (kind, answer.headers["location"])
                self.repeated += not first
            return


def run(folder: Path, url: str | None, *, kills: int, seconds: float, seed: int) -> tuple[str, list[str]]:
    """Kill so many times, or for so long; what was done in words, and what was wrong."""
    environment = {"GEARCASE_LEASE_S": "3"} | ({} if url is None else {"GEARCASE_DATABASE_URL": url})
    server = started(folder / "data", worker=True, **environment)
    load, chance = Load(server, seed), random.Random(seed)
    clients = [threading.Thread(target=load.order, args=(number,)) for number in range(CLIENTS)]
    for client in clients:
        client.start()
    until, done = time.monotonic() + seconds, Counter[str]()
    try:
        while sum(done.values()) < kills and time.monotonic() < until:
            time.sleep(chance.uniform(0.5, 4.0))
            done[_kill(server, chance)] += 1
        load.stop.set()
        for client in clients:
            client.join()
        server.kill_all()
        server.start()
        wrong = [*load.refused, *_ended(server)]
        wrong += _compared(server, load, Settings(data_dir=server.data_dir, database_url=url))
    finally:
        load.stop.set()
        if server.running:
            server.kill_all()
    kinds = Counter(kind for kind, _ in load.acknowledged.values())
    words = f"{sum(done.values())} kills ({dict(done)}); acknowledged {dict(kinds)}, {load.repeated} after a repetition"
    return words, wrong


def _kill(server: LiveServer, chance: random.Random) -> str:
    """Kill the service, its worker, or both, and see that all are there again."""
    what = chance.choice(("both", "service", "worker"))
    if what == "both":
        server.kill_all()
        server.start()
    elif what == "service":
        server.kill()
        server.start()
    else:
        for worker in _workers(server):
            os.kill(worker, signal.SIGKILL)
    return what


def _workers(server: LiveServer) -> Iterator[int]:
    """Processes of the service's group that are workers."""
    assert server.process is not None
    for status in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = status.read_bytes().split(b"\0")
            group = os.getpgid(int(status.parent.name))
        except (OSError, ProcessLookupError):
            continue
        if b"worker" in words and group == server.process.pid:
            yield int(status.parent.name)


def _ended(server: LiveServer) -> Iterator[str]:
    """Wait until every job is over; those that are not, or not well."""
    until = time.monotonic() + ENDING_S
    with server.client() as client:
        while True:
            jobs, cursor = [], None
            while True:
                page = client.get(f"{API}/jobs", params={"limit": 200, **({"cursor": cursor} if cursor else {})}).json()
                jobs += page["items"]
                cursor = page["next_cursor"]
                if cursor is None:
                    break
            if all(job["state"] in OVER for job in jobs) or time.monotonic() > until:
                yield from (
                    f"job {job['id']} is {job['state']}: {job['error']}" for job in jobs if job["state"] != "done"
                )
                return
            time.sleep(1.0)


def _compared(server: LiveServer, load: Load, settings: Settings) -> Iterator[str]:
    """Hold what is there against what was acknowledged."""
    ordered = Counter(kind for kind, _ in load.acknowledged.values())
    with server.client() as client:
        for key, (kind, location) in load.acknowledged.items():
            if client.get(location).status_code != 200:
                yield f"lost: {kind} {key} at {location}"
    service = Service.open(settings, Metrics())
    with service.library.reading() as session:

        def rows(table: type[object], *conditions: object) -> int:
            return session.scalar(select(func.count()).select_from(table).where(*conditions)) or 0  # type: ignore[arg-type]

        there = {
            "cases": rows(Case, Case.origin == "measured"),
            "diagnoses": rows(StoredDiagnosis),
            "investigations": rows(StoredInvestigation),
            "simulations": rows(StoredJob, StoredJob.kind == "simulations"),
        }
        simulated = rows(Case, Case.origin == "simulated")
    for kind, count in there.items():
        if count != ordered[kind]:
            yield f"{kind}: {count} are there, {ordered[kind]} were acknowledged"
    if simulated != CASES_OF_A_SIMULATION * ordered["simulations"]:
        yield f"{simulated} simulated cases of {ordered['simulations']} campaigns of {CASES_OF_A_SIMULATION}"
    yield from ghosts(service)
    service.close()
