"""What is under way on disk is held by a lock, which the system releases when its writer dies, however it dies."""

import fcntl
import os
import shutil
from collections.abc import Iterable
from pathlib import Path


def hold(descriptor: int) -> None:
    """Hold an open file or folder as long as it is open."""
    fcntl.flock(descriptor, fcntl.LOCK_EX)


def count_abandoned(paths: Iterable[Path], *, remove: bool) -> int:
    """Return how many files and folders nobody holds any more, and remove them if told to."""
    return sum(_is_abandoned(path, remove) for path in paths)


def _is_abandoned(path: Path, remove: bool) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    else:
        if remove and path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        elif remove:
            path.unlink(missing_ok=True)
        return True
    finally:
        os.close(descriptor)
