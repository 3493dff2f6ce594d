"""What is under way on disk is held by a lock, which the system releases when its writer dies, however it dies."""

import fcntl
import os
import shutil
from collections.abc import Iterable
from pathlib import Path


def hold(descriptor: int) -> None:
    """Hold an open file or folder as long as it is open."""
    fcntl.flock(descriptor, fcntl.LOCK_EX)


def remove_abandoned(paths: Iterable[Path]) -> int:
    """Remove files and folders that nobody holds any more; return how many."""
    return sum(_removed(path) for path in paths)


def _removed(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    else:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        return True
    finally:
        os.close(descriptor)
