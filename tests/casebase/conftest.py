"""A library to work with, on both databases, and recordings made of numbers."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from casebase.library import CaseLibrary
from casebase.store.database import create_engine_for


@pytest.fixture
def library(database_url: str, tmp_path: Path) -> Iterator[CaseLibrary]:
    """An empty library."""
    opened = CaseLibrary(create_engine_for(database_url), tmp_path / "data")
    yield opened
    opened.close()


@pytest.fixture
def sqlite_library(sqlite_database_url: str, tmp_path: Path) -> Iterator[CaseLibrary]:
    """An empty library on SQLite, for what does not depend on the database."""
    opened = CaseLibrary(create_engine_for(sqlite_database_url), tmp_path / "data")
    yield opened
    opened.close()
