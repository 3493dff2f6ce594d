"""A number that notes what it decides is the number, and says so only where another would have chosen otherwise."""

import math
import pickle
from typing import Any

import numpy as np
import pytest

from tests.tuned_numbers.deciding import Ledger, Use, deciding


def made(value: float) -> tuple[Any, Ledger]:
    ledger = Ledger()
    return deciding("x", value, ledger), ledger


@pytest.mark.parametrize("other", [1.0, 1.9, 2.1, 3.9, 4.1, 7.9, 8.1])
def test_it_decides_where_twice_or_half_of_it_would_choose_otherwise(other: float) -> None:
    x, ledger = made(2.0)
    assert (x + x < other) == (other > 4.0)
    assert ledger.of("x") == Use(compared=1, decided=2.0 < other < 8.0)


def test_what_is_made_of_it_stays_the_same_number() -> None:
    x, _ = made(3)
    assert [*range(x)] == [0, 1, 2]
    assert 7 - x == 4
    assert x / 2 == 1.5
    assert -x == -3
    assert math.sqrt(x + 1) == 2.0
    assert {3: "three"}[x] == "three"
    assert pickle.loads(pickle.dumps(x)) == 3


def test_rows_of_an_array_are_one_comparison() -> None:
    x, ledger = made(1.0)
    rows = np.array([0.1, 0.4, 3.0])
    assert (rows > x).tolist() == [False, False, True]
    assert not ledger.of("x").decided
    assert (rows > 2.0 * x).tolist() == [False, False, True]
    assert ledger.of("x").decided == 1
    assert (rows * x).tolist() == rows.tolist()
    assert ledger.of("x").scaled == 1


def test_numbers_of_numpy_pass_it_on() -> None:
    x, ledger = made(1.0)
    assert np.float64(0.25) * x < 0.3
    assert ledger.of("x").decided == 1


def test_two_numbers_are_told_apart() -> None:
    ledger = Ledger()
    one, two = deciding("one", 1.0, ledger), deciding("two", 100.0, ledger)
    assert one + 10.0 < two
    assert not ledger.of("one").decided
    assert not ledger.of("two").decided
    assert one + 60.0 < two
    assert not ledger.of("one").decided
    assert ledger.of("two").decided == 1
