"""Engines and column types: SQLite in WAL mode or PostgreSQL with pgvector, by URL."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from sqlite3 import Connection as SqliteConnection
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray
from pgvector.sqlalchemy import Vector as PgVector
from sqlalchemy import Connection, DateTime, Dialect, Engine, LargeBinary, create_engine, event, inspect, text
from sqlalchemy.engine import URL, make_url
from sqlalchemy.types import TypeDecorator, TypeEngine

import migrations
from casebase.errors import SchemaError

if TYPE_CHECKING:
    from alembic.config import Config

WRITING = "gearcase_writing"
"""Execution option of a connection whose transaction will write."""
CLIENT_TIMEOUTS = {
    "connect_timeout": "5",
    "keepalives_idle": "4",
    "keepalives_interval": "2",
    "keepalives_count": "3",
    "tcp_user_timeout": "10000",
}
SERVER_TIMEOUTS = "-c tcp_keepalives_idle=4 -c tcp_keepalives_interval=2 -c tcp_keepalives_count=3"
"""A connection on which nothing comes back is given up after 10 s, on either side."""
LONGEST_WAIT_S = 30.0
"""For others that write, or for a connection [s]."""
SQLITE_CONNECTIONS = 64
"""More than a process has threads: none waits for another's."""
STANDSTILL_S = 60
"""A transaction that writes may think for so long between two statements [s]."""


LARGEST_LOG = 16 * 1024 * 1024
"""Bytes that SQLite's write-ahead log keeps once all of it is in the database; one large transaction may need more."""


class FloatVector(TypeDecorator[NDArray[np.float32]]):
    """A vector of finite float32: little-endian BLOB on SQLite, `vector` on PostgreSQL."""

    impl = LargeBinary
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        implementation: TypeEngine[Any] = PgVector() if dialect.name == "postgresql" else LargeBinary()
        return dialect.type_descriptor(implementation)

    def process_bind_param(self, value: NDArray[np.float32] | None, dialect: Dialect) -> object:
        if value is None:
            return None
        vector = np.ascontiguousarray(value, dtype="<f4")
        return vector if dialect.name == "postgresql" else vector.tobytes()

    def process_result_value(self, value: object, dialect: Dialect) -> NDArray[np.float32] | None:
        if value is None:
            return None
        if isinstance(value, bytes):
            return np.frombuffer(value, dtype="<f4")
        return np.asarray(value, dtype=np.float32)


class UtcDateTime(TypeDecorator[datetime]):
    """An instant; goes in with any offset, comes back in UTC, on either database."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError("a time without offset is no instant; give it a time zone")
        return value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


def strict_json(document: object) -> str:
    """Return JSON without NaN or infinity; raises ValueError on either."""
    return json.dumps(document, allow_nan=False, separators=(",", ":"))


def create_engine_for(url: str, longest_wait_s: float = LONGEST_WAIT_S, *, look: bool = False) -> Engine:
    """Return an engine for `sqlite:///path` or `postgresql://...` (psycopg is the driver).

    Args:
        longest_wait_s: for others that write, or for a connection [s].
        look: of SQLite, make no database and leave what is there as it is.
    """
    parsed = make_url(url)
    if parsed.drivername in ("postgresql", "postgres"):
        parsed = parsed.set(drivername="postgresql+psycopg")
    if parsed.get_backend_name() == "sqlite":
        return _sqlite_engine(parsed, longest_wait_s, look=look)
    if parsed.get_backend_name() == "postgresql":
        return _postgresql_engine(impatient(parsed), longest_wait_s)
    raise ValueError(f"database {parsed.get_backend_name()!r} is not known: use sqlite:/// or postgresql://")


def impatient(url: URL) -> URL:
    """Return the URL of a PostgreSQL database by which both ends notice within seconds that the other is cut off.

    Else a client waits a quarter of an hour for it, and the server keeps the locks of the client for two.
    """
    given = dict(url.query)
    if "options" in given:
        given["options"] = f"{SERVER_TIMEOUTS} {given['options']}"  # of two that are given the last counts
    return url.set(query={**CLIENT_TIMEOUTS, "options": SERVER_TIMEOUTS, **given})


def sqlite_url(path: Path) -> str:
    """Return the URL of an SQLite database file."""
    return f"sqlite:///{path.resolve()}"


def _postgresql_engine(url: URL, longest_wait_s: float) -> Engine:
    pool = {"pool_pre_ping": True, "pool_size": 10, "max_overflow": 20, "pool_timeout": longest_wait_s}
    engine = create_engine(url, json_serializer=strict_json, **pool)

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # whoever stands still in a transaction that writes would keep everybody from writing
        if connection.get_execution_options().get(WRITING, False):
            connection.exec_driver_sql(
                f"SET LOCAL idle_in_transaction_session_timeout = '{STANDSTILL_S}s'; "
                f"SET LOCAL lock_timeout = {round(1000 * longest_wait_s)}"
            )

    return engine


def _looking(url: URL) -> URL:
    """Return the URL of an SQLite file that is only read."""
    path = Path(str(url.database))
    # who reads alone leaves a log behind, who may write clears one away that a kill left
    mode = "ro" if path.with_name(f"{path.name}-wal").exists() else "rw"
    return make_url(f"sqlite:///file:{quote(str(path.resolve()))}?mode={mode}&uri=true")


def _sqlite_engine(url: URL, longest_wait_s: float, *, look: bool = False) -> Engine:
    url, pool = _looking(url) if look else url, {"pool_size": 5, "max_overflow": SQLITE_CONNECTIONS - 5}
    engine = create_engine(url, connect_args={"timeout": longest_wait_s}, json_serializer=strict_json, **pool)

    @event.listens_for(engine, "connect")
    def configure(connection: SqliteConnection, _record: object) -> None:
        connection.isolation_level = None  # the "begin" event below says how a transaction starts
        if look:
            connection.execute("PRAGMA query_only=ON")
            return
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("PRAGMA foreign_keys=ON")
        connection.execute("PRAGMA trusted_schema=OFF")  # a file from elsewhere may bring triggers of its own
        connection.execute(f"PRAGMA journal_size_limit={LARGEST_LOG}")

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # a transaction that reads first and writes later would fail at once under another writer
        writing = connection.get_execution_options().get(WRITING, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writing else "BEGIN")

    return engine


def upgrade_database(engine: Engine, *, look: bool = False) -> None:
    """Make the tables of an empty database; does nothing when they are there already.

    There is one migration, so that nothing which holds anything is ever changed.

    Args:
        look: make none.

    Raises:
        SchemaError: if its tables are those of another version, or there are none to look at.
    """
    with engine.connect().execution_options(**{WRITING: not look}) as connection, connection.begin():
        revision = _revision(connection)
        if revision == migrations.NEWEST:
            return
        if look and revision is None:
            raise SchemaError("there is no library yet: `gearcase serve` makes one")
        if revision is not None:
            raise SchemaError(
                f"the tables of this library are of revision {revision}, and this version needs {migrations.NEWEST}: "
                "open it with the version that made it, or begin with another data folder"
            )
        from alembic import command  # slow to import, and rarely needed

        command.upgrade(migration_config(connection), "head")


def _revision(connection: Connection) -> str | None:
    """Return the revision of the tables; None where there are none."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    found = connection.scalar(text("SELECT version_num FROM alembic_version"))
    return None if found is None else str(found)


def migration_config(connection: Connection) -> Config:
    """Return Alembic's configuration for an open connection; it never prints."""
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(Path(migrations.__path__[0])).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config
