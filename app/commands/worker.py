"""`gearcase worker`: run jobs. As many as one likes, on any machine that reaches the database."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated

import structlog
import typer
from sqlalchemy.exc import OperationalError

from app.commands import frame
from app.jobs.jobs import job_kinds
from app.logs import configure_logs
from app.process import leave, stop_on_signals
from app.settings import Settings
from app.storage_faults import is_passing

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
