"""What "no fault" cannot exclude: the size that is heard nine times in ten."""

import numpy as np
import pytest
from scipy import special

from casebase.reasoning.detection_limit import HEARD, smallest_heard


@pytest.mark.parametrize("true_limit", [0.4e-3, 1.0e-3, 2.0e-3])
def test_the_limit_is_where_nine_of_ten_are_heard(true_limit: float) -> None:
    """Sizes drawn evenly in their logarithm, heard by a probit and not by the logistic that is fitted."""
    found = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        sizes = np.exp(rng.uniform(np.log(0.1e-3), np.log(5e-3), 60))
        chance = special.ndtr(special.ndtri(HEARD) + 2.5 * np.log(sizes / true_limit))
        limit = smallest_heard(sizes, rng.random(60) < chance)
        assert limit is not None
        found.append(special.ndtr(special.ndtri(HEARD) + 2.5 * np.log(limit / true_limit)))
    assert np.median(np.array(found)) == pytest.approx(HEARD, abs=0.04)


def test_a_louder_noise_never_lowers_it() -> None:
    rng = np.random.default_rng(3)
    sizes = np.exp(rng.uniform(np.log(0.1e-3), np.log(5e-3), 40))
    heights = 10 + 12 * np.log10(sizes / 0.5e-3) + rng.normal(size=40)
    limits = [smallest_heard(sizes, heights > under) for under in (3.0, 8.0, 13.0)]
    assert None not in limits
    assert limits == sorted(limits, key=float)


def test_what_is_always_or_never_heard() -> None:
    sizes = np.linspace(1e-3, 2e-3, 20)
    assert smallest_heard(sizes, np.ones(20, bool)) == 1e-3
    assert smallest_heard(sizes, np.zeros(20, bool)) is None
    assert smallest_heard(sizes, np.arange(20) == 19) is None
