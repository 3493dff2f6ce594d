"""Errors that the command line turns into a sentence."""

from pathlib import Path

import pytest

from app.commands.faults import sentence


def test_a_missing_file_is_named_without_numbers_of_the_system(tmp_path: Path) -> None:
    path = tmp_path / "telemetry.csv"
    with pytest.raises(FileNotFoundError) as missing:
        path.read_bytes()
    assert sentence(missing.value) == f"{path}: no such file"
