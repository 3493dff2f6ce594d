"""A worker of jobs, on the job engine (DBOS).

A job of a kind is planned into tasks of 1 to 10 s, the tasks wait in a queue in the database, and every worker takes
one at a time. A task may run again after its worker died, so `JobKind.run` has to give the same result, and leave the
same behind, when it is repeated.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from dbos import DBOS, DBOSConfig, DBOSPortableJSONSerializer, SetEnqueueOptions, SetWorkflowID, WorkflowStatus

from app.job import JobFailedError, JobKind, Json
from app.jobs import APPLICATION, JOBS, POLL_S, PROGRESS, STATES, TASKS, VERSION, Jobs, prepare

WAITING_JOBS_PER_WORKER = 16  # a waiting job costs a sleeping thread, its tasks do the work


def run_worker(
    url: str, kinds: Sequence[JobKind], name: str, *, stop: threading.Event, parent: int | None = None
) -> None:
    """Work until `stop` is set, or until process `parent` has gone; then give back what is not finished.

    Jobs that a worker of this name left behind are taken up first.
    """
    prepare(url)
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
    DBOS.register_queue(TASKS, worker_concurrency=1, polling_interval_sec=0.25)
    while not stop.wait(POLL_S):
        if parent is not None and os.getppid() != parent:
            stop.set()
    DBOS.destroy(workflow_completion_timeout_sec=10)
    jobs = Jobs(url, ())
    jobs.adopt(name)
    jobs.close()


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
        failed = [task.workflow_id for task in tasks if STATES[task.status] == "failed"]
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
    return STATES[task.status] in ("queued", "running")


def _finish(kind: JobKind, job_id: str, parameters: dict[str, Json]) -> Json:
    tasks = DBOS.list_workflows(parent_workflow_id=job_id, load_input=False)
    ordered = sorted(tasks, key=lambda task: int(task.workflow_id.rpartition("/")[2]))
    return kind.finish(parameters, [task.output for task in ordered])
