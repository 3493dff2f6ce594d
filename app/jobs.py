"""Durable jobs: what takes longer than a request, on any number of worker processes and machines.

The only module that knows the job engine (DBOS). A job of a kind is planned into tasks of 1 to 10 s, the tasks wait
in a queue in the database, and every worker takes one at a time. A task may run again after its worker died, so
`JobKind.run` has to give the same result, and leave the same behind, when it is repeated.

States and progress are rows of the database: whoever can reach it can submit, follow, cancel, resume and work.
"""

from __future__ import annotations

import fcntl
import os
import re
import signal
import socket
import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Literal, Self, TypeAlias
from uuid import uuid4

from dbos import (
    DBOS,
    DBOSClient,
    DBOSConfig,
    DBOSPortableJSONSerializer,
    EnqueueOptions,
    SetEnqueueOptions,
    SetWorkflowID,
    WorkflowStatus,
    error,
)
from sqlalchemy import make_url

from app.job_errors import JobError, JobFailedError, JobNotFoundError, JobStateError
from casebase.errors import InvalidCursorError
from casebase.pages import Page, cut

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
JobState: TypeAlias = Literal["queued", "running", "done", "failed", "cancelled"]
Report: TypeAlias = Callable[[str, float], None]

APPLICATION = "gearcase"
VERSION = "1"  # raise when tasks already in the queue could not be run by the new code
JOBS, TASKS, PROGRESS = "jobs", "tasks", "progress"
WAITING_JOBS_PER_WORKER = 16  # a waiting job costs a sleeping thread, its tasks do the work
POLL_S = 0.5

_STATES: Mapping[str, JobState] = {
    "ENQUEUED": "queued",
    "DELAYED": "queued",
    "PENDING": "running",
    "SUCCESS": "done",
    "ERROR": "failed",
    "MAX_RECOVERY_ATTEMPTS_EXCEEDED": "failed",
    "CANCELLED": "cancelled",
}


@dataclass(frozen=True)
class JobKind:
    """What a kind of job does; registered in `app.job_kinds`.

    `plan` cuts the parameters into tasks of 1 to 10 s, `run` does one of them (again, after a worker died) and may
    report (stage, fraction), `finish` makes the result of the results, in the order of the tasks.
    """

    name: str
    stage: str
    plan: Callable[[dict[str, Json]], list[dict[str, Json]]]
    run: Callable[[dict[str, Json], Report], Json]
    finish: Callable[[dict[str, Json], list[Json]], Json]
    priority: int = 10  # lower goes first: what a person waits for before campaigns


@dataclass(frozen=True)
class Progress:
    """How far a job is: fraction in [0, 1], remaining time [s] as estimated from the pace so far."""

    stage: str = "queued"
    fraction: float = 0.0
    done: int = 0
    total: int = 0
    remaining_s: float | None = None


@dataclass(frozen=True)
class Job:
    """One job as the database knows it."""

    id: str
    kind: str
    state: JobState
    progress: Progress
    created_at: datetime
    finished_at: datetime | None
    submitted_by: str | None
    worker: str | None
    result: Json
    error: str | None


@dataclass(frozen=True)
class JobEvent:
    """One entry of a job's history; `number` counts from 0 without gaps."""

    number: int
    progress: Progress


def jobs_url(database_url: str, data_dir: Path) -> str:
    """Where the jobs live: with the library in PostgreSQL, in a file beside it for SQLite."""
    url = make_url(database_url)
    if url.get_backend_name() == "postgresql":
        return url.set(drivername="postgresql").render_as_string(hide_password=False)
    return f"sqlite:///{(data_dir / 'jobs.sqlite').resolve()}"


class Jobs:
    """Submit, follow, cancel, resume and adopt jobs; runs none itself.

    Creates the tables of the job engine when they are missing.
    """

    def __init__(self, url: str, kinds: Sequence[str]) -> None:
        _prepare(url)
        self._kinds = frozenset(kinds)
        self._client = DBOSClient(
            system_database_url=url, serializer=DBOSPortableJSONSerializer(), application_name=APPLICATION
        )

    def close(self) -> None:
        """Give the connections back."""
        self._client.destroy()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(
        self,
        kind: str,
        parameters: dict[str, Json],
        *,
        job_id: str | None = None,
        submitted_by: str | None = None,
    ) -> str:
        """Queue a job and give its id. The same `job_id` again is the same job.

        Raises JobError for a kind that no worker knows.
        """
        if kind not in self._kinds:
            raise JobError(f"no job kind {kind!r}: there are {', '.join(sorted(self._kinds))}")
        options: EnqueueOptions = {
            "workflow_name": "job",
            "queue_name": JOBS,
            "workflow_id": job_id or str(uuid4()),
            "app_version": VERSION,
            "attributes": {"kind": kind, "submitted_by": submitted_by},
        }
        handle: Any = self._client.enqueue(options, kind, parameters)
        return str(handle.get_workflow_id())

    def get(self, job_id: str) -> Job:
        """The job. Raises JobNotFoundError."""
        found = self._client.list_workflows(workflow_ids=[job_id], name="job", load_input=False)
        if not found:
            raise JobNotFoundError(f"no job {job_id!r}")
        return _job(found[0])

    def list(self, *, limit: int = 100) -> tuple[Job, ...]:
        """The newest jobs first, without their results."""
        found = self._client.list_workflows(
            name="job", sort_desc=True, limit=limit, load_input=False, load_output=False
        )
        return tuple(_job(status) for status in found)

    def page(self, *, limit: int = 50, cursor: str | None = None) -> Page[Job]:
        """A page of the jobs, the newest first, without their results. Raises InvalidCursorError."""
        before = None if cursor is None else _read_cursor(cursor)
        until = None if before is None else _time(before[0] + 1).isoformat()  # a millisecond more: it is rounded down
        wanted = limit + 2
        while True:
            found = self._client.list_workflows(
                name="job", sort_desc=True, end_time=until, limit=wanted, load_input=False, load_output=False
            )
            rows = sorted(found, key=_age, reverse=True)
            if len(found) == wanted:  # of jobs as old as the last, some may be missing
                rows = [status for status in rows if _age(status)[0] > _age(rows[-1])[0]]
            rows = [status for status in rows if before is None or _age(status) < before]
            if len(rows) > limit or len(found) < wanted:
                page = cut(rows, limit, _cursor)
                return Page([_job(status) for status in page.items], page.next_cursor)
            wanted *= 2

    def events(self, job_id: str, *, after: int = -1, patience_s: float = 15.0) -> Iterator[JobEvent | None]:
        """The history after event number `after`, then what happens until the job ends.

        Yields None when nothing happened for `patience_s` [s], so that a listener can see whether anyone still
        listens. Raises JobNotFoundError.
        """
        self.get(job_id)
        number = after + 1
        while True:
            entries = self._client.read_stream(
                job_id, PROGRESS, offset=number, polling_interval_sec=POLL_S, timeout_seconds=patience_s
            )
            try:
                for entry in entries:
                    yield JobEvent(number, Progress(**entry))
                    number += 1
            except error.DBOSStreamTimeoutError:
                yield None
            else:
                return

    def cancel(self, job_id: str) -> Job:
        """Stop the job: running tasks end, waiting ones never start, what is done stays; again changes nothing.

        Raises JobStateError.
        """
        job = self.get(job_id)
        if job.state == "cancelled":
            return job
        if job.state in ("done", "failed"):
            raise JobStateError(f"job {job_id} is {job.state}: only a queued or running job can be cancelled")
        self._client.cancel_workflow(job_id, cancel_children=True)
        return self.get(job_id)

    def resume(self, job_id: str) -> Job:
        """Go on with a cancelled job where it was. Raises JobStateError."""
        job = self.get(job_id)
        if job.state != "cancelled":
            raise JobStateError(f"job {job_id} is {job.state}: only a cancelled job can be resumed")
        tasks = self._client.list_workflows(
            parent_workflow_id=job_id, status="CANCELLED", load_input=False, load_output=False
        )
        if tasks:
            self._client.resume_workflows([task.workflow_id for task in tasks], queue_name=TASKS)
        self._client.resume_workflow(job_id, queue_name=JOBS)
        return self.get(job_id)

    def workers(self) -> dict[str, int]:
        """Workers that hold jobs or tasks, and how many."""
        held = self._client.list_workflows(status="PENDING", load_input=False, load_output=False)
        return dict(Counter(status.executor_id or "?" for status in held))

    def adopt(self, worker: str) -> int:
        """Put back into the queue what a worker holds that will not return; how many jobs and tasks those were.

        Should the worker be alive after all, it loses them: what it still finishes of them is not recorded.
        """
        held = self._client.list_workflows(status="PENDING", executor_id=worker, load_input=False, load_output=False)
        for queue, name in ((JOBS, "job"), (TASKS, "task")):
            mine = [status.workflow_id for status in held if status.name == name]
            if mine:
                self._client.resume_workflows(mine, queue_name=queue)
        return len(held)


def run_worker(
    url: str, kinds: Sequence[JobKind], name: str, *, stop: threading.Event, parent: int | None = None
) -> None:
    """Work until `stop` is set, or until process `parent` has gone; then give back what is not finished.

    Jobs that a worker of this name left behind are taken up first.
    """
    _prepare(url)
    config: DBOSConfig = {
        "name": APPLICATION,
        "system_database_url": url,
        "application_version": VERSION,
        "executor_id": name,
        "serializer": DBOSPortableJSONSerializer(),
        "log_level": "WARNING",
        "enable_otlp": False,
        "use_listen_notify": False,
        "notification_listener_polling_interval_sec": POLL_S,
    }
    DBOS(config=config)
    _register({kind.name: kind for kind in kinds}, stop)
    DBOS.listen_queues([JOBS, TASKS])
    DBOS.launch()
    DBOS.register_queue(JOBS, worker_concurrency=WAITING_JOBS_PER_WORKER, polling_interval_sec=POLL_S)
    DBOS.register_queue(TASKS, worker_concurrency=1, polling_interval_sec=0.1)
    while not stop.wait(POLL_S):
        if parent is not None and os.getppid() != parent:
            stop.set()
    DBOS.destroy(workflow_completion_timeout_sec=10)
    jobs = Jobs(url, ())
    jobs.adopt(name)
    jobs.close()


def stop_on_signals() -> threading.Event:
    """An event that SIGTERM and SIGINT set."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    return stop


@dataclass(frozen=True)
class WorkerSlot:
    """A worker's name on this machine, held by a file lock that the system releases when the process dies."""

    name: str
    lock: IO[bytes]


def take_slot(data_dir: Path) -> tuple[WorkerSlot, tuple[str, ...]]:
    """The first free name of this machine, and all names whose workers are dead.

    A restarted worker so gets the name of the one that died, and takes up its jobs.
    """
    folder = data_dir / "workers"
    folder.mkdir(parents=True, exist_ok=True)
    host = socket.gethostname()
    slot: WorkerSlot | None = None
    free: list[str] = []
    number = 0
    while slot is None or (folder / f"{host}-{number}").exists():
        name = f"{host}-{number}"
        lock = (folder / name).open("ab")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
        else:
            free.append(name)
            if slot is None:
                slot = WorkerSlot(name, lock)
            else:
                lock.close()
        number += 1
    return slot, tuple(free)


def _prepare(url: str) -> None:
    database = make_url(url)
    if database.get_backend_name() == "sqlite" and database.database:
        connection = sqlite3.connect(database.database, timeout=30)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.close()
    DBOS.migrate(url)


def _register(kinds: Mapping[str, JobKind], stop: threading.Event) -> None:
    def run_task(kind: str, task: dict[str, Json]) -> Json:
        task_id = DBOS.workflow_id
        assert task_id is not None

        def report(stage: str, fraction: float) -> None:
            DBOS.update_workflow_attributes(task_id, {"stage": stage, "fraction": fraction}, merge=True)

        return DBOS.run_step({"name": "run"}, kinds[kind].run, task, report)

    task_workflow = DBOS.workflow(name="task", max_recovery_attempts=20)(run_task)

    def run_job(kind: str, parameters: dict[str, Json]) -> Json:
        job_id = DBOS.workflow_id
        assert job_id is not None
        this = kinds[kind]
        tasks = DBOS.run_step({"name": "plan"}, this.plan, parameters)
        for number, task in enumerate(tasks):
            with SetWorkflowID(f"{job_id}/{number}"), SetEnqueueOptions(priority=this.priority):
                DBOS.enqueue_workflow(TASKS, task_workflow, kind, task)
        DBOS.run_step({"name": "wait"}, _wait, job_id, this.stage, len(tasks), stop)
        return DBOS.run_step({"name": "finish"}, _finish, this, job_id, parameters)

    DBOS.workflow(name="job", max_recovery_attempts=1000)(run_job)


def _wait(job_id: str, stage: str, total: int, stop: threading.Event) -> None:
    """Return when all tasks are done; write the progress on the way. Raises JobFailedError."""
    started, done_before, last = time.monotonic(), None, None
    while not stop.is_set():
        tasks = DBOS.list_workflows(parent_workflow_id=job_id, load_input=False, load_output=False)
        failed = [task.workflow_id for task in tasks if _STATES[task.status] == "failed"]
        if failed:
            DBOS.cancel_workflows([task.workflow_id for task in tasks if _open(task)])
            reason = DBOS.list_workflows(workflow_ids=failed[:1])[0].error
            raise JobFailedError(f"task {failed[0].rpartition('/')[2]}: {reason}")
        done = sum(task.status == "SUCCESS" for task in tasks)
        done_before = done if done_before is None else done_before
        progress = _progress(tasks, stage, done, total, time.monotonic() - started, done_before)
        if progress["done"] == total or last is None or _moved(last, progress):
            DBOS.write_stream(PROGRESS, progress)
            DBOS.update_workflow_attributes(job_id, progress, merge=True)
            last = progress
        if done == total:
            return
        stop.wait(POLL_S)
    raise SystemExit  # the job stays where it is, for this worker's next life or another worker


def _progress(
    tasks: Sequence[WorkflowStatus], stage: str, done: int, total: int, elapsed_s: float, done_before: int
) -> dict[str, Any]:
    running = [task.attributes or {} for task in tasks if task.status == "PENDING"]
    fraction = (done + sum(float(task.get("fraction", 0.0)) for task in running)) / max(total, 1)
    gained = fraction - done_before / max(total, 1)
    estimable = gained > 0 and elapsed_s > 2 * POLL_S
    stages = [str(task["stage"]) for task in running if "stage" in task]
    return {
        "stage": stages[0] if stages else stage,
        "fraction": round(min(fraction, 1.0), 4),
        "done": done,
        "total": total,
        "remaining_s": round((1.0 - fraction) * elapsed_s / gained, 1) if estimable else None,
    }


def _moved(before: dict[str, Any], after: dict[str, Any]) -> bool:
    return any(before[name] != after[name] for name in ("stage", "done")) or (
        after["fraction"] - before["fraction"] >= 0.005
    )


def _open(task: WorkflowStatus) -> bool:
    return _STATES[task.status] in ("queued", "running")


def _finish(kind: JobKind, job_id: str, parameters: dict[str, Json]) -> Json:
    tasks = DBOS.list_workflows(parent_workflow_id=job_id, load_input=False)
    ordered = sorted(tasks, key=lambda task: int(task.workflow_id.rpartition("/")[2]))
    return kind.finish(parameters, [task.output for task in ordered])


def _job(status: WorkflowStatus) -> Job:
    state, known = _STATES[status.status], status.attributes or {}
    default = Progress(stage="queued" if state == "queued" else state)
    progress = Progress(**{name: known.get(name, getattr(default, name)) for name in Progress.__match_args__})
    if state == "done":
        progress = Progress("done", 1.0, progress.total, progress.total, 0.0)
    return Job(
        id=status.workflow_id,
        kind=str(known.get("kind")),
        state=state,
        progress=progress,
        created_at=_time(status.created_at or 0),
        finished_at=None if status.completed_at is None else _time(status.completed_at),
        submitted_by=known.get("submitted_by"),
        worker=status.executor_id if state == "running" else None,
        result=status.output,
        error=None if status.error is None else str(status.error),
    )


def _age(status: WorkflowStatus) -> tuple[int, str]:
    return status.created_at or 0, status.workflow_id


def _cursor(status: WorkflowStatus) -> str:
    return f"{status.created_at or 0}.{status.workflow_id}"


def _read_cursor(cursor: str) -> tuple[int, str]:
    match = re.fullmatch(r"([0-9]{1,14})\.(.+)", cursor)
    if match is None:
        raise InvalidCursorError("this cursor was not made here; leave it out to start at the newest")
    return int(match[1]), match[2]


def _time(epoch_ms: int) -> datetime:
    return datetime.fromtimestamp(epoch_ms / 1000, UTC)
