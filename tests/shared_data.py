"""Where measured data for tests lies; tests that need it are skipped where it is absent."""

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("GEARCASE_SHARED", Path(__file__).resolve().parents[2] / "shared"))


def shared(*parts: str) -> Path:
    """Return the path of measured data, or skip the calling test with the reason.

    >>> shared("data", "axis_recordings", "manifest.csv")  # doctest: +SKIP
    """
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"measured data not here: {'/'.join(parts)} (set GEARCASE_SHARED to the folder that holds it)")
    return path
