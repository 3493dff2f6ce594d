"""Neither the origin nor the digits of a clock are measured."""

import numpy as np
import pytest

from signals.columns.clock import stamps_from_zero

ROWS = np.delete(np.arange(3000), [5, 700, 701])


@pytest.mark.parametrize("origin_s", [0.0, 3.001, 1764165785.0, -7200.0])
@pytest.mark.parametrize(
    ("interval_s", "digits"), [(0.005, 3), (0.005, 6), (1.0 / 300.0, 3), (1.0 / 3.0, 12), (1e-4, 5)]
)
def test_rows_of_an_even_clock_are_even_whatever_its_stamps(origin_s: float, interval_s: float, digits: int) -> None:
    found = stamps_from_zero(np.round(origin_s + interval_s * ROWS, digits))
    np.testing.assert_allclose(found, interval_s * ROWS, atol=10.0**-digits)
    np.testing.assert_allclose(np.diff(found) / found[1], np.diff(ROWS), rtol=1e-9)


def test_two_clocks_of_one_record_are_the_same() -> None:
    zero, epoch = (stamps_from_zero(np.round(origin_s + 0.005 * ROWS, 6)) for origin_s in (0.0, 1764165785.0))
    np.testing.assert_array_equal(zero, epoch)


def test_a_clock_that_is_not_even_stays_as_it_is() -> None:
    rng = np.random.default_rng(1)
    for time_s in (np.cumsum(rng.uniform(0.009, 0.011, 1000)), np.cumsum(rng.choice([0.01, 0.012], 1000))):
        np.testing.assert_array_equal(stamps_from_zero(time_s), time_s - time_s[0])
