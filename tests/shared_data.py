"""Tests that need measured data are skipped where it is absent."""

from pathlib import Path

import pytest

from benchmarks.shared_data import SHARED


def shared(*parts: str) -> Path:
    """Return the path of measured data, or skip the calling test with the reason.

    >>> shared("data", "axis_recordings", "manifest.csv")  # doctest: +SKIP
    """
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"measured data not here: {'/'.join(parts)} (set GEARCASE_SHARED to the folder that holds it)")
    return path
