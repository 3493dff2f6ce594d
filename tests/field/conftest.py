"""The libraries of the field, made once and never changed by a test."""

import shutil
from pathlib import Path

import pytest

from tests.field.libraries import Library, add_measured, add_starter, keep_learned
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
def unlearned_starter(folder_of_libraries: Path) -> Path:
    """The 90 simulated cases of the starter."""
    shared("data", "axis_recordings")
    add_starter(folder_of_libraries / "simulated")
    return folder_of_libraries / "simulated"


@pytest.fixture(scope="session")
def starter_and_measured(folder_of_libraries: Path, unlearned_starter: Path) -> Library:
    """M+S: the starter, then the 24 recordings."""
    data_dir = Path(shutil.copytree(unlearned_starter, folder_of_libraries / "M+S"))
    add_measured(data_dir)
    return Library("M+S", data_dir)


@pytest.fixture(scope="session")
def starter(folder_of_libraries: Path, unlearned_starter: Path) -> Library:
    """S: the starter alone."""
    data_dir = Path(shutil.copytree(unlearned_starter, folder_of_libraries / "S"))
    keep_learned(data_dir)
    return Library("S", data_dir)
