"""The bank says the truth of its own gearboxes: a fault that grows is heard later, and nothing else grows."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.trend_bank.lives import heard_from, life, sizes
from benchmarks.trend_bank.product import evidence, lived


@pytest.mark.parametrize("label", ["notch", "play"])
def test_strikes_grow_with_the_fault(label: str) -> None:
    small, large = (found.ratio for found in life(label, 3, count=2))
    assert small < 1 < large


def test_where_it_is_heard_follows_from_a_power_law() -> None:
    grown = sizes("notch")
    assert heard_from(grown, (grown / 4e-4) ** 0.6) == pytest.approx(4e-4)


def test_a_good_gearbox_is_made_and_played(tmp_path: Path) -> None:
    found = lived("normal", 5, tmp_path, count=3)
    again = lived("normal", 5, tmp_path, count=3)
    assert not found.size_rad.any()
    assert np.array_equal(found.features, again.features, equal_nan=True)
    assert evidence(found).tolist() == [2.0, 3.0]  # too few to tell anything
