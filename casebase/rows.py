"""Rows of one database into another, SQLite or PostgreSQL: one transaction each, every table, nothing left out."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from sqlalchemy import JSON, Connection, Engine, RowMapping, Table, delete, func, insert, select, text

from casebase.database import WRITING
from casebase.errors import BackupError
from casebase.models import Base, LibraryCounter

AT_A_TIME = 500


def copy_rows(source: Engine, target: Engine) -> None:
    """Copy all rows as they are at one moment; both databases have the tables of the present revision.

    Raises:
        BackupError: if the target holds anything already; nothing is changed then.
    """
    moment = {"isolation_level": "REPEATABLE READ"} if source.dialect.name == "postgresql" else {}
    with (
        source.connect().execution_options(**moment) as here,
        target.connect().execution_options(**{WRITING: True}) as there,
        there.begin(),
    ):
        _check_empty(there)
        there.execute(delete(LibraryCounter))
        for table in Base.metadata.sorted_tables:
            for rows in here.execution_options(yield_per=AT_A_TIME).execute(select(table)).mappings().partitions():
                for alike in _alike(table, rows):
                    there.execute(insert(table), alike)
        if target.dialect.name == "postgresql":
            # rows came with their numbers; the next one must not begin at 1 again
            there.execute(text("SELECT setval(pg_get_serial_sequence('audit', 'id'), max(id)) FROM audit"))


def _check_empty(there: Connection) -> None:
    for table in Base.metadata.sorted_tables:
        if table.name != LibraryCounter.__tablename__ and there.scalar(select(func.count()).select_from(table)):
            raise BackupError(f"the database is not empty ({table.name} has rows); restore into a new one")


def _alike(table: Table, rows: Sequence[RowMapping]) -> Iterator[list[dict[str, Any]]]:
    """Yield rows in groups with the same columns: a document that is absent is left out, or it would become `null`."""
    documents = {column.name for column in table.columns if isinstance(column.type, JSON)}
    kept = [{name: value for name, value in row.items() if value is not None or name not in documents} for row in rows]
    for _, group in groupby(kept, key=",".join):
        yield list(group)
