"""Durable jobs: what takes longer than a request, on any number of worker processes and machines.

Rows of a database say what jobs there are and how far: whoever can reach it can submit, follow, cancel and resume.
This and `app.job_runner` alone know the job engine (DBOS), which is imported when jobs are first opened.
"""

from __future__ import annotations

import re
import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self
from uuid import uuid4

from sqlalchemy import make_url

from app.job import Job, JobError, JobEvent, JobNotFoundError, JobState, JobStateError, Json, Progress
from casebase import audit
from casebase.errors import InvalidCursorError
from casebase.pages import Page, cut

if TYPE_CHECKING:
    from dbos import EnqueueOptions, WorkflowStatus

APPLICATION = "gearcase"
VERSION = "1"  # raise when tasks already in the queue could not be run by the new code
JOBS, TASKS, PROGRESS = "jobs", "tasks", "progress"
POLL_S = 0.5

STATES: Mapping[str, JobState] = {
    "ENQUEUED": "queued",
    "DELAYED": "queued",
    "PENDING": "running",
    "SUCCESS": "done",
    "ERROR": "failed",
    "MAX_RECOVERY_ATTEMPTS_EXCEEDED": "failed",
    "CANCELLED": "cancelled",
}
"""The engine's words for a state, and ours."""


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
        from dbos import DBOSClient, DBOSPortableJSONSerializer

        prepare(url)
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
        audit.stored(["job.submitted"])
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
        from dbos import error

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


def prepare(url: str) -> None:
    """Create or upgrade the tables of the job engine."""
    from dbos import DBOS

    database = make_url(url)
    if database.get_backend_name() == "sqlite" and database.database:
        connection = sqlite3.connect(database.database, timeout=30)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.close()
    DBOS.migrate(url)


def _job(status: WorkflowStatus) -> Job:
    state, known = STATES[status.status], status.attributes or {}
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
    match = re.fullmatch(r"([0-9]{1,14})\.([0-9A-Za-z-]{1,100})", cursor)
    if match is None:
        raise InvalidCursorError("this cursor was not made here; leave it out to start at the newest")
    return int(match[1]), match[2]


def _time(epoch_ms: int) -> datetime:
    return datetime.fromtimestamp(epoch_ms / 1000, UTC)
