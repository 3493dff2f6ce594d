"""The libraries of the field, made once and never changed by a test."""

from pathlib import Path

import pytest

from tests.field.libraries import Library, add_measured, add_starter
from tests.shared_data import shared


@pytest.fixture(scope="session")
def folder_of_libraries(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where they lie."""
    return tmp_path_factory.mktemp("libraries")


@pytest.fixture(scope="session")
def measured(folder_of_libraries: Path) -> Library:
    """M: the 24 recordings of four gearboxes."""
    shared("data", "axis_recordings")
    add_measured(folder_of_libraries / "M")
    return Library("M", folder_of_libraries / "M")


@pytest.fixture(scope="session")
def starter_and_measured(folder_of_libraries: Path, measured: Library) -> Library:
    """M+S: the 24 recordings and the starter."""
    data_dir = measured.copied(folder_of_libraries / "with_starter").data_dir
    add_starter(data_dir)
    return Library("M+S", data_dir)


@pytest.fixture(scope="session")
def starter(folder_of_libraries: Path) -> Library:
    """S: the 90 simulated cases of the starter alone."""
    add_starter(folder_of_libraries / "S")
    return Library("S", folder_of_libraries / "S")
