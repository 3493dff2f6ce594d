"""A worker of jobs: claims steps, does them and writes what became of them.

A job is planned into tasks of 1 to 10 s; when they are done, it is finished. A step is claimed by writing the worker's
lease (`casebase.store.leases`) into its row, and is free again once that lease has ended. Whatever a worker writes is
committed only while it holds its lease. A step may be done again after its worker died, so `JobKind.run` has to give
the same result, and leave the same behind, when it is repeated.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

import structlog
from sqlalchemy import Select, and_, case, delete, func, or_, select, tuple_, update
from sqlalchemy.exc import DBAPIError, SQLAlchemyError
from sqlalchemy.orm import Session

from app.jobs.job import JobError, JobKind, JobState, JobStateError, Json, Progress
from app.jobs.jobs import ACTOR, OVER, POLL_S
from app.storage_faults import is_passing
from casebase.errors import LeaseLostError, LibraryError, StaleVersionError
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.leases import BEATS, LEASE_S, Silence
from casebase.store.models import JobStep, StoredJob, StoredJobEvent, WorkerLease, now
from signals.errors import SignalError
from sim.errors import SimulationError

LANES = (("task",), ("plan", "finish"), ("plan", "finish"), ("plan", "finish"))
"""What the threads of a worker do: one at a time of the tasks, and some beside it of what may wait for a network."""
MOST_LOST = 20
RETRY_S = 1.0
FINISHING_S = 1.0
"""What is under way when a worker is told to stop is given so long; it may be minutes of work, and is done again."""
LEAVING_S = 4.0
"""In all a worker ends within 5 s of being told, with or without a database; who runs containers kills after 10 s."""
EXPECTED = JobError, LibraryError, SignalError, SimulationError
"""What is wrong with what somebody ordered: its words say all, where the program was says nothing."""
REPORTED = 0.005
"""A step that is less further says nothing of it."""
LOG = structlog.get_logger(__name__)
Done = TypeVar("Done")
Key = tuple[str, int]


def run_worker(
    library: CaseLibrary,
    kinds: Sequence[JobKind],
    name: str,
    *,
    stop: threading.Event,
    parent: int | None = None,
    lease_s: float = LEASE_S,
) -> bool:
    """Work until `stop` is set, or until process `parent` has gone; then give back what is not finished.

    Threads may be left that are still at a task: end the process (`app.logs.leave`).

    Args:
        library: the one that the kinds write into; it writes nothing more once the lease has ended.
        lease_s: others take over what this worker has in hand when they have not heard of it for so long [s].

    Returns:
        Whether the lease was lost: the worker is to begin anew.
    """
    worker = Worker.begin(library, kinds, name, stop, lease_s)
    lanes = [threading.Thread(target=worker.work, args=(steps,), daemon=True) for steps in LANES]
    for thread in (threading.Thread(target=worker.beat, daemon=True), *lanes):
        thread.start()
    LOG.info("worker waits for jobs", worker=worker.lease)
    while not stop.wait(POLL_S):
        if parent is not None and os.getppid() != parent:
            stop.set()
    if not worker.lost:
        leaving = threading.Thread(target=worker.give_back, args=(lanes,), daemon=True)
        leaving.start()
        leaving.join(LEAVING_S)
    return worker.lost


@dataclass(frozen=True)
class Claim:
    """A step that this worker does."""

    key: Key
    step: str
    kind: JobKind
    parameters: dict[str, Json]
    results: list[Json]
    """Of the tasks, for the step that makes one of them."""


@dataclass
class Worker:
    """One worker with its lease: `library` writes only while that lasts, `unfenced` always."""

    library: CaseLibrary
    unfenced: CaseLibrary
    kinds: Mapping[str, JobKind]
    lease: str
    lease_s: float
    stop: threading.Event
    lost: bool = False
    running: set[Key] = field(default_factory=set)
    """Steps that threads of this process are at."""
    claiming: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def begin(
        cls, library: CaseLibrary, kinds: Sequence[JobKind], name: str, stop: threading.Event, lease_s: float = LEASE_S
    ) -> Worker:
        """Take a lease, by which from now on all that is written into this library is fenced."""
        unfenced = CaseLibrary(library.engine, library.data_dir, library.writers)
        with unfenced.transaction(name) as session:
            library.lease = leases.take(session, name, lease_s)
        return cls(library, unfenced, {kind.name: kind for kind in kinds}, library.lease, lease_s, stop)

    def beat(self) -> None:
        """Keep the lease, and end those of workers that fell silent."""
        silence = Silence(self.lease_s / BEATS)
        beat_file = leases.beat_file(self.library.data_dir)
        beat_file.parent.mkdir(exist_ok=True)
        beat_file.touch()
        while not self.stop.wait(silence.beat_s):
            try:
                with self.unfenced.transaction(ACTOR) as session:
                    leases.beat(session, self.lease)
                    others = [each for each in leases.held(session) if each.id != self.lease]
                beat_file.touch()
                for other, beats in silence.after_beat(others):
                    with self.unfenced.transaction(ACTOR) as session:
                        ended = leases.end(session, other, beats)
                    if ended:
                        LOG.warning("a worker fell silent; others take over what it had in hand", worker=other)
            except LeaseLostError:
                LOG.warning("this worker fell silent and lost what it had in hand; it begins anew", worker=self.lease)
                self.lost = True
                self.stop.set()
            except SQLAlchemyError as error:
                LOG.warning("no beat of this worker: the database does not take it", error=str(error))

    def work(self, steps: Sequence[str]) -> None:
        """Do steps of these sorts, one after the other."""
        while not self.stop.is_set():
            try:
                if not self.do_one(steps):
                    self.stop.wait(POLL_S)
            except SQLAlchemyError as error:
                LOG.warning("the database does not take what became of a step", error=str(error))
                self.stop.wait(RETRY_S)

    def do_one(self, steps: Sequence[str]) -> bool:
        """Do the next step of these sorts; whether there was one."""
        claim = self.patiently(self._claim, steps)
        if claim is None:
            return False
        try:
            self.patiently(self._close, claim, self.patiently(self._result, claim))
        except JobStateError:
            self.patiently(self._close, claim, None)
        except Exception as error:
            if self.stop.is_set():
                return False  # what fails while all is taken down stays, for another worker
            about = {"job": claim.key[0], "number": claim.key[1], "error": str(error)}
            LOG.warning("a step of a job failed", **about, exc_info=not isinstance(error, EXPECTED))
            self.patiently(self._close, claim, None, error)
        finally:
            self.running.discard(claim.key)
        return True

    def patiently(self, work: Callable[..., Done], *arguments: Any) -> Done:
        """Do a piece of work, again for as long as the database is away, or where somebody else was at it.

        What a killed worker committed last may arrive while its work is done again: that then begins with it.
        Where it may not be written any more, or the worker stops, the piece stays where it is, for another worker.
        """
        while True:
            try:
                return work(*arguments)
            except LeaseLostError:
                raise SystemExit from None  # no answer of this worker counts: not even that it failed
            except DBAPIError as error:
                if not is_passing(error):
                    raise
                LOG.warning("the database is away; the work is done again when it is back", error=str(error))
            except StaleVersionError as error:
                LOG.warning("somebody else wrote what this work writes; it is done again", error=str(error))
            if self.stop.wait(RETRY_S):
                raise SystemExit

    def give_back(self, lanes: Sequence[threading.Thread]) -> None:
        """Put what is not finished back into the queue, and end the lease."""
        until = time.monotonic() + FINISHING_S
        for thread in lanes:
            thread.join(max(0.0, until - time.monotonic()))
        mine = StoredJob.worker == self.lease, StoredJob.state == "running"
        with self.unfenced.transaction(ACTOR) as session:
            session.execute(update(StoredJob).where(*mine).values(state="queued", worker=None))
            session.execute(update(JobStep).where(JobStep.lease == self.lease).values(lease=None))
            leases.end(session, self.lease)
        leases.beat_file(self.library.data_dir).unlink(missing_ok=True)

    def _claim(self, steps: Sequence[str]) -> Claim | None:
        with self.claiming:  # so that what the threads of this worker are at is known when the next step is chosen
            with self.library.reading() as session:  # in vain it keeps nobody from writing
                if session.scalars(self._free(steps)).first() is None:
                    return None
            with self.library.transaction(ACTOR) as session:
                step = session.scalars(self._free(steps).with_for_update(of=JobStep, skip_locked=True)).first()
                job = None if step is None else session.get(StoredJob, step.job_id, with_for_update=True)
                if step is None or job is None or job.state in OVER:
                    return None
                if step.lease not in (None, self.lease):
                    if session.get(WorkerLease, step.lease) is not None:
                        return None  # of one that began while this was waiting for the row
                    step.lost += 1
                if step.lost > MOST_LOST:
                    _end(session, job, "failed", error="given up: worker after worker died while at it")
                    return None
                step.lease, step.fraction = self.lease, 0.0
                if job.state == "queued":
                    job.state, job.started_at = "running", now()
                    job.started_fraction = float(str(job.progress.get("fraction", 0.0)))
                job.worker = self.lease
                tasks = select(JobStep).where(JobStep.job_id == job.id, JobStep.step == "task")
                done = [] if step.step != "finish" else session.scalars(tasks.order_by(JobStep.number)).all()
                parameters: Any = step.parameters if step.step == "task" else job.parameters
                results = [each.result for each in done]
                claim = Claim((job.id, step.number), step.step, self.kinds[job.kind], parameters, results)
            self.running.add(claim.key)
        return claim

    def _free(self, steps: Sequence[str]) -> Select[JobStep]:
        """Select the next step that nobody does."""
        # a claim whose confirmation got lost with the connection is nobody's work: it is claimed again
        forgotten = and_(JobStep.lease == self.lease, tuple_(JobStep.job_id, JobStep.number).not_in(self.running))
        priority = case({name: kind.priority for name, kind in self.kinds.items()}, value=StoredJob.kind)
        return (
            select(JobStep)
            .join(StoredJob)
            .where(
                JobStep.step.in_(steps),
                JobStep.done.is_(False),
                or_(JobStep.lease.is_(None), JobStep.lease.not_in(select(WorkerLease.id)), forgotten),
                StoredJob.finished_at.is_(None),
                StoredJob.kind.in_(self.kinds),
                or_(StoredJob.not_before.is_(None), StoredJob.not_before <= now()),
            )
            .order_by(priority, StoredJob.id, JobStep.number)
            .limit(1)
        )

    def _result(self, claim: Claim) -> Any:
        if claim.step == "plan":
            return claim.kind.plan(claim.parameters)
        if claim.step == "finish":
            return claim.kind.finish(claim.parameters, claim.results)
        last = "", 0.0

        def report(stage: str, fraction: float) -> None:
            nonlocal last
            if stage != last[0] or fraction - last[1] >= REPORTED:
                last = stage, fraction
                self.patiently(self._report, claim, stage, fraction)

        return claim.kind.run(claim.parameters, report)

    def _report(self, claim: Claim, stage: str, fraction: float) -> None:
        with self.library.transaction(ACTOR) as session:
            job = session.get_one(StoredJob, claim.key[0], with_for_update=True)
            step = session.get(JobStep, claim.key)
            if step is None or job.state in OVER:
                raise JobStateError(f"job {job.id} is {job.state}")
            step.fraction = fraction
            _note(session, job, stage)

    def _close(self, claim: Claim, result: Any, error: Exception | None = None) -> None:
        """Write what became of a step; of a job that was cancelled meanwhile it is done again if that is resumed."""
        with self.library.transaction(ACTOR) as session:
            job = session.get_one(StoredJob, claim.key[0], with_for_update=True)
            step = session.get(JobStep, claim.key)
            if step is None or step.lease != self.lease:
                return  # that was written, and its confirmation got lost with the connection
            step.lease = None
            if job.state in OVER:
                return
            if error is not None:
                of = f"task {step.number}: " if step.step == "task" else ""
                _end(session, job, "failed", error=f"{of}{error}")
            elif step.step == "finish":
                _end(session, job, "done", result=result)
            else:
                step.done, step.fraction = True, 1.0
                if step.step == "plan":
                    session.add_all(
                        JobStep(job_id=job.id, number=number, step="task", parameters=task)
                        for number, task in enumerate(result)
                    )
                else:
                    step.result = result
                progress = _note(session, job, claim.kind.stage)
                if progress.done == progress.total:
                    session.add(JobStep(job_id=job.id, number=progress.total, step="finish"))


def _note(session: Session, job: StoredJob, stage: str) -> Progress:
    """Write down how far a job is, the remaining time as estimated from its pace since it runs."""
    session.flush()
    counts = func.count(), func.count().filter(JobStep.done), func.coalesce(func.sum(JobStep.fraction), 0.0)
    total, done, gone = session.execute(select(*counts).where(JobStep.job_id == job.id, JobStep.step == "task")).one()
    fraction = min(float(gone) / max(total, 1), 1.0)
    elapsed_s = 0.0 if job.started_at is None else (now() - job.started_at).total_seconds()
    gained = fraction - job.started_fraction
    remaining_s = round((1.0 - fraction) * elapsed_s / gained, 1) if gained > 0 and elapsed_s > 2 * POLL_S else None
    progress = Progress(stage, round(fraction, 4), done, total, remaining_s)
    job.progress = asdict(progress)
    number = session.scalar(select(func.count()).where(StoredJobEvent.job_id == job.id))
    session.add(StoredJobEvent(job_id=job.id, number=number, progress=job.progress))
    return progress


def _end(session: Session, job: StoredJob, state: JobState, result: Json = None, error: str | None = None) -> None:
    job.state, job.result, job.error, job.worker, job.finished_at = state, result, error, None, now()
    if state == "done":
        total = job.progress.get("total", 0)
        job.progress = {"stage": "done", "fraction": 1.0, "done": total, "total": total, "remaining_s": 0.0}
    session.execute(delete(JobStep).where(JobStep.job_id == job.id))
