"""Durable jobs: what takes longer than a request, on any number of worker processes and machines.

A row of the library's database says that there is a job, what is wanted of it and how it ended; it is stored in the
transaction that orders the job (a transactional outbox), and comes with a backup. The job engine (DBOS), which runs it,
is made to agree with the rows: by whoever changes one, and by every worker again and again, so that it does not matter
what was killed in between. This and `app.jobs.runner` alone know the engine, which is imported when first needed.
"""

from __future__ import annotations

import re
import sqlite3
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

from sqlalchemy import ColumnElement, make_url, or_, select, tuple_
from sqlalchemy.orm import Session

from app.jobs.job import Job, JobError, JobEvent, JobNotFoundError, JobState, JobStateError, Json, Progress
from casebase.errors import InvalidCursorError
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.database import impatient
from casebase.store.models import StoredJob, new_id, now
from casebase.store.pagination import Page, cut

if TYPE_CHECKING:
    from dbos import DBOSClient, EnqueueOptions, WorkflowStatus

APPLICATION = "gearcase"
VERSION = "1"  # raise when tasks already in the queue could not be run by the new code
JOBS, TASKS, PROGRESS = "jobs", "tasks", "progress"
ACTOR = "jobs"
POLL_S = 0.5
OVER: tuple[JobState, ...] = ("done", "failed", "cancelled")

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
    """Where the job engine keeps what it knows: with the library in PostgreSQL, in a file beside it for SQLite."""
    url = make_url(database_url)
    if url.get_backend_name() == "postgresql":
        return impatient(url.set(drivername="postgresql")).render_as_string(hide_password=False)
    return f"sqlite:///{(data_dir / 'jobs.sqlite').resolve()}"


class Jobs:
    """Order, follow, cancel, resume and adopt jobs; runs none itself.

    Where the engine is asked and its database cannot be reached, SQLAlchemy's errors are raised.
    """

    def __init__(self, library: CaseLibrary, kinds: Sequence[str]) -> None:
        self._library, self._kinds = library, frozenset(kinds)

    @property
    def url(self) -> str:
        """Of the engine's database."""
        return jobs_url(self._library.engine.url.render_as_string(hide_password=False), self._library.data_dir)

    @cached_property
    def _client(self) -> DBOSClient:
        from dbos import DBOSClient, DBOSPortableJSONSerializer

        prepare(self.url)
        return DBOSClient(
            system_database_url=self.url,
            serializer=DBOSPortableJSONSerializer(),
            application_name=APPLICATION,
            retry_connection_errors=False,
        )

    def close(self) -> None:
        """Give the connections to the engine back."""
        if "_client" in self.__dict__:
            self._client.destroy()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def order(
        self,
        session: Session,
        kind: str,
        parameters: Mapping[str, Json],
        *,
        job_id: str | None = None,
        submitted_by: str | None = None,
    ) -> Job:
        """Order a job in the caller's transaction: there is the job exactly if that is committed.

        The same `job_id` again is the same job. Raises JobError for a kind that no worker knows.
        """
        if kind not in self._kinds:
            raise JobError(f"no job kind {kind!r}: there are {', '.join(sorted(self._kinds))}")
        row = None if job_id is None else session.get(StoredJob, job_id)
        if row is None:
            row = StoredJob(id=job_id or new_id(), kind=kind, parameters=dict(parameters), submitted_by=submitted_by)
            session.add(row)
            session.flush()
        return _job(row)

    def submit(
        self,
        kind: str,
        parameters: Mapping[str, Json],
        *,
        job_id: str | None = None,
        submitted_by: str | None = None,
    ) -> str:
        """Order a job in a transaction of its own and give its id. Raises JobError."""
        with self._library.transaction(submitted_by or ACTOR) as session:
            return self.order(session, kind, parameters, job_id=job_id, submitted_by=submitted_by).id

    def get(self, job_id: str) -> Job:
        """The job as it is now. Raises JobNotFoundError."""
        row = self._row(job_id)
        return _job(row) if row.finished_at is not None else _job(row, self._status(job_id))

    def list(self, *, limit: int = 100) -> tuple[Job, ...]:
        """The newest jobs first."""
        return tuple(self.page(limit=limit).items)

    def newest_of_axis(self, kind: str, axis: str) -> Job | None:
        """The newest job of a kind whose parameters have this axis; None where there is none."""
        statement = select(StoredJob.id).where(
            StoredJob.kind == kind, StoredJob.parameters["axis"]["name"].as_string() == axis
        )
        with self._library.reading() as session:
            found = session.scalar(statement.order_by(StoredJob.created_at.desc(), StoredJob.id.desc()).limit(1))
        return None if found is None else self.get(found)

    def page(self, *, limit: int = 50, cursor: str | None = None) -> Page[Job]:
        """A page of the jobs, the newest first. Raises InvalidCursorError."""
        age = tuple_(StoredJob.created_at, StoredJob.id)
        statement = select(StoredJob).order_by(StoredJob.created_at.desc(), StoredJob.id.desc()).limit(limit + 1)
        if cursor is not None:
            statement = statement.where(age < _read_cursor(cursor))
        with self._library.reading() as session:
            page = cut(session.scalars(statement).all(), limit, _cursor)
        known = self._statuses([row.id for row in page.items if row.finished_at is None])
        return Page([_job(row, known.get(row.id)) for row in page.items], page.next_cursor)

    def events(self, job_id: str, *, after: int = -1, patience_s: float = 15.0) -> Iterator[JobEvent | None]:
        """The history after event number `after`, then what happens until the job ends.

        Yields None when nothing happened for `patience_s` [s], so that a listener can see whether anyone still
        listens. Raises JobNotFoundError.
        """
        from dbos import error

        waited_s = 0.0
        while self._status(job_id) is None:
            if self.get(job_id).state in OVER:
                return  # before the engine heard of it
            if waited_s >= patience_s:
                waited_s = 0.0
                yield None
            time.sleep(POLL_S)
            waited_s += POLL_S
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
        if job.state in OVER or not self._want(job_id, "cancelled"):
            state = self.get(job_id).state
            raise JobStateError(f"job {job_id} is {state}: only a queued or running job can be cancelled")
        return self.get(job_id)

    def resume(self, job_id: str) -> Job:
        """Go on with a cancelled job where it was. Raises JobStateError."""
        job = self.get(job_id)
        if job.state != "cancelled" or not self._want(job_id, "queued"):
            raise JobStateError(f"job {job_id} is {job.state}: only a cancelled job can be resumed")
        return self.get(job_id)

    def workers(self) -> dict[str, int]:
        """Workers that hold jobs or tasks, and how many."""
        held = self._client.list_workflows(status="PENDING", load_input=False, load_output=False)
        return dict(Counter(status.executor_id or "?" for status in held))

    def adopt(self, worker: str) -> int:
        """End the lease of a worker that will not return; how many jobs and tasks others take over at once.

        Should the worker be alive after all, it loses them: nothing that it still finishes of them is written.
        """
        held = self.workers().get(worker, 0)
        with self._library.transaction(ACTOR) as session:
            leases.end(session, worker)
        return held

    # -- for workers

    def agree(self) -> None:
        """Make the engine do what the rows say, and the rows say what became of it: of every job that is not over."""
        with self._library.reading() as session:
            unfinished = session.execute(
                select(StoredJob.id, StoredJob.state).where(StoredJob.finished_at.is_(None), _due())
            ).all()
        known = self._statuses([job_id for job_id, _ in unfinished])
        for job_id, wanted in unfinished:
            status = known.get(job_id)
            if status is None or wanted == "cancelled" or STATES[status.status] in OVER:
                self._agree(job_id)

    def claims(self) -> dict[str, str]:
        """Jobs and tasks that run as far as the engine knows, and the leases of the workers that run them."""
        held = self._client.list_workflows(status="PENDING", load_input=False, load_output=False)
        return {status.workflow_id: status.executor_id or "" for status in held}

    def put_back(self, claimed: Sequence[str]) -> None:
        """Put these jobs and tasks back into the queue; only for the worker that holds them."""
        for queue in (JOBS, TASKS):
            mine = [each for each in claimed if ("/" in each) == (queue == TASKS)]
            if mine:
                self._client.resume_workflows(mine, queue_name=queue)

    # -- rows and engine

    def _row(self, job_id: str) -> StoredJob:
        with self._library.reading() as session:
            row = session.get(StoredJob, job_id)
        if row is None:
            raise JobNotFoundError(f"no job has the id {job_id!r}")
        return row

    def _status(self, job_id: str) -> WorkflowStatus | None:
        return self._statuses([job_id]).get(job_id)

    def _statuses(self, job_ids: Sequence[str]) -> dict[str, WorkflowStatus]:
        if not job_ids:
            return {}
        found = self._client.list_workflows(workflow_ids=list(job_ids), load_input=False)
        return {status.workflow_id: status for status in found}

    def _want(self, job_id: str, state: JobState) -> bool:
        """Write down what is wanted and have it done; False if the job is over, or was not cancelled, by now."""
        with self._library.transaction(ACTOR) as session:
            row = session.get_one(StoredJob, job_id, with_for_update=True)
            if state == "queued" and row.state != "cancelled":
                return False
            if state == "cancelled" and row.finished_at is not None:
                return False
            row.state, row.finished_at = state, None
        self._agree(job_id)
        return True

    def _agree(self, job_id: str) -> None:
        """One job; of several who try at once, one does it."""
        with self._library.transaction(ACTOR) as session:
            row = session.get(StoredJob, job_id, with_for_update={"skip_locked": True})
            if row is None or row.finished_at is not None:
                return
            status = self._status(job_id)
            state = None if status is None else STATES[status.status]
            if status is not None and state in ("done", "failed"):
                self._close(row, status)
            elif row.state == "cancelled":
                if state in ("queued", "running"):
                    self._client.cancel_workflow(job_id, cancel_children=True)
                row.finished_at = now()
                row.progress = asdict(_progress(status, "cancelled"))
            elif status is None and (row.not_before is None or row.not_before <= now()):
                self._enqueue(row)
            elif state == "cancelled":
                self._go_on(job_id)

    def _close(self, row: StoredJob, status: WorkflowStatus) -> None:
        job = _job(row, status)
        row.state, row.result, row.error, row.progress = job.state, job.result, job.error, asdict(job.progress)
        row.finished_at = job.finished_at or now()

    def _enqueue(self, row: StoredJob) -> None:
        options: EnqueueOptions = {
            "workflow_name": "job",
            "queue_name": JOBS,
            "workflow_id": row.id,
            "app_version": VERSION,
            "attributes": {"kind": row.kind, "submitted_by": row.submitted_by},
        }
        self._client.enqueue(options, row.kind, row.parameters)

    def _go_on(self, job_id: str) -> None:
        tasks = self._client.list_workflows(
            parent_workflow_id=job_id, status="CANCELLED", load_input=False, load_output=False
        )
        if tasks:
            self._client.resume_workflows([task.workflow_id for task in tasks], queue_name=TASKS)
        self._client.resume_workflow(job_id, queue_name=JOBS)


def _due() -> ColumnElement[bool]:
    """Of the rows of jobs, which ones are to begin by now; what was cancelled ends at once."""
    return or_(StoredJob.not_before.is_(None), StoredJob.not_before <= now(), StoredJob.state == "cancelled")


def prepare(url: str) -> None:
    """Create or upgrade the tables of the job engine."""
    from dbos import DBOS

    database = make_url(url)
    if database.get_backend_name() == "sqlite" and database.database:
        connection = sqlite3.connect(database.database, timeout=30)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.close()
    DBOS.migrate(url)


def reason_of(status: WorkflowStatus) -> str | None:
    """Why a job or task failed."""
    if status.error is None and status.status == "MAX_RECOVERY_ATTEMPTS_EXCEEDED":
        return "given up: worker after worker died while at it"
    return None if status.error is None else str(status.error)


def _job(row: StoredJob, status: WorkflowStatus | None = None) -> Job:
    """A job by its row and, unless it is over, by what the engine says of it."""
    if row.finished_at is not None or status is None or row.state == "cancelled":
        state = cast(JobState, row.state)
        return Job(
            id=row.id,
            kind=row.kind,
            state=state,
            progress=Progress(**{"stage": state, **row.progress}),  # type: ignore[arg-type]
            created_at=row.created_at,
            finished_at=row.finished_at,
            submitted_by=row.submitted_by,
            worker=None,
            result=row.result,
            error=row.error,
        )
    state = STATES[status.status]
    if state == "cancelled":
        state = "queued"  # it is to go on, and has not been told yet
    return Job(
        id=row.id,
        kind=row.kind,
        state=state,
        progress=_progress(status, state),
        created_at=row.created_at,
        finished_at=None if status.completed_at is None or state not in OVER else _time(status.completed_at),
        submitted_by=row.submitted_by,
        worker=status.executor_id if state == "running" else None,
        result=status.output,
        error=reason_of(status),
    )


def _progress(status: WorkflowStatus | None, state: JobState) -> Progress:
    known: Mapping[str, Any] = {} if status is None else status.attributes or {}
    default = Progress(stage=state)
    progress = Progress(**{name: known.get(name, getattr(default, name)) for name in Progress.__match_args__})
    return Progress("done", 1.0, progress.total, progress.total, 0.0) if state == "done" else progress


def _cursor(row: StoredJob) -> str:
    return f"{round(row.created_at.timestamp() * 1e6)}.{row.id}"


def _read_cursor(cursor: str) -> tuple[datetime, str]:
    match = re.fullmatch(r"([0-9]{1,16})\.([0-9A-Za-z-]{1,100})", cursor)
    if match is None:
        raise InvalidCursorError("this cursor was not made here; leave it out to start at the newest")
    return datetime.fromtimestamp(int(match[1]) / 1e6, UTC), match[2]


def _time(epoch_ms: int) -> datetime:
    return datetime.fromtimestamp(epoch_ms / 1000, UTC)
