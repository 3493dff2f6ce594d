"""A worker of jobs, on the job engine (DBOS).

A job of a kind is planned into tasks of 1 to 10 s, the tasks wait in a queue in the database, and every worker takes
one at a time. A task may run again after its worker died, so `JobKind.run` has to give the same result, and leave the
same behind, when it is repeated. What a worker does is written only while it holds its lease
(`casebase.store.leases`); the engine, likewise, takes a result only from the one that claimed the task last.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import structlog
from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer, SetEnqueueOptions, SetWorkflowID, WorkflowStatus
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from app.jobs.job import JobFailedError, JobKind, Json
from app.jobs.jobs import ACTOR, APPLICATION, JOBS, POLL_S, PROGRESS, STATES, TASKS, VERSION, Jobs, prepare, reason_of
from app.storage_faults import is_passing
from casebase.errors import LeaseLostError, StaleVersionError
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.leases import BEATS, LEASE_S, Silence

WAITING_JOBS_PER_WORKER = 16  # a waiting job costs a sleeping thread, its tasks do the work
RETRY_S = 1.0
FINISHING_S = 1
"""What is under way when a worker is told to stop is given so long; it may be minutes of work, and is done again."""
LEAVING_S = 4.0
"""In all a worker ends within 5 s of being told, with or without a database; who runs containers kills after 10 s."""
LOG = structlog.get_logger(__name__)
Done = TypeVar("Done")


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

    Threads may be left that are still at a task: end the process (`app.process.leave`).

    Args:
        library: the one that the kinds write into; it writes nothing more once the lease has ended.
        lease_s: others take over what this worker has in hand when they have not heard of it for so long [s].

    Returns:
        Whether the lease was lost: the worker is to begin anew.
    """
    unfenced = CaseLibrary(library.engine, library.data_dir)
    with unfenced.transaction(name) as session:
        lease = leases.take(session, name, lease_s)
    library.lease = lease
    worker = _Worker(unfenced, Jobs(unfenced, [kind.name for kind in kinds]), lease, lease_s, stop)
    prepare(worker.jobs.url)
    config: DBOSConfig = {
        "name": APPLICATION,
        "system_database_url": worker.jobs.url,
        "application_version": VERSION,
        "executor_id": lease,
        "serializer": DBOSPortableJSONSerializer(),
        "log_level": "WARNING",
        "enable_otlp": False,
        "use_listen_notify": False,
        "notification_listener_polling_interval_sec": POLL_S,
    }
    DBOS(config=config)
    _register({kind.name: kind for kind in kinds}, worker)
    DBOS.listen_queues([JOBS, TASKS])
    DBOS.launch()
    DBOS.register_queue(JOBS, worker_concurrency=WAITING_JOBS_PER_WORKER, polling_interval_sec=POLL_S)
    DBOS.register_queue(TASKS, worker_concurrency=1, polling_interval_sec=0.25)
    LOG.info("worker waits for jobs", worker=lease)
    for work in (worker.beat, worker.tend):
        threading.Thread(target=work, name=work.__name__, daemon=True).start()
    while not stop.wait(POLL_S):
        if parent is not None and os.getppid() != parent:
            stop.set()
    if not worker.lost:
        leaving = threading.Thread(target=worker.give_back, daemon=True)
        leaving.start()
        leaving.join(LEAVING_S)
    return worker.lost


@dataclass
class _Worker:
    """What a worker does beside its tasks."""

    library: CaseLibrary
    jobs: Jobs
    lease: str
    lease_s: float
    stop: threading.Event
    lost: bool = False
    running: set[str] = field(default_factory=set)
    """Jobs and tasks that threads of this process are at."""

    def beat(self) -> None:
        """Keep the lease, and end those of workers that fell silent."""
        silence = Silence(self.lease_s / BEATS)
        while not self.stop.wait(silence.beat_s):
            try:
                with self.library.transaction(ACTOR) as session:
                    leases.beat(session, self.lease)
                    others = [each for each in leases.held(session) if each.id != self.lease]
                for other, beats in silence.after_beat(others):
                    with self.library.transaction(ACTOR) as session:
                        ended = leases.end(session, other, beats)
                    if ended:
                        LOG.warning("a worker fell silent; others take over what it had in hand", worker=other)
            except LeaseLostError:
                LOG.warning("this worker fell silent and lost what it had in hand; it begins anew", worker=self.lease)
                self.lost = True
                self.stop.set()
            except SQLAlchemyError as error:
                LOG.warning("no beat of this worker: the database does not take it", error=str(error))

    def tend(self) -> None:
        """See that the engine has every job that was ordered, and that every claim is somebody's."""
        since: dict[str, float] = {}
        while not self.stop.wait(POLL_S):
            try:
                self.jobs.agree()
                claims = self.jobs.claims()
                with self.library.reading() as session:  # after the claims: nobody claims before he has a lease
                    living = {each.id for each in leases.held(session)}
                dead = set(claims.values()) - living
                if dead:
                    DBOS._recover_pending_workflows(sorted(dead))
                # a claim whose confirmation got lost with the connection is nobody's work
                idle = [each for each, lease in claims.items() if lease == self.lease and each not in self.running]
                since = {each: since.get(each, time.monotonic()) for each in idle}
                forgotten = [each for each in idle if time.monotonic() - since[each] > self.lease_s]
                self.jobs.put_back(forgotten)
            except SQLAlchemyError as error:
                LOG.warning("the database does not say what there is to do", error=str(error))

    def give_back(self) -> None:
        """Put what is not finished back into the queue, and end the lease."""
        DBOS.destroy(workflow_completion_timeout_sec=FINISHING_S)
        self.jobs.put_back([each for each, lease in self.jobs.claims().items() if lease == self.lease])
        with self.library.transaction(ACTOR) as session:
            leases.end(session, self.lease)

    @contextmanager
    def at(self, claimed: str) -> Iterator[None]:
        """While this process is at a job or task; what fails while the worker stops, and all is taken down, stays."""
        self.running.add(claimed)
        try:
            yield
        except Exception:
            if self.stop.is_set():
                raise SystemExit from None
            raise
        finally:
            self.running.discard(claimed)

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


def _register(kinds: Mapping[str, JobKind], worker: _Worker) -> None:
    def run_task(kind: str, task: dict[str, Json]) -> Json:
        task_id = DBOS.workflow_id
        assert task_id is not None

        def report(stage: str, fraction: float) -> None:
            DBOS.update_workflow_attributes(task_id, {"stage": stage, "fraction": fraction}, merge=True)

        with worker.at(task_id):
            return DBOS.run_step({"name": "run"}, worker.patiently, kinds[kind].run, task, report)

    task_workflow = DBOS.workflow(name="task", max_recovery_attempts=20)(run_task)

    def run_job(kind: str, parameters: dict[str, Json]) -> Json:
        job_id = DBOS.workflow_id
        assert job_id is not None
        this = kinds[kind]
        with worker.at(job_id):
            tasks = DBOS.run_step({"name": "plan"}, worker.patiently, this.plan, parameters)
            for number, task in enumerate(tasks):
                with SetWorkflowID(f"{job_id}/{number}"), SetEnqueueOptions(priority=this.priority):
                    DBOS.enqueue_workflow(TASKS, task_workflow, kind, task)
            DBOS.run_step({"name": "wait"}, _wait, job_id, this.stage, len(tasks), worker.stop)
            return DBOS.run_step({"name": "finish"}, worker.patiently, _finish, this, job_id, parameters)

    DBOS.workflow(name="job", max_recovery_attempts=1000)(run_job)


def _wait(job_id: str, stage: str, total: int, stop: threading.Event) -> None:
    """Return when all tasks are done; write the progress on the way. Raises JobFailedError."""
    started, done_before, last = time.monotonic(), None, None
    while not stop.is_set():
        tasks = DBOS.list_workflows(parent_workflow_id=job_id, load_input=False, load_output=False)
        failed = [task.workflow_id for task in tasks if STATES[task.status] == "failed"]
        if failed:
            DBOS.cancel_workflows([task.workflow_id for task in tasks if _open(task)])
            reason = reason_of(DBOS.list_workflows(workflow_ids=failed[:1])[0])
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
    return STATES[task.status] in ("queued", "running")


def _finish(kind: JobKind, job_id: str, parameters: dict[str, Json]) -> Json:
    tasks = DBOS.list_workflows(parent_workflow_id=job_id, load_input=False)
    ordered = sorted(tasks, key=lambda task: int(task.workflow_id.rpartition("/")[2]))
    return kind.finish(parameters, [task.output for task in ordered])
