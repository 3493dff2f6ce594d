"""When the disk is full, or nothing can be written: said so, rather than called a fault of the program."""

import errno
from collections.abc import Iterator

from sqlalchemy.exc import OperationalError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)
DISK_FULL = "53100"
"""PostgreSQL's code of it."""


def is_full(error: BaseException) -> bool:
    """Whether there is no room left: SQLite then gives up the transaction, and an error of that may hide the first."""
    return any(_full(each) for each in _behind(error))


def is_unwritable(error: BaseException) -> bool:
    """Whether the disk or the database does not let us write, or cannot be reached."""
    if isinstance(error, OperationalError):
        return not is_full(error)
    return isinstance(error, OSError) and error.errno in UNWRITABLE


def _full(error: BaseException) -> bool:
    if isinstance(error, OperationalError):
        return getattr(error.orig, "sqlstate", None) == DISK_FULL or "is full" in str(error.orig)
    return isinstance(error, OSError) and error.errno in FULL


def _behind(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and those that were being handled when it came."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
