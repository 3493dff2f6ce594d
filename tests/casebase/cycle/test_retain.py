"""Retain and revise: what is stored once, what is refused, what is remembered."""

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError

import migrations
from casebase.errors import (
    ConflictError,
    InvalidRequestError,
    SchemaError,
    StaleVersionError,
)
from casebase.library import CaseLibrary
from casebase.search.case_filter import CaseFilter
from casebase.store.counter import library_version
from casebase.store.database import migration_config, upgrade_database
from casebase.store.models import Base
from tests.casebase.made import add_case, store


def test_migrations_make_the_tables_of_the_models(library: CaseLibrary) -> None:
    with library.engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []


def test_a_database_at_the_newest_revision_is_known_without_looking_through_the_migrations(
    library: CaseLibrary,
) -> None:
    with library.engine.connect() as connection:
        scripts = ScriptDirectory.from_config(migration_config(connection))
        assert (
            scripts.get_current_head()
            == migrations.NEWEST
            == MigrationContext.configure(connection).get_current_revision()
        )


def test_tables_of_another_version_are_refused_in_a_sentence(sqlite_library: CaseLibrary) -> None:
    with sqlite_library.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '0008'"))
    with pytest.raises(SchemaError, match="revision 0008"):
        upgrade_database(sqlite_library.engine)


def test_missing_features_come_back_missing(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        row = store(library, session, [1.5, float("nan"), -2.5])
    with library.reading() as session:
        features = library.retrieve.recording(session, row.id).features[0]
    assert features.finite.tolist() == [1.5, 0.0, -2.5]
    assert features.missing == bytes([0b01000000])


def test_audio_is_on_disk_before_its_row(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        row = store(library, session, [1.0])
        assert library.retrieve.audio_path(row).stat().st_size == row.byte_count


def test_revision_needs_the_current_version_and_is_remembered(library: CaseLibrary) -> None:
    with library.transaction("anna") as session:
        case = add_case(library, session, [1.0], "notch", seed=1)
    with library.transaction("bert") as session:
        revised = library.revise.case(session, case.id, {"label": "play"}, expected_version=1)
        assert revised.version == 2
    with library.transaction("carl") as session, pytest.raises(StaleVersionError):
        library.revise.case(session, case.id, {"label": "normal"}, expected_version=1)
    with library.reading() as session:
        entries = library.retrieve.history(session, case.id)
    assert [(entry.actor, entry.action) for entry in entries] == [
        ("anna", "case.retained"),
        ("bert", "case.revised"),
    ]
    assert (entries[1].before, entries[1].after) == ({"label": "notch"}, {"label": "play"})


def test_retired_case_leaves_the_list_and_comes_back(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        case = add_case(library, session, [1.0], "notch", seed=1)
        library.revise.retire(session, case.id)
    with library.transaction("test") as session:
        assert library.retrieve.cases(session, CaseFilter()).items == []
        library.revise.restore(session, case.id)
        with pytest.raises(ConflictError):
            library.revise.restore(session, case.id)
        assert [each.id for each in library.retrieve.cases(session, CaseFilter()).items] == [case.id]


def test_a_failed_transaction_leaves_nothing(library: CaseLibrary) -> None:
    def two_cases() -> None:
        with library.transaction("test") as session:
            add_case(library, session, [1.0], "notch", seed=1)
            add_case(library, session, [1.0], "", seed=2)

    with pytest.raises(InvalidRequestError):
        two_cases()
    with library.reading() as session:
        assert library.retrieve.cases(session, CaseFilter()).items == []
        assert library_version(session) == 0


def test_filters_select(library: CaseLibrary) -> None:
    with library.transaction("test") as session:
        add_case(library, session, [1.0], "notch", seed=1, gearbox="g1")
        add_case(library, session, [1.0], "play", seed=2, gearbox="g2", origin="simulated")
    with library.reading() as session:
        for wanted in (CaseFilter(label="play"), CaseFilter(origin="simulated"), CaseFilter(gearbox="g2")):
            assert [case.label for case in library.retrieve.cases(session, wanted).items] == ["play"]
        assert library.retrieve.cases(session, CaseFilter(axis="other")).items == []


@pytest.mark.parametrize("statement", ["UPDATE audit SET actor = 'nobody'", "DELETE FROM audit"])
def test_audit_cannot_be_altered(library: CaseLibrary, statement: str) -> None:
    with library.transaction("test") as session:
        add_case(library, session, [1.0], "notch", seed=1)
    with library.engine.connect() as connection, pytest.raises(DBAPIError, match="append-only"):
        connection.execute(text(statement))
