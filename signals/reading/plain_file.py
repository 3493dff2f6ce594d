"""Files that somebody names: to open a pipe or a device could wait for ever, and to read one need not end."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from signals.errors import NoPlainFileError


def open_plain(path: Path) -> BinaryIO:
    """Open a file for reading, by links too; never waits.

    Raises:
        NoPlainFileError: if it is a pipe, a device, a socket or a folder.
        OSError: if it cannot be opened.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise NoPlainFileError(f"{path} is a pipe, a device or a folder; name a file")
    return os.fdopen(descriptor, "rb")


def plain_bytes(path: Path) -> bytes:
    """Return what is in a file; raises as `open_plain`."""
    with open_plain(path) as file:
        return file.read()
