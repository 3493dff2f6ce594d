"""The paper's recordings: when the notch is met, and what a crest factor can be."""

import math

import numpy as np
import pytest

from benchmarks.paper_recordings import NOTCH_S, REVOLUTION_S, WINDOW_S, CrestTrace, scenario


def test_the_notch_is_met_once_a_turn_in_one_direction_as_in_figure_6() -> None:
    trace = CrestTrace.of(scenario("notch", 0).perform())
    first, second = sorted(np.argsort(trace.values)[-2:] * WINDOW_S)
    assert first == pytest.approx(NOTCH_S, abs=WINDOW_S)
    assert second == pytest.approx(NOTCH_S + REVOLUTION_S, abs=WINDOW_S)


def test_an_impulse_in_silence_has_the_largest_crest_factor_that_the_band_allows() -> None:
    """The root of 2 B T independent values; the Butterworth's band is a little wider than its cutoff."""
    seconds, rate = 10.0, 8000.0
    impulse = np.zeros(round(seconds * rate))
    impulse[impulse.size // 2] = 1.0
    trace = CrestTrace.of(impulse, rate)
    assert trace.crest_factor == pytest.approx(math.sqrt(2 * 200.0 * seconds), rel=0.1)
    steady = CrestTrace.of(np.cos(2 * math.pi * 50.0 * np.arange(80_000) / rate), rate)
    assert steady.crest_factor == pytest.approx(math.sqrt(2), rel=0.01)
    assert steady.over_mean == pytest.approx(1.0, rel=0.01)
    assert steady.per(1.0) == pytest.approx(math.sqrt(2), rel=0.01)
