"""`gearcase jobs list | show | follow | cancel | resume | workers | adopt`, and `gearcase worker`, which runs them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated

import structlog
import typer
from pydantic_core import to_jsonable_python
from sqlalchemy.exc import OperationalError

from app.commands import DONE, FAILURE, frame
from app.commands.frame import Json
from app.jobs.job import Job
from app.jobs.jobs import job_kinds, open_jobs
from app.logs import configure_logs, leave, stop_on_signals
from app.settings import Settings
from app.storage_faults import is_passing

jobs = typer.Typer(help="List, follow, cancel, resume and adopt jobs.", no_args_is_help=True)
Id = Annotated[str, typer.Argument(metavar="JOB", help="id of the job")]


@jobs.command("list")
def list_jobs(json: Json = False) -> None:
    """List the newest jobs."""
    with open_jobs(frame.settings()) as opened:
        found = opened.page(limit=100).items
    rows = [
        (
            job.id,
            job.kind,
            job.about or "",
            job.state,
            job.progress.stage,
            f"{job.progress.fraction:.0%}",
            job.worker or "",
            f"{job.created_at:%Y-%m-%d %H:%M:%SZ}",
        )
        for job in found
    ]
    columns = ("job", "kind", "of", "state", "stage", "done", "worker", "since")
    frame.answer(json, [_document(job) for job in found], frame.table(columns, rows))


@jobs.command()
def show(job: Id, json: Json = True) -> None:
    """Show one job as JSON."""
    with open_jobs(frame.settings()) as opened:
        frame.print_json(_document(opened.get(job)))


@jobs.command()
def follow(job: Id, json: Json = False) -> None:
    """Follow a job to its end.

    The exit code is 0 if it is done, else 1.
    """
    with open_jobs(frame.settings()) as opened, frame.progress() as progress:
        bar = progress.add_task("queued", total=1.0)
        for event in opened.events(job):
            progress.update(bar, completed=event.progress.fraction, description=event.progress.stage)
        ended = opened.get(job)
    _tell(ended, json)
    raise typer.Exit(DONE if ended.state == "done" else FAILURE)


@jobs.command()
def cancel(job: Id, json: Json = False) -> None:
    """Stop a job.

    What is done of it stays, and it can be resumed.
    """
    with open_jobs(frame.settings()) as opened:
        _tell(opened.cancel(job), json)


@jobs.command()
def resume(job: Id, json: Json = False) -> None:
    """Go on with a cancelled job."""
    with open_jobs(frame.settings()) as opened:
        _tell(opened.resume(job), json)


@jobs.command()
def workers(json: Json = False) -> None:
    """List the workers that have jobs or tasks."""
    with open_jobs(frame.settings()) as opened:
        held = opened.workers()
    frame.answer(json, held, *(f"{name}\t{count}" for name, count in sorted(held.items())))


@jobs.command()
def adopt(
    worker: Annotated[str, typer.Argument(metavar="WORKER", help="as `jobs workers` names it")],
    json: Json = False,
) -> None:
    """Give the jobs of a dead worker to others now.

    Without this they take over 15 s after its last sign of life.
    """
    with open_jobs(frame.settings()) as opened:
        count = opened.adopt(worker)
    if json:
        frame.print_json({"worker": worker, "adopted": count})
        return
    frame.say(f"{count} jobs and tasks of {worker} go to the other workers" if count else f"{worker} holds nothing")


def _document(job: Job) -> dict[str, object]:
    document: dict[str, object] = to_jsonable_python(job)
    return document


def _tell(job: Job, json: bool) -> None:
    if json:
        frame.print_json(_document(job))
        return
    reason = f": {job.error}" if job.error else ""
    frame.say(f"job {job.id} is {job.state}, {job.progress.fraction:.0%} done{reason}")


if TYPE_CHECKING:
    from casebase.library import CaseLibrary

log = structlog.get_logger(__name__)
Name = Annotated[str | None, typer.Option(help="of this worker, to which a number is added; the host's by default")]
Parent = Annotated[int | None, typer.Option(hidden=True, help="stop when this process has gone")]
LogFolder = Annotated[Path | None, typer.Option(help="folder for the log, which goes to stderr otherwise")]
ATTEMPTS, APART_S = 30, 2.0
"""A worker that starts while the database is away waits for it for a minute."""
AGAIN_S = 5.0


def worker(name: Name = None, parent: Parent = None, log_folder: LogFolder = None) -> None:
    """Run jobs until stopped; what is unfinished then goes back into the queue.

    What a worker had in hand that died, or is cut off, is taken over by the others, on whatever machine, when they have
    not heard of it for GEARCASE_LEASE_S (15 s).
    """
    from app.jobs.runner import run_worker

    configure_logs("worker", log_folder)
    stop = stop_on_signals()
    library = _opened(frame.settings(), stop)
    tempfile.tempdir = str(library.data_dir)  # that of the system may be read-only
    lost = run_worker(
        library,
        job_kinds(library),
        name or socket.gethostname(),
        stop=stop,
        parent=parent,
        lease_s=frame.settings().lease_s,
    )
    leave(again=lost)


def _opened(settings: Settings, stop: Event) -> CaseLibrary:
    from casebase.library import CaseLibrary

    for _ in range(ATTEMPTS):
        try:
            return CaseLibrary.open(settings.data_dir, settings.database_url)
        except OperationalError as error:
            if not is_passing(error):
                raise
            log.warning("the worker waits for the database", error=str(error.orig))
        if stop.wait(APART_S):
            leave(again=False)
    return CaseLibrary.open(settings.data_dir, settings.database_url)


@contextmanager
def worker_child(settings: Settings, stopping: Event, log_folder: Path | None = None) -> Iterator[None]:
    """A worker process of the service's own, and another one if it dies; it ends with the service however that ends."""
    command = [sys.executable, "-m", "app", "--data-dir", str(settings.data_dir), "worker"]
    command += ["--parent", str(os.getpid())]
    command += ["--log-folder", str(log_folder)] if log_folder else []

    def keep() -> None:
        while not stopping.is_set():
            child = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603
            while child.poll() is None and not stopping.wait(0.2):
                pass
            if child.returncode is None:
                child.terminate()
                child.wait()
                return
            log.warning("the worker beside the service ended; another one is started", code=child.returncode)
            stopping.wait(AGAIN_S)

    keeper = Thread(target=keep, name="worker keeper")
    keeper.start()
    try:
        yield
    finally:
        stopping.set()
        keeper.join()
