"""A library that an earlier version made is brought to the tables of this one, with what stands in it."""

from pathlib import Path

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text

from casebase.database import WRITING, create_engine_for, migration_config, upgrade_database
from casebase.models import Base

MARK = (
    "INSERT INTO maintenance_marks (id, axis, at, text, created_at, created_by) "
    "VALUES ('a', 'arm', '2026-01-01', 'new grease', '2026-01-01', 'anna')"
)


def test_a_note_of_the_version_before_is_a_note(tmp_path: Path) -> None:
    engine = create_engine_for(f"sqlite:///{tmp_path / 'old.sqlite3'}")
    upgrade_database(engine, "0003")
    with engine.begin() as connection:
        connection.execute(text(MARK))
    upgrade_database(engine)
    with engine.connect() as connection:
        assert connection.execute(text("SELECT kind, successor FROM maintenance_marks")).all() == [("note", None)]
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    with engine.connect().execution_options(**{WRITING: True}) as connection, connection.begin():
        command.downgrade(migration_config(connection), "0003")
    engine.dispose()
