"""Fixtures that every part may use: a migrated database on SQLite and on PostgreSQL, a live service."""

import itertools
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from benchmarks.harness import postgres
from benchmarks.harness.live import LiveServer, started
from casebase.store.database import create_engine_for, sqlite_url, upgrade_database

settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")
os.environ.setdefault("GEARCASE_LONGEST_WAIT_S", "30")  # else services of a busy machine ask tests to come again

TEMPLATE = "gearcase_template"
LONGEST_FIRST = ("field", "test_pages.py", "jobs", "test_evaluation.py", "web", "app", "investigation")
"""Folders and files that take longest, so that no process of several is left with one at the end."""
CAMPAIGNS = ("test_quick_bank.py", "test_bombs.py", "test_unfit_inputs.py", "large")
"""Short forms of campaigns that have commands of their own; `make challenge` runs them."""
_numbers = itertools.count()


UNITS = ("acoustics", "chain", "description", "experiment", "mechanisms", "rotational", "test_bad_input.py")
SERVICES = {"live_server", "postgres_server", "sqlite_database_url", "database_url", "site", "inside"}


def _kind(item: pytest.Item) -> str:
    parts = item.path.relative_to(item.config.rootpath).parts
    if parts[1] == "sim" and parts[2] in UNITS:
        return "unit"
    service = parts[1] in ("web", "field", "benchmarks") or SERVICES & set(getattr(item, "fixturenames", ()))
    return "service" if service else "contract"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test by its kind; take the files that take longest first."""
    for item in items:
        item.add_marker(_kind(item))
        if "benchmarks" in item.path.parts and set(CAMPAIGNS) & set(item.path.parts):
            item.add_marker("slow")

    def place(item: pytest.Item) -> int:
        parts = item.path.relative_to(item.config.rootpath).parts
        return min((LONGEST_FIRST.index(part) for part in parts if part in LONGEST_FIRST), default=len(LONGEST_FIRST))

    items.sort(key=place)


@pytest.fixture(scope="session")
def live_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """One service for the whole run: leave it as you found it, and make names of your own."""
    server = started(tmp_path_factory.mktemp("live") / "data")
    server.until_ready()
    yield server
    server.stop()


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[str]:
    """URL of the database `postgres` of a real server; skips with the reason where none can be had."""
    try:
        server = postgres.running_server()
        url = server.__enter__()
    except (postgres.PostgresUnavailableError, OSError) as error:
        pytest.skip(f"no PostgreSQL here: {error}")
    try:
        yield url
    finally:
        server.__exit__(None, None, None)


@pytest.fixture(scope="session")
def postgres_template(postgres_server: str) -> str:
    """Name of a migrated, empty database to copy."""
    engine = create_engine_for(postgres.create_database(postgres_server, TEMPLATE))
    upgrade_database(engine)
    engine.dispose()
    return TEMPLATE


@pytest.fixture(scope="session")
def sqlite_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of a migrated, empty SQLite file to copy."""
    path = tmp_path_factory.mktemp("template") / "gearcase.db"
    engine = create_engine_for(sqlite_url(path))
    upgrade_database(engine)
    engine.dispose()
    return path


@pytest.fixture
def sqlite_database_url(sqlite_template: Path, tmp_path: Path) -> str:
    """URL of a migrated, empty SQLite database of this test alone."""
    path = tmp_path / "gearcase.db"
    shutil.copy(sqlite_template, path)
    return sqlite_url(path)


@pytest.fixture
def postgres_database_url(postgres_server: str, postgres_template: str) -> Iterator[str]:
    """URL of a migrated, empty PostgreSQL database of this test alone."""
    name = f"gearcase_{next(_numbers)}"
    yield postgres.create_database(postgres_server, name, postgres_template)
    postgres.drop_database(postgres_server, name)


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
def database_url(request: pytest.FixtureRequest) -> str:
    """URL of a migrated, empty database: the test runs once on SQLite and once on PostgreSQL."""
    name = "sqlite_database_url" if request.param == "sqlite" else "postgres_database_url"
    return str(request.getfixturevalue(name))
