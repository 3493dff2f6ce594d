"""Every write of every order as a crash point: killed there, started again, ordered again; there is to be one of it.

Each attempt is a process of its own, forked from this one, which has imported the service and has no threads and no
connections; its database and folder are copies of a filled one.
"""

import asyncio
import itertools
import json
import logging
import os
import random
import shutil
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import httpx
import structlog
from pydantic import SecretStr

from app.http.middleware import Metrics
from app.http.security import COOKIE, csrf_token
from app.jobs.job import JobKind, Json, Report
from app.jobs.jobs import Jobs
from app.jobs.runner import LANES, Worker
from app.main import attach, create_app
from app.service import Service
from app.settings import Settings
from benchmarks.chaos.orders import ORDERS, PAGES, Known, Options, counts, fill, ghosts
from benchmarks.chaos.points import CrashPoint
from benchmarks.harness import postgres
from casebase.library import CaseLibrary
from casebase.store import leases

MOST_POINTS = 400
APP = create_app(Settings())
"""Made once, and asked once by `warm_up`: else every process would put the routes together for itself."""
Work = Callable[[Service], Json]


@dataclass(frozen=True)
class Ground:
    """A filled database and folder, and how to get a copy of them."""

    folder: Path
    server: str | None

    @property
    def filled(self) -> Path:
        return self.folder / "filled"

    def settings(self, data_dir: Path) -> Settings:
        url = None if self.server is None else self.server.replace("/postgres?", f"/{data_dir.name}?")
        return Settings(data_dir=data_dir, database_url=url, mqtt_url=SecretStr("mqtt://127.0.0.1:9"))

    @contextmanager
    def copy(self, number: int) -> Iterator[Settings]:
        data_dir = self.folder / f"copy_{number}"
        shutil.copytree(self.filled, data_dir)
        if self.server is not None:
            postgres.create_database(self.server, data_dir.name, "filled")
        try:
            yield self.settings(data_dir)
        finally:
            shutil.rmtree(data_dir, ignore_errors=True)
            if self.server is not None:
                postgres.drop_database(self.server, data_dir.name)


@dataclass(frozen=True)
class Ended:
    """How a forked process ended: what it gave, None where it was killed."""

    given: Any
    code: int

    @property
    def killed(self) -> bool:
        return self.code == -signal.SIGKILL


def apart(settings: Settings, work: Work, *, tidy: bool = True) -> Ended:
    """Do something with the service in a process of its own."""
    assert threading.active_count() == 1, "a fork takes only its own thread along, and others' locks"
    reading, writing = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        code = 1
        try:
            service = Service.open(settings, Metrics())
            if tidy:
                service.tidy()
            os.write(writing, json.dumps(work(service)).encode())
            code = 0
        except BaseException:  # noqa: BLE001 - a forked process must not go on as its parent
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return Ended(json.loads(said) if said else None, code)


def asked(service: Service, known: Known, path: str, options: Options, point: CrashPoint | None = None) -> Any:
    """Send a request, of a page where it has a form of one; its status, headers and JSON."""
    app = APP
    attach(app, service)
    headers = {"Authorization": f"Bearer {known.key}", "Idempotency-Key": "once"}
    if not path.startswith("/api/"):
        headers = {"Accept": "text/html", "Cookie": f"{COOKIE}={known.session}"}
        options = {**options, "data": {"csrf": csrf_token(known.session), **options["data"]}}

    async def run() -> httpx.Response:
        transport = httpx.ASGITransport(point.answering(app) if point else app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://chaos", headers=headers) as client:
            if point:
                point.armed = True
            return await client.post(path, **options)

    answer = asyncio.run(run())
    if answer.status_code >= 400:
        raise AssertionError(f"{path}: {answer.status_code} {answer.text[:500]}")
    location = answer.headers.get("location")
    return {"status": answer.status_code, "location": location, "replay": "idempotent-replay" in answer.headers}


def state(service: Service) -> Any:
    with service.library.reading() as session:
        return {"counts": counts(session), "ghosts": list(ghosts(service))}


@dataclass
class Tally:
    """What was tried, and what was not as it should be."""

    points: int = 0
    of: int = 0
    wrong: list[str] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        self.wrong = self.wrong or []


@dataclass(frozen=True)
class Crashes:
    """Crash points of one database."""

    ground: Ground
    known: Known
    numbers: Iterator[int]
    until: float
    chance: random.Random

    def order(self, name: str, most: int) -> Tally:
        """Crash points of one order."""
        path, options = {**ORDERS, **PAGES}[name](self.known)
        page = name in PAGES

        def whole(service: Service) -> Json:
            point = CrashPoint(0)
            point.install()
            first = asked(service, self.known, path, options, point)
            point.armed = False
            return {"passed": list(point.passed), "state": state(service), "answer": first}

        def begun(service: Service, at: int) -> Json:
            point = CrashPoint(at)
            point.install()
            asked(service, self.known, path, options, point)
            return None

        def again(service: Service) -> Json:
            if page:
                return {"state": state(service)}
            answers = [asked(service, self.known, path, options) for _ in range(2)]
            return {"state": state(service), "answers": answers}

        with self.ground.copy(next(self.numbers)) as settings:
            before = apart(settings, state).given
            once = apart(settings, whole).given
        assert once is not None, f"{name} does not work even when nobody is killed"
        wanted = once["state"]
        tally = Tally(of=len(once["passed"]), wrong=[f"{name}, nobody killed: {each}" for each in wanted["ghosts"]])
        for at in self._some(len(once["passed"]), most):
            where = f"{name}, killed at {at} ({once['passed'][at - 1]})"
            with self.ground.copy(next(self.numbers)) as settings:
                first = apart(settings, lambda service, at=at: begun(service, at))  # type: ignore[misc]
                then = apart(settings, again)
            tally.points += 1
            if not first.killed and first.code:
                tally.wrong.append(f"{where}: the process failed instead of being killed")
            if then.given is None:
                tally.wrong.append(f"{where}: not to be had afterwards")
                continue
            found = then.given["state"]
            allowed = (before["counts"], wanted["counts"]) if page else (wanted["counts"],)
            if found["counts"] not in allowed:
                tally.wrong.append(f"{where}: {found['counts']} instead of {wanted['counts']}")
            orphans = "is nobody's" if page else "\0"  # nobody comes back to a page for what was not stored
            tally.wrong += [f"{where}: {each}" for each in found["ghosts"] if orphans not in each]
            if not page and not then.given["answers"][1]["replay"]:
                tally.wrong.append(f"{where}: the repetition was not known")
        return tally

    def job(self, name: str, most: int) -> Tally:
        """Crash points of a worker that does a job, of its end before time, and of going on; then a worker does it."""
        steps = JOBS[name]

        def before(service: Service) -> Json:
            for step in steps[:-1]:
                step(service, None)
            return None

        def begun(service: Service, at: int) -> Json:
            point = CrashPoint(at)
            point.install()
            steps[-1](service, point)
            return list(point.passed)

        def after(service: Service) -> Json:
            jobs = _jobs(service)
            known = jobs.get(JOB)
            if known.state == "cancelled":
                jobs.resume(JOB)
            _worked(service, None)
            job = jobs.get(JOB)
            events, over = jobs.news(JOB)
            gaps = [each.number for each in events] != list(range(len(events)))
            return {"before": known.state, "state": job.state, "result": job.result, "over": over, "gaps": gaps}

        with self.ground.copy(next(self.numbers)) as settings:
            apart(settings, before)
            passed = apart(settings, lambda service: begun(service, 0)).given
        tally = Tally(of=len(passed))
        for at in self._some(len(passed), most):
            where = f"{name}, killed at {at} ({passed[at - 1]})"
            with self.ground.copy(next(self.numbers)) as settings:
                apart(settings, before)
                apart(settings, lambda service, at=at: begun(service, at))  # type: ignore[misc]
                found = apart(settings, after).given
            tally.points += 1
            wanted = {"state": "done", "result": [0, 1, 2], "over": True, "gaps": False}
            if found is None or found.pop("before") not in STATES[name] or found != wanted:
                tally.wrong.append(f"{where}: {found}")
        return tally

    def _some(self, of: int, most: int) -> Iterator[int]:
        chosen = self.chance.sample(range(1, of + 1), min(of, most))
        return itertools.takewhile(lambda _: time.monotonic() < self.until, chosen)


JOB = "chaos-job"
Step = Callable[[Service, CrashPoint | None], None]


def _run(task: dict[str, Json], report: Report) -> Json:
    report("counting", 0.5)
    return task["number"]


KIND = JobKind("count", "counting", lambda _: [{"number": each} for each in range(3)], _run, lambda _, results: results)


def _jobs(service: Service) -> Jobs:
    return Jobs(service.library, (KIND.name,))


def _submitted(service: Service, _: CrashPoint | None) -> None:
    _jobs(service).submit(KIND.name, {}, job_id=JOB)


def _worked(service: Service, point: CrashPoint | None) -> None:
    """A worker that does all there is to do, after those before it have fallen silent."""
    library = CaseLibrary(service.library.engine, service.library.data_dir)
    with service.library.transaction("chaos") as session:
        for lease in leases.held(session):
            leases.end(session, lease.id)
    worker = Worker.begin(library, [KIND], "chaos", threading.Event())
    if point:
        point.armed = True
    while sum(worker.do_one(lane) for lane in LANES):
        pass
    worker.give_back(())


def _armed(do: Callable[[Service], object]) -> Step:
    def step(service: Service, point: CrashPoint | None) -> None:
        if point:
            point.armed = True
        do(service)

    return step


_cancelled = _armed(lambda service: _jobs(service).cancel(JOB))
_resumed = _armed(lambda service: _jobs(service).resume(JOB))
JOBS: dict[str, Sequence[Step]] = {
    "job: done": (_submitted, _worked),
    "job: cancelled": (_submitted, _cancelled),
    "job: resumed": (_submitted, _cancelled, _resumed),
}
STATES = {
    "job: done": ("queued", "running", "done"),
    "job: cancelled": ("queued", "cancelled"),
    "job: resumed": ("queued", "cancelled"),
}
"""What a job may be when its worker, or who asked for it, was killed."""


def warm_up() -> None:
    """Load what every process would load for itself, and have the routes put together.

    The threads of it end with its loop.
    """
    import_module("scipy.stats")
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))

    async def run() -> None:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(APP), base_url="http://chaos") as client:
            (await client.get("/livez")).raise_for_status()

    asyncio.run(run())


@contextmanager
def ground(folder: Path, database: str) -> Iterator[tuple[Ground, Known]]:
    """A filled database of this kind."""
    if database == "sqlite":
        made = Ground(folder, None)
        yield made, _filled(made)
        return
    with postgres.running_server() as server:
        made = Ground(folder, server)
        postgres.create_database(server, "filled")
        yield made, _filled(made)


def _filled(made: Ground) -> Known:
    given = apart(made.settings(made.filled), lambda service: asdict(fill(service))).given
    return Known(**given)


def run(
    folder: Path, database: str, names: Sequence[str], *, most: int = MOST_POINTS, seconds: float = 600.0, seed: int = 0
) -> dict[str, Tally]:
    """Try crash points of these orders on a database, at most so many of each and for so long; what was found."""
    started, found, numbers, chance = time.monotonic(), {}, itertools.count(), random.Random(seed)
    warm_up()
    with ground(folder, database) as (made, known):
        for place, name in enumerate(names, 1):
            until = started + seconds * place / len(names)  # what an order leaves of its share is for the next ones
            crashes = Crashes(made, known, numbers, until, chance)
            found[name] = (crashes.job if name in JOBS else crashes.order)(name, most)
    return found


ALL = (*ORDERS, *PAGES, *JOBS)
