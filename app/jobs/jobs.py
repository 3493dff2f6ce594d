"""Durable jobs: what takes longer than a request, on any number of worker processes and machines.

Rows of the library's database are the only state. A job is stored in the transaction that orders it (a transactional
outbox), with a first step; workers (`app.jobs.runner`) claim steps and write what became of them into the rows.
"""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from typing import Any, cast
from weakref import WeakValueDictionary

from sqlalchemy import select
from sqlalchemy.orm import Session, undefer

from app.jobs.job import Job, JobError, JobEvent, JobKind, JobNotFoundError, JobState, JobStateError, Json, Progress
from app.settings import Settings
from casebase.alarms.outbox import KIND as DELIVERIES
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.models import JobStep, StoredJob, StoredJobEvent, new_id, now
from casebase.store.pagination import Page, page

ACTOR = "jobs"
POLL_S = 0.5
OVER: tuple[JobState, ...] = ("done", "failed", "cancelled")
ENTRIES = select(StoredJob).options(undefer(StoredJob.parameters))
ORDERED = ENTRIES.where(StoredJob.kind != DELIVERIES)
"""The jobs that people order; those that send messages stand in the outbox."""
KINDS: dict[str, tuple[str, str]] = {
    "simulations": ("app.simulated.generation", "simulations"),
    "investigations": ("app.investigations", "investigations"),
    "imports": ("app.recordings.bundle_import", "imports"),
    "deliveries": ("app.alarms.sending", "deliveries"),
}
"""Name of a kind, and where the function is that makes it for a library; workers alone import it."""


def job_kinds(library: CaseLibrary) -> tuple[JobKind, ...]:
    """All kinds, ready to run on this library."""
    made = []
    for module, function in KINDS.values():
        make: Callable[[CaseLibrary], JobKind] = getattr(import_module(module), function)
        made.append(make(library))
    return tuple(made)


@contextmanager
def open_jobs(settings: Settings) -> Iterator[Jobs]:
    """The jobs of an installation, with a library of their own."""
    library = CaseLibrary.open(settings.data_dir, settings.database_url)
    try:
        yield Jobs(library)
    finally:
        library.close()


class Jobs:
    """Order, follow, cancel, resume and adopt jobs; runs none itself."""

    def __init__(self, library: CaseLibrary, kinds: tuple[str, ...] = tuple(KINDS)) -> None:
        self._library, self._kinds = library, kinds

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
            row = StoredJob(
                id=job_id or new_id(),
                kind=kind,
                parameters=dict(parameters),
                submitted_by=submitted_by,
                steps=[JobStep()],
            )
            session.add(row)
            session.flush()
        return job_of(row)

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
        with self._library.reading() as session:
            return job_of(_row(session, job_id))

    def newest_of_axis(self, kind: str, axis: str) -> Job | None:
        """The newest job of a kind whose parameters have this axis; None where there is none."""
        statement = select(StoredJob).where(
            StoredJob.kind == kind, StoredJob.parameters["axis"]["name"].as_string() == axis
        )
        with self._library.reading() as session:
            found = session.scalar(statement.order_by(StoredJob.id.desc()).limit(1))
            return None if found is None else job_of(found)

    def page(self, *, limit: int = 50, cursor: str | None = None) -> Page[Job]:
        """A page of the jobs, the newest first. Raises InvalidCursorError."""
        with self._library.reading() as session:
            found = page(session, ENTRIES, StoredJob.id, limit=limit, cursor=cursor)
            return Page([job_of(row) for row in found.items], found.next_cursor)

    def news(self, job_id: str, *, after: int = -1) -> tuple[Sequence[JobEvent], bool]:
        """The history after event number `after`, and whether nothing will follow. Raises JobNotFoundError."""
        statement = select(StoredJobEvent).where(StoredJobEvent.job_id == job_id, StoredJobEvent.number > after)
        with self._library.reading() as session:
            over = _row(session, job_id).finished_at is not None  # first: what comes before the end is then there
            found = session.scalars(statement.order_by(StoredJobEvent.number))
            return [JobEvent(each.number, Progress(**each.progress)) for each in found], over  # type: ignore[arg-type]

    def events(self, job_id: str, *, after: int = -1) -> Iterator[JobEvent]:
        """The history after event number `after`, then what happens until the job ends. Raises JobNotFoundError."""
        while True:
            found, over = self.news(job_id, after=after)
            yield from found
            if over:
                return
            after += len(found)
            time.sleep(POLL_S)

    def cancel(self, job_id: str) -> Job:
        """Stop the job: running tasks end, waiting ones never start, what is done stays; again changes nothing.

        Raises JobStateError.
        """
        with self._library.transaction(ACTOR) as session:
            row = _row(session, job_id, lock=True)
            if row.state in ("done", "failed"):
                raise JobStateError(f"job {job_id} is {row.state}: only a queued or running job can be cancelled")
            if row.state != "cancelled":
                row.state, row.finished_at, row.worker = "cancelled", now(), None
            return job_of(row)

    def resume(self, job_id: str) -> Job:
        """Go on with a cancelled job where it was. Raises JobStateError."""
        with self._library.transaction(ACTOR) as session:
            row = _row(session, job_id, lock=True)
            if row.state != "cancelled":
                raise JobStateError(f"job {job_id} is {row.state}: only a cancelled job can be resumed")
            row.state, row.finished_at = "queued", None
            return job_of(row)

    def workers(self) -> dict[str, int]:
        """Workers that have jobs, or steps of them, in hand, and how many."""
        running = select(StoredJob.worker).where(StoredJob.state == "running")
        with self._library.reading() as session:
            held = [*session.scalars(select(JobStep.lease)), *session.scalars(running)]
        return dict(Counter(each for each in held if each is not None))

    def adopt(self, worker: str) -> int:
        """End a worker's lease, so that others take over now what it has in hand; how much that is."""
        in_hand = self.workers().get(worker, 0)
        with self._library.transaction(ACTOR) as session:
            return in_hand if leases.end(session, worker) else 0


def _row(session: Session, job_id: str, *, lock: bool = False) -> StoredJob:
    row = session.get(StoredJob, job_id, with_for_update=True if lock else None)
    if row is None:
        raise JobNotFoundError(f"no job has the id {job_id!r}")
    return row


def job_of(row: StoredJob) -> Job:
    """Return the job of a row."""
    asked: Mapping[str, Any] = row.parameters
    return Job(
        id=row.id,
        kind=row.kind,
        state=cast(JobState, row.state),
        progress=Progress(**{"stage": row.state, **row.progress}),  # type: ignore[arg-type]
        created_at=row.created_at,
        finished_at=row.finished_at,
        submitted_by=row.submitted_by,
        worker=row.worker,
        result=row.result,
        error=row.error,
        about=asked["axis"]["name"] if asked.get("axis") else asked.get("about", asked.get("name")),
    )


@dataclass(eq=False)
class Topic:
    """One job that somebody listens to: what was known of its history when it was last read."""

    events: list[JobEvent] = field(default_factory=list)
    over: bool = False
    read_at: float = float("-inf")
    reading: asyncio.Lock = field(default_factory=asyncio.Lock)


class JobFeed:
    """Follows jobs while somebody listens. A listener costs neither a thread nor a look into the database."""

    def __init__(self, jobs: Jobs) -> None:
        self._jobs = jobs
        self._topics: WeakValueDictionary[str, Topic] = WeakValueDictionary()
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="job feed")

    async def follow(self, job_id: str, *, after: int, patience_s: float) -> AsyncIterator[JobEvent | None]:
        """Yield the history after event number `after`, then what happens until the job ends.

        Yields None when nothing happened for `patience_s` [s].
        """
        topic = self._topics.setdefault(job_id, Topic())
        loop = asyncio.get_running_loop()
        number, heard_at = after + 1, loop.time()
        while True:
            async with topic.reading:
                if loop.time() - topic.read_at >= POLL_S:
                    news = partial(self._jobs.news, job_id, after=len(topic.events) - 1)
                    found, topic.over = await loop.run_in_executor(self._reader, news)
                    topic.events += found
                    topic.read_at = loop.time()
            for event in topic.events[number:]:
                yield event
                number, heard_at = event.number + 1, loop.time()
            if topic.over:
                return
            if loop.time() - heard_at >= patience_s:
                heard_at = loop.time()
                yield None
            await asyncio.sleep(POLL_S)

    def close(self) -> None:
        """Read no more."""
        self._reader.shutdown(wait=False, cancel_futures=True)
