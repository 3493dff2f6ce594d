"""Jobs survive what happens to workers: kill -9 at any moment, stop, adoption; nothing lost, nothing doubled."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

import psycopg
import pytest
from sqlalchemy import make_url, select
from sqlalchemy.exc import OperationalError
from structlog.testing import capture_logs

from app.jobs import runner
from app.jobs.job import Job, JobError, JobKind, JobNotFoundError, JobState, JobStateError, Json
from app.jobs.jobs import ORDERED, Jobs, job_of
from app.jobs.runner import Worker
from casebase.errors import InvalidCursorError, LeaseLostError, NotFoundError, StaleVersionError
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.backup import backup, restore
from signals.errors import ChannelError
from sim.errors import AxisError

PATIENCE_S = 90.0
LEASE_S = 2.0


@dataclass
class Place:
    """A library, a folder that the tasks write into, and the workers started here."""

    url: str
    folder: Path
    library: CaseLibrary
    jobs: Jobs
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def work(self, name: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "tests.app.jobs.worker", str(self.folder), self.url, name, str(LEASE_S)]
        worker = subprocess.Popen(command)
        self.workers.append(worker)
        return worker

    def submit(self, count: int, seconds: float, **more: int) -> str:
        return self.jobs.submit("count", {"count": count, "seconds": seconds, "folder": str(self.folder), **more})

    def until(self, job_id: str, wanted: Callable[[Job], bool]) -> Job:
        deadline = time.monotonic() + PATIENCE_S
        while not wanted(job := self.jobs.get(job_id)):
            assert time.monotonic() < deadline, f"still {job}"
            time.sleep(0.1)
        return job

    def ended(self, job_id: str) -> Job:
        return self.until(job_id, lambda job: job.state in ("done", "failed", "cancelled"))

    def attempts(self) -> list[str]:
        """Process by process, who began a task."""
        path = self.folder / "attempts"
        return [line.split()[1] for line in path.read_text().splitlines()] if path.exists() else []

    def done(self) -> list[int]:
        return sorted(int(path.name.partition("-")[2]) for path in self.folder.glob("done-*"))


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Place]:
    url = "" if request.param == "sqlite" else request.getfixturevalue("postgres_database_url")
    with ExitStack() as stack:
        library = CaseLibrary.open(tmp_path, url or None)
        stack.callback(library.close)
        here = Place(url, tmp_path, library, Jobs(library, ("count",)))
        stack.callback(lambda: [(worker.kill(), worker.wait()) for worker in here.workers])
        yield here


ON_SQLITE = pytest.mark.parametrize("place", ["sqlite"], indirect=True)
ON_POSTGRES = pytest.mark.parametrize("place", [pytest.param("postgres", marks=pytest.mark.postgres)], indirect=True)
"""What is alike on both is shown on one, for each costs seconds of waiting."""


@ON_POSTGRES
def test_a_killed_worker_loses_nothing_and_doubles_nothing(place: Place) -> None:
    chance = random.Random(7)
    workers = {"a": place.work("a"), "b": place.work("b")}

    def at_work() -> list[str]:
        return [name for name, worker in sorted(workers.items()) if str(worker.pid) in place.attempts()]

    job_id = place.submit(24, 0.1)
    for kill in range(2):
        place.until(job_id, lambda job, done=4 + 8 * kill: job.progress.done >= done and at_work() != [])  # type: ignore[misc]
        time.sleep(chance.uniform(0.0, 0.6))
        victim = chance.choice(at_work())
        workers[victim].kill()
        workers[victim].wait()
        workers[victim] = place.work(victim)
    job = place.ended(job_id)
    assert job.state == "done", job.error
    assert job.result == {"numbers": list(range(24))}
    assert place.done() == list(range(24))
    assert len(place.attempts()) <= 24 + 2, "only what a killed worker had in hand is done again"
    assert len(set(place.attempts())) >= 2, "every one that was killed had work in hand"


@ON_POSTGRES
def test_a_worker_takes_over_from_one_that_is_named_and_from_nobody_before(place: Place) -> None:
    lost = place.work("lost")
    job_id = place.submit(8, 0.2)
    held = place.until(job_id, lambda job: job.progress.done >= 1).worker
    assert held is not None
    _stop(lost, held, place)
    place.work("heir")
    assert held in place.jobs.workers()
    assert place.jobs.adopt(held) >= 1
    assert place.ended(job_id).result == {"numbers": list(range(8))}
    assert place.jobs.adopt(held) == 0
    lost.send_signal(signal.SIGCONT)
    again = place.submit(1, 0.0)
    assert place.ended(again).state == "done"
    assert lost.poll() is None, "one that lost its lease begins anew"


def _stop(worker: subprocess.Popen[bytes], lease: str, place: Place) -> None:
    """Stop it outside of a transaction: PostgreSQL would keep its lease locked for a minute."""
    while True:
        worker.send_signal(signal.SIGSTOP)
        try:
            with place.library.engine.begin() as connection:
                held = select(leases.WorkerLease.id).where(leases.WorkerLease.id == lease)
                connection.execute(held.with_for_update(nowait=True))
        except OperationalError:
            worker.send_signal(signal.SIGCONT)
            time.sleep(0.02)
        else:
            return


@ON_POSTGRES
def test_a_stopped_worker_gives_back_what_it_holds(place: Place) -> None:
    worker = place.work("polite")
    job_id = place.submit(16, 0.1)
    place.until(job_id, lambda job: job.progress.done >= 2)
    worker.send_signal(signal.SIGTERM)
    assert worker.wait(30) == 0
    assert place.jobs.workers() == {}
    assert place.jobs.get(job_id).state == "queued"
    place.work("other")
    assert place.ended(job_id).result == {"numbers": list(range(16))}


@pytest.mark.postgres
def test_a_database_that_is_away_for_longer_than_a_lease_costs_nobody_a_lease(
    postgres_database_url: str, tmp_path: Path
) -> None:
    library = CaseLibrary.open(tmp_path, postgres_database_url)
    jobs = Jobs(library, ("count",))
    place = Place(postgres_database_url, tmp_path, library, jobs)
    worker = place.work("patient")
    try:
        job_id = place.submit(10, 0.2)
        held = place.until(job_id, lambda job: job.progress.done >= 2).worker
        with away(postgres_database_url):
            time.sleep(2 * LEASE_S)
            assert worker.poll() is None
        ended = place.ended(job_id)
        assert (ended.state, place.done()) == ("done", list(range(10)))
        with library.reading() as session:
            assert [each.id for each in leases.held(session)] == [held]
        with away(postgres_database_url):
            worker.send_signal(signal.SIGTERM)
            assert worker.wait(30) == 0, "it ends without a database too"
    finally:
        worker.kill()
        worker.wait()
        library.close()


@contextmanager
def away(url: str) -> Iterator[None]:
    """Nobody reaches this database: connections are broken off and refused."""
    name = str(make_url(url).database)
    with psycopg.connect(url.replace(f"/{name}?", "/postgres?"), autocommit=True) as server:
        server.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS false".encode())
        server.execute("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = %s", (name,))
        yield
        server.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS true".encode())


@pytest.mark.postgres
def test_a_restored_job_goes_on_and_one_that_was_over_is_still_told(postgres_database_url: str, tmp_path: Path) -> None:
    """From PostgreSQL into SQLite."""
    library = CaseLibrary.open(tmp_path / "old", postgres_database_url)
    old = Place(postgres_database_url, tmp_path, library, Jobs(library, ("count",)))
    over, waiting = old.submit(1, 0.0), old.submit(3, 0.0)
    old.jobs.cancel(over)
    backup(library.engine, library.data_dir, tmp_path / "backup")
    library.close()
    restore(tmp_path / "backup", tmp_path / "new")
    library = CaseLibrary.open(tmp_path / "new")
    new = Place("", library.data_dir, library, Jobs(library, ("count",)))
    assert {(job.id, job.state) for job in new.jobs.page().items} == {(over, "cancelled"), (waiting, "queued")}
    assert list(new.jobs.events(over)) == []
    worker = new.work("new")
    try:
        assert new.ended(waiting).result == {"numbers": [0, 1, 2]}
    finally:
        worker.kill()
        worker.wait()
    library.close()


@ON_SQLITE
def test_cancel_then_resume(place: Place) -> None:
    place.work("a")
    job_id = place.submit(20, 0.1)
    place.until(job_id, lambda job: job.progress.done >= 3)
    assert place.jobs.cancel(job_id).state == "cancelled"
    time.sleep(1.0)
    done = place.done()
    time.sleep(1.0)
    assert place.done() == done, "nothing runs on after a cancellation"
    assert 3 <= len(done) < 20
    place.jobs.resume(job_id)
    job = place.ended(job_id)
    assert (job.state, place.done()) == ("done", list(range(20)))
    assert len(place.attempts()) <= 21, "what was done before the cancellation is not done again"
    for refused in (place.jobs.resume, place.jobs.cancel):
        with pytest.raises(JobStateError, match="is done"):
            refused(job_id)


@ON_SQLITE
def test_a_failed_task_fails_the_job_with_its_reason(place: Place) -> None:
    place.work("a")
    job = place.ended(place.submit(30, 0.1, bad=2))
    assert job.state == "failed"
    assert job.error == "task 2: number 2 is bad"
    assert len(place.done()) < 29, "the tasks behind it are not run"


@ON_POSTGRES
def test_history_is_complete_and_can_be_entered_anywhere(place: Place) -> None:
    place.work("a")
    job_id = place.submit(12, 0.15)
    live = list(place.jobs.events(job_id))
    assert [event.number for event in live] == list(range(len(live)))
    fractions = [event.progress.fraction for event in live]
    assert fractions[-1] == 1.0
    assert live[-1].progress.done == 12
    assert len(live) > 2
    assert list(place.jobs.events(job_id, after=1)) == live[2:]
    assert list(place.jobs.events(job_id, after=live[-1].number)) == []


@ON_SQLITE
def test_threads_of_a_worker_do_a_step_once(place: Place) -> None:
    done: list[Json] = []
    for number in range(20):
        place.jobs.submit("count", {"number": number})
    kind = JobKind("count", "", lambda _: [], lambda *_: None, lambda given, _: done.append(given["number"]))
    worker = Worker.begin(place.library, [kind], "threads", Event())
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda _: all(iter(lambda: worker.do_one(("plan", "finish")), False)), range(6)))
    assert sorted(map(str, done)) == sorted(map(str, range(20)))


@ON_SQLITE
@pytest.mark.parametrize("error", [JobError, ChannelError, AxisError, NotFoundError, KeyError])
def test_only_a_fault_of_the_program_leaves_a_trace(place: Place, error: type[Exception]) -> None:
    def refuse(_: dict[str, Json]) -> list[dict[str, Json]]:
        raise error("there is no channel 5")

    place.jobs.submit("count", {})
    worker = Worker.begin(place.library, [JobKind("count", "", refuse, lambda *_: None, lambda *_: None)], "w", Event())
    with capture_logs() as entries:
        worker.do_one(("plan",))
    assert [bool(entry["exc_info"]) for entry in entries] == [error is KeyError]
    assert "no channel 5" in entries[0]["error"]


def test_what_cannot_be(place: Place) -> None:
    with pytest.raises(JobError, match="no job kind 'bake': there are count"):
        place.jobs.submit("bake", {})
    for ask in (place.jobs.get, place.jobs.cancel, place.jobs.resume, lambda name: list(place.jobs.events(name))):
        with pytest.raises(JobNotFoundError):
            ask("nothing")
    states: set[JobState] = {place.jobs.get(place.submit(1, 0.0)).state}
    assert states == {"queued"}


def test_pages_of_jobs_hold_every_job_once_whatever_was_queued_in_the_same_moment(place: Place) -> None:
    made = {place.submit(1, 0.0) for _ in range(7)}
    seen: list[Job] = []
    cursor: str | None = None
    for _ in range(4):
        page = place.jobs.page(limit=2, cursor=cursor)
        seen += page.items
        cursor = page.next_cursor
    assert cursor is None
    assert len(seen) == len(made)
    assert {job.id for job in seen} == made
    assert [job.id for job in seen] == sorted(made, reverse=True)
    with pytest.raises(InvalidCursorError):
        place.jobs.page(cursor="elsewhere")


def worker() -> runner.Worker:
    return runner.Worker(None, None, {}, "lease", 1.0, Event())  # type: ignore[arg-type]


@ON_SQLITE
def test_jobs_are_listed_by_their_subject_without_messages(place: Place) -> None:
    jobs = Jobs(place.library)
    jobs.submit("simulations", {"axis": {"name": "bench"}})
    jobs.submit("imports", {"name": "cases.zip"})
    jobs.submit("deliveries", {})
    with place.library.reading() as session:
        assert [job_of(row).about for row in session.scalars(ORDERED)] == ["bench", "cases.zip"]


def test_work_that_somebody_else_wrote_at_the_same_time_is_done_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last commit of a killed worker may arrive after another has begun its work anew."""
    monkeypatch.setattr(runner, "RETRY_S", 0.0)
    answers = [StaleVersionError("written"), StaleVersionError("written"), None]

    def work(value: int) -> int:
        if (error := answers.pop(0)) is not None:
            raise error
        return value

    assert worker().patiently(work, 7) == 7


def test_work_without_a_lease_is_left_to_others() -> None:
    def work() -> None:
        raise LeaseLostError("lost")

    with pytest.raises(SystemExit):
        worker().patiently(work)
