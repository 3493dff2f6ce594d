"""When the disk is full, or nothing can be written: said so, rather than called a fault of the program."""

import errno
from collections.abc import Iterator

from sqlalchemy.exc import DBAPIError, OperationalError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
UNWRITABLE = (errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO)
DISK_FULL = "53100"
"""PostgreSQL's code of it."""
LOCKED = "55P03"
"""And of who waited too long for others that write."""
PASSING = ("08", "57P", "25P03", "40", LOCKED)
"""And of connections, of a server that stops, of who stood still in a transaction, of who came into another's way."""


def is_full(error: BaseException) -> bool:
    """Whether there is no room left: SQLite then gives up the transaction, and an error of that may hide the first."""
    return any(_full(each) for each in _behind(error))


def is_unwritable(error: BaseException) -> bool:
    """Whether the disk or the database does not let us write, or cannot be reached."""
    if isinstance(error, OperationalError):
        return not is_full(error)
    return isinstance(error, OSError) and error.errno in UNWRITABLE


def is_passing(error: DBAPIError) -> bool:
    """Whether the database could not be reached, was stopped, or was in use: it may do the same work in a moment."""
    if error.connection_invalidated:
        return True
    state = getattr(error.orig, "sqlstate", "")
    if isinstance(error, OperationalError) and state is None:
        return True  # PostgreSQL was not reached at all
    return str(state).startswith(PASSING) or is_contended(error)


def is_contended(error: BaseException) -> bool:
    """Whether others wrote for so long that it gave up."""
    if not isinstance(error, OperationalError):
        return False
    return getattr(error.orig, "sqlstate", None) == LOCKED or "database is locked" in str(error.orig)


def _full(error: BaseException) -> bool:
    if isinstance(error, OperationalError):
        return getattr(error.orig, "sqlstate", None) == DISK_FULL or "is full" in str(error.orig)
    return isinstance(error, OSError) and error.errno in FULL


def _behind(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and those that were being handled when it came."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__
