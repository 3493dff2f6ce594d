"""What a term promises before it is fitted."""

from __future__ import annotations

import numpy as np
import pytest

from sim.investigation.search.score_test import keeps_on

RATE_HZ, HUM_HZ = 1000.0, 50.0
TIME = np.arange(24000) / RATE_HZ
SPEED = np.abs(np.sin(2.0 * np.pi * TIME / 3.0)) ** np.linspace(0.5, 2.0, TIME.size)


@pytest.mark.parametrize("seed", range(5))
def test_hum_keeps_on_whatever_the_axis_does_and_a_shaking_does_not(seed: int) -> None:
    """The same sine of 50 Hz all along, and only while the axis is fast, both a fifth of the noise."""
    noise = np.random.default_rng(seed).standard_normal(TIME.size)
    sine = 0.2 * np.sin(2.0 * np.pi * HUM_HZ * TIME + seed)
    assert keeps_on(noise + sine, RATE_HZ, HUM_HZ, SPEED)
    assert not keeps_on(noise + np.where(SPEED > 0.8, sine, 0.0), RATE_HZ, HUM_HZ, SPEED)
    assert not keeps_on(noise + np.where(SPEED < 0.2, sine, 0.0), RATE_HZ, HUM_HZ, SPEED)


def test_rows_that_do_not_count_are_of_no_speed() -> None:
    """At rest, where the torque is not known, the residual is nothing: hum in motion is hum all the same."""
    rests = SPEED < 0.6
    sine = np.where(rests, 0.0, np.sin(2.0 * np.pi * HUM_HZ * TIME))
    assert keeps_on(sine, RATE_HZ, HUM_HZ, np.where(rests, np.nan, SPEED))
    assert not keeps_on(sine, RATE_HZ, HUM_HZ, SPEED)
