"""Two models compared under noise of their own: what noise makes of it, and what takes no part in it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from sim.chain.model import Array
from sim.investigation.search.own_noise import likelihood_in_band, share_in_band

ROWS, RATE_HZ = 20_000, 500.0


def of(left: Array, penalty: float = 0.0) -> tuple[Any, Any]:
    """A model that leaves `left` of the torque, without an encoder at the load."""
    m = SimpleNamespace(rate_hz=RATE_HZ, load_stride=1, samples=ROWS)
    problem = SimpleNamespace(measurement=m, raw_residuals=lambda terms, values: (left, np.zeros(0)))
    return cast(Any, problem), cast(Any, SimpleNamespace(terms=(), values={}, prior_penalty=penalty))


def gained(less: Array, more: Array) -> float:
    """Twice the log likelihood of what one model leaves over that of another."""
    every = (np.ones(ROWS), np.ones(ROWS))
    return 2.0 * (likelihood_in_band(*of(more), every) - likelihood_in_band(*of(less), every))


def coloured(seed: int) -> Array:
    """Noise whose spectrum falls over frequency, as what is left of a model does."""
    white = np.random.default_rng(seed).standard_normal(ROWS)
    return np.asarray(lfilter([1.0], [1.0, -0.9], white), dtype=np.float64)


def test_what_a_wave_that_is_not_there_gains_is_chi_square() -> None:
    """Of two free amplitudes, fitted by least squares in each of 200 records of coloured noise: mean 2, and no tail."""
    turn = 2.0 * np.pi * 7.03 * np.arange(ROWS) / RATE_HZ
    waves = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    told = []
    for seed in range(200):
        left = coloured(seed)
        amplitudes = np.linalg.lstsq(waves, left, rcond=None)[0]
        told.append(gained(left, left - waves @ amplitudes))
    assert np.mean(told) == pytest.approx(2.0, abs=0.5)
    assert np.max(told) < chi2.isf(1e-5, 2)


def test_a_wave_that_is_there_gains_what_its_band_says() -> None:
    """In a band of n lines that it made r times as loud: n times the logarithm of r on either side."""
    left, turn = coloured(3), 2.0 * np.pi * 7.0 * np.arange(ROWS) / RATE_HZ
    weak, strong = (gained(left + size * np.sin(turn), left) for size in (1.0, 4.0))
    assert 20.0 < weak < strong
    assert strong - weak < 2.0 * 40.0 * np.log(100.0)


def test_the_scale_of_the_noise_is_no_gain_of_either() -> None:
    left = coloured(5)
    both = gained(left, 0.5 * left)
    again = gained(3.0 * left, 1.5 * left)
    assert both == pytest.approx(again, rel=1e-9)


def test_what_lies_above_the_band_of_the_motion_is_no_part_of_it() -> None:
    turn = 2.0 * np.pi * np.arange(ROWS) / RATE_HZ
    problem, _ = of(np.zeros(ROWS))
    assert share_in_band(problem, np.sin(3.0 * turn)) > 0.99
    assert share_in_band(problem, np.sin(120.0 * turn)) < 0.01
    left = coloured(7)
    assert abs(gained(left + 5.0 * np.sin(120.0 * turn), left)) < 1.0
