"""Random kills under load: nothing that was acknowledged is lost, nothing is doubled, nothing is left behind.

Clients order over HTTP, each thing under a key of its own, again and again until it is acknowledged; they import,
export and erase. Alarms go to a webhook that is not always well, and backups are made. Meanwhile the service, its
worker, or both are killed with -9 and started again.
"""

import os
import random
import re
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import psycopg
from sqlalchemy import func, make_url, select
from sqlalchemy.orm import Session

from app.http.middleware import Metrics
from app.http.security import COOKIE, csrf_token
from app.jobs.jobs import OVER
from app.service import Service
from app.settings import Settings
from benchmarks.chaos.copies import Acknowledged, Copies, checked, files
from benchmarks.chaos.orders import API, Options, bundle, ghosts, investigation, simulation, upload
from benchmarks.chaos.webhook import Webhook
from benchmarks.harness import postgres
from benchmarks.harness.live import LiveServer, started
from casebase.alarms.outbox import KIND as DELIVERIES
from casebase.store.models import Case, Delivery, StoredDiagnosis, StoredInvestigation, StoredJob, StoredRecording

CLIENTS = 3
CASES_OF_A_SIMULATION = 2
CASES_OF_A_BUNDLE = 2
RULES = ("diagnosed", "ambiguous", "not_in_library", "unusable")
KINDS: dict[str, Callable[[int], Options]] = {
    "cases": lambda seed: upload(seed, label=("normal", "notch")[seed % 2], gearbox=f"g{seed % 5}"),
    "diagnoses": lambda seed: upload(seed, gearbox=f"d{seed}"),
    "simulations": lambda seed: simulation(seed, CASES_OF_A_SIMULATION),
    "investigations": lambda seed: investigation(1.0 + seed / 1e6),
}
OFTEN = ("cases", "cases", "diagnoses", "diagnoses", "simulations", "investigations", "erasures", "imports", "exports")
AGAIN_S = 0.2
ENDING_S = 600.0
AWAY = 0.15
LASTING = re.compile(r"audio/../[0-9a-f]{62}|gearcase\.db(-wal|-shm)?|workers/[^/]+")
"""Files of a data folder whose service has ended; those of `audio` are held against the rows."""


@dataclass
class Load:
    """Clients that order until they are told to stop."""

    server: LiveServer
    seed: int
    stop: threading.Event = field(default_factory=threading.Event)
    known: Acknowledged = field(default_factory=Acknowledged)
    refused: list[str] = field(default_factory=list)
    repeated: int = 0
    session: str = ""

    def __post_init__(self) -> None:
        self.session = self.server.session("admin")[COOKIE]

    def order(self, number: int) -> None:
        chance = random.Random(f"{self.seed} {number}")
        count = 0
        while not self.stop.is_set():
            count += 1
            kind, key, seed = chance.choice(OFTEN), f"{number}-{count}", 1 + 100_000 * number + count
            if kind == "imports":
                self._import(key, seed)
            elif kind == "exports":
                self._page("get", "/library/export.zip", params={"label": "notch"})
            else:
                made = self._make("diagnoses" if kind == "erasures" else kind, key, seed)
                if kind == "erasures" and made:
                    self._erase(str(made["recording"]["id"]), upload(seed)["files"]["file"][1])

    def _make(self, kind: str, key: str, seed: int) -> Any:
        answer = self._acknowledged("post", f"{API}/{kind}", headers={"Idempotency-Key": key}, **KINDS[kind](seed))
        if answer is None:
            return None
        self.known.made[key] = (kind, [answer.headers["location"].rpartition("/")[2]])
        return answer.json()

    def _erase(self, recording: str, sound: bytes) -> None:
        if self._acknowledged("delete", f"{API}/recordings/{recording}"):
            self.known.erased[recording] = sound

    def _import(self, key: str, seed: int) -> None:
        """It has no key of its own: what is there already stays."""
        hashes, packed = bundle(seed + 50_000 * place for place in range(CASES_OF_A_BUNDLE))
        form = {"files": {"file": ("cases.zip", packed)}, "data": {"csrf": csrf_token(self.session)}}
        if self._page("post", "/library/import", **form):
            self.known.made[key] = ("imports", hashes)

    def _page(self, method: str, path: str, **options: Any) -> httpx.Response | None:
        headers = {"Accept": "text/html", "Cookie": f"{COOKIE}={self.session}"}
        return self._acknowledged(method, path, headers=headers, **options)

    def _acknowledged(self, method: str, path: str, *, headers: Any = None, **options: Any) -> httpx.Response | None:
        """Ask again and again until there is an answer; None where it is a refusal."""
        headers = headers or {}
        if "Cookie" not in headers:
            headers["Authorization"] = f"Bearer {self.server.keys['admin']}"
        first = True
        while True:
            try:
                answer = httpx.request(method, self.server.url + path, headers=headers, timeout=60.0, **options)
            except httpx.TransportError:
                first = False
                time.sleep(AGAIN_S)
                continue
            if answer.status_code == 503:
                time.sleep(AGAIN_S)
                continue
            if answer.status_code >= 400:
                self.refused.append(f"{method} {path}: {answer.status_code} {answer.text[:300]}")
                return None
            self.repeated += not first
            return answer


def run(folder: Path, server_url: str | None, *, kills: int, seconds: float, seed: int) -> tuple[str, list[str]]:
    """Kill so many times, or for so long; what was done in words, and what was wrong."""
    url = None if server_url is None else postgres.create_database(server_url, "chaos")
    temporary = folder / "temporary"
    temporary.mkdir()
    environment = {"GEARCASE_LEASE_S": "3", "GEARCASE_WEBHOOK_NETWORKS": "127.0.0.1/32", "TMPDIR": str(temporary)}
    environment |= {} if url is None else {"GEARCASE_DATABASE_URL": url}
    server = started(folder / "data", worker=True, **environment)
    load, chance, hook = Load(server, seed), random.Random(seed), Webhook(random.Random(seed))
    copies = Copies(server.data_dir, server_url, url, load.known, random.Random(seed), load.stop)
    hook.open()
    _rules(server, hook.port)
    clients = [threading.Thread(target=load.order, args=(number,)) for number in range(CLIENTS)]
    clients.append(threading.Thread(target=copies.keep_on))
    for client in clients:
        client.start()
    until, done = time.monotonic() + seconds, Counter[str]()
    try:
        while sum(done.values()) < kills and time.monotonic() < until:
            hook.close()
            if chance.random() >= AWAY:
                hook.open()
            time.sleep(chance.uniform(0.5, 6.0))
            done[_kill(server, chance)] += 1
        load.stop.set()
        for client in clients:
            client.join()
        hook.close()
        hook.well = True
        hook.open()
        server.kill_all()
        server.start()
        wrong = [*load.refused, *_ended(server), *_sent(server)]
        server.stop()
        wrong += _compared(Settings(data_dir=server.data_dir, database_url=url), load, hook)
        wrong += checked(server.data_dir, url, load.known)
        wrong += _left(server.data_dir, [temporary, *_folders_of(server_url)], load.known)
        wrong += copies.restored()
    finally:
        load.stop.set()
        hook.close()
        if server.running:
            server.kill_all()
    kinds = Counter(kind for kind, _ in load.known.made.values())
    twice = sum(len(bodies) > 1 for bodies in hook.taken.values())
    words = (
        f"{sum(done.values())} kills ({dict(done)}); acknowledged {dict(kinds)}, {len(load.known.erased)} erased, "
        f"{load.repeated} after a repetition; {len(hook.taken)} alarms, {twice} more than once; {dict(copies.done)}"
    )
    return words, wrong


def _rules(server: LiveServer, port: int) -> None:
    """Have every verdict told."""
    with server.client() as client:
        hook = {"name": "hook", "kind": "webhook", "address": f"http://127.0.0.1:{port}/"}
        receiver = client.post(f"{API}/alarms/receivers", json=hook).raise_for_status().json()["id"]
        for verdict in RULES:
            rule = {"name": verdict, "kind": "state", "verdict": verdict, "receivers": [receiver]}
            client.post(f"{API}/alarms/rules", json=rule).raise_for_status()


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


def _all(client: httpx.Client, path: str) -> Iterator[Any]:
    cursor = None
    while True:
        page = client.get(path, params={"limit": 200, **({"cursor": cursor} if cursor else {})}).json()
        yield from page["items"]
        cursor = page["next_cursor"]
        if cursor is None:
            return


def _ended(server: LiveServer) -> Iterator[str]:
    """Wait until every job is over but those that send; those that are not, or not well."""
    until = time.monotonic() + ENDING_S
    with server.client() as client:
        while True:
            jobs = [each for each in _all(client, f"{API}/jobs") if each["kind"] != DELIVERIES]
            if all(job["state"] in OVER for job in jobs) or time.monotonic() > until:
                yield from (
                    f"job {job['id']} is {job['state']}: {job['error']}" for job in jobs if job["state"] != "done"
                )
                return
            time.sleep(1.0)


def _sent(server: LiveServer) -> Iterator[str]:
    """Have every message that waits sent now; those that are not sent."""
    until = time.monotonic() + ENDING_S
    with server.client() as client:
        while open_ := [each for each in _all(client, f"{API}/alarms/deliveries") if each["state"] != "sent"]:
            if time.monotonic() > until:
                yield from (f"lost: message {each['id']} is {each['state']}: {each['error']}" for each in open_)
                return
            for each in open_:
                if each["next_at"]:
                    client.post(f"{API}/alarms/deliveries/{each['id']}/retry")
            time.sleep(1.0)


def _compared(settings: Settings, load: Load, hook: Webhook) -> Iterator[str]:
    """Hold what is there against what was acknowledged and what was received."""
    service = Service.open(settings, Metrics())
    with service.library.reading() as session:

        def rows(table: type[object], *conditions: object) -> int:
            return session.scalar(select(func.count()).select_from(table).where(*conditions)) or 0  # type: ignore[arg-type]

        ordered = {kind: load.known.count(kind) for kind in (*KINDS, "imports")}
        measured = ordered["cases"] + CASES_OF_A_BUNDLE * ordered["imports"]
        simulated = CASES_OF_A_SIMULATION * ordered["simulations"]
        compared = {
            "measured cases": (rows(Case, Case.origin == "measured"), measured),
            "simulated cases": (rows(Case, Case.origin == "simulated"), simulated),
            "recordings": (rows(StoredRecording), measured + simulated + ordered["diagnoses"]),
            "diagnoses": (rows(StoredDiagnosis), ordered["diagnoses"]),
            "investigations": (rows(StoredInvestigation), ordered["investigations"]),
            "simulations": (rows(StoredJob, StoredJob.kind == "simulations"), ordered["simulations"]),
        }
        yield from _told(session, hook)
    for what, (there, wanted) in compared.items():
        if there != wanted:
            yield f"{what}: {there} are there, {wanted} were acknowledged"
    yield from ghosts(service)
    service.close()


def _told(session: Session, hook: Webhook) -> Iterator[str]:
    """Whether each verdict but a sound one was told of its gearbox, once, and by one message however often it came."""
    told = session.scalars(select(Delivery)).all()
    for each in told:
        if each.id not in hook.taken:
            yield f"lost: message {each.id} is {each.state} and never arrived"
    yield from (f"message {each} is of no row" for each in hook.taken.keys() - {each.id for each in told})
    yield from (f"message {each} came as {set(bodies)}" for each, bodies in hook.taken.items() if len(set(bodies)) > 1)
    about = Counter((each.message["rule"], each.message["gearbox"]) for each in told)
    yield from (f"doubled: {place} was told {count} times" for place, count in about.items() if count > 1)
    heard = select(StoredDiagnosis.verdict, StoredRecording.gearbox).join(StoredDiagnosis.recording)
    meant = {(verdict, gearbox) for verdict, gearbox in session.execute(heard) if verdict != "diagnosed"}
    yield from (f"lost: {place} was never told" for place in meant - about.keys())
    others = {place for place in about if place[0] != "diagnosed"} - meant
    yield from (f"{place} was told and is not so" for place in others)


def _left(data_dir: Path, others: Sequence[Path], known: Acknowledged) -> Iterator[str]:
    """Files that nobody speaks of, and those elsewhere that have erased sound."""
    names = (str(path.relative_to(data_dir)) for path in files([data_dir]))
    yield from (f"left: {name}" for name in names if not LASTING.fullmatch(name))
    yield from (f"left: {path}" for path in files(others[:1]))
    yield from (f"bytes of the erased recording {each} are in {path}" for each, path in known.showing(others))


def _folders_of(server_url: str | None) -> list[Path]:
    """The folder of PostgreSQL, with everything on disk."""
    if server_url is None:
        return []
    with psycopg.connect(server_url, autocommit=True) as connection:
        connection.execute("CHECKPOINT")
    return [Path(str(make_url(server_url).query["host"])) / "data"]
