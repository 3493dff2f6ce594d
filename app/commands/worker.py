"""`gearcase worker`: run jobs. As many as one likes, on any machine that reaches the database."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import structlog
import typer

from app.commands.frame import Frame, frame_of
from app.job_kinds import job_kinds, open_jobs, url_of
from app.logs import configure_logs
from app.settings import Settings
from app.worker_slot import stop_on_signals, take_slot

log = structlog.get_logger(__name__)
Name = Annotated[str | None, typer.Option(help="name of this worker; the first free one of this machine by default")]
Adopt = Annotated[
    list[str] | None, typer.Option(help="take over the jobs of a worker that will not return; may be repeated")
]
Parent = Annotated[int | None, typer.Option(hidden=True, help="stop when this process has gone")]


def register(app: typer.Typer) -> None:
    app.command("worker")(worker)


def worker(context: typer.Context, name: Name = None, adopt: Adopt = None, parent: Parent = None) -> None:
    """Run jobs until stopped; what is unfinished then goes back into the queue.

    Workers of this machine that died are noticed by their released locks, and their jobs are taken over. A worker
    of another machine has to be named with --adopt.
    """
    from app.job_runner import run_worker  # `serve` imports this module, and needs no job engine

    frame: Frame = frame_of(context)
    configure_logs()
    stop = stop_on_signals()
    slot, dead = take_slot(frame.settings.data_dir)
    jobs = open_jobs(frame.settings)
    for lost in {*dead, *(adopt or ())} - {name}:
        count = jobs.adopt(lost)
        if count:
            log.info("took over what another worker held", worker=lost, count=count)
    jobs.close()
    log.info("worker waits for jobs", worker=name or slot.name)
    run_worker(url_of(frame.settings), job_kinds(frame.settings), name or slot.name, stop=stop, parent=parent)
    slot.lock.close()


@contextmanager
def worker_child(settings: Settings) -> Iterator[subprocess.Popen[bytes]]:
    """A worker process of the service's own, which ends with it however it ends."""
    command = [sys.executable, "-m", "app", "--data-dir", str(settings.data_dir), "worker"]
    child = subprocess.Popen([*command, "--parent", str(os.getpid())], stdin=subprocess.DEVNULL)  # noqa: S603
    try:
        yield child
    finally:
        child.terminate()
        child.wait()
