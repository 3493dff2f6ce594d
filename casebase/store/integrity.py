"""Whether an SQLite database is whole, and how large the log beside it may become.

PostgreSQL looks after both itself.
"""

import sqlite3
from contextlib import closing
from pathlib import Path

from sqlalchemy import Engine
from sqlalchemy.exc import DatabaseError

DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
SAID = 5
"""Faults that are told; the first are enough to know what to do."""
RESTORE = (
    "Stop the service, keep the data folder as it is, and bring the last backup back into a new one: "
    "`gearcase --data-dir NEW restore BACKUP`. What was stored after that backup is in the damaged database alone."
)


def is_damaged(error: BaseException) -> bool:
    """Whether an error says that the database file is spoilt."""
    found = error.orig if isinstance(error, DatabaseError) else error
    code = getattr(found, "sqlite_errorcode", None)
    return code is not None and code & 0xFF in DAMAGED


def faults_of(engine: Engine, *, thorough: bool = False) -> tuple[str, ...]:
    """Return what is wrong with the database's file, nothing if it is whole; the whole file is read.

    Args:
        thorough: compare every index with its table as well.
    """
    if engine.dialect.name != "sqlite":
        return ()
    check = "integrity_check" if thorough else "quick_check"
    try:
        with engine.connect() as connection:
            said = [str(row[0]) for row in connection.exec_driver_sql(f"PRAGMA {check}({SAID})")]
    except DatabaseError as error:
        if not is_damaged(error):
            raise
        said = [str(error.orig)]
    except UnicodeDecodeError as error:  # of what it says of names that are no text any more
        said = [str(error)]
    return () if said == ["ok"] else tuple(line for each in said for line in each.splitlines())[:SAID]


def cut_logs(folder: Path) -> None:
    """Bring the write-ahead logs of all databases in a folder into them and cut them to nothing, where nobody reads."""
    for log in folder.glob("*-wal"):
        with closing(sqlite3.connect(log.with_name(log.name.removesuffix("-wal")), timeout=1.0)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
