"""A worker as a process of this machine: its name, held by a lock, and how it is told to stop."""

import fcntl
import signal
import socket
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import IO


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
