"""Noise becomes white and even: over frequency by a causal filter, over time by its level."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sim.investigation.estimation.whitening import (
    LONG,
    SHORT,
    SMOOTH_BINS,
    Noise,
    floor_filter,
    level_over_time,
    minimum_phase,
    running_median,
)

RATE_HZ = 1000


def test_a_minimum_phase_filter_has_the_gain_that_was_asked_for() -> None:
    frequency = np.linspace(0.0, 1.0, 501)
    power = 1.0 + 4.0 / (1.0 + (frequency / 0.05) ** 2)
    taps = minimum_phase(power, 400)
    gain = np.abs(np.fft.rfft(taps, 1000)) ** 2
    assert np.abs(gain / power - 1.0).max() < 1e-3
    assert taps[0] == np.max(taps)


def test_noise_of_two_colours_becomes_white_over_the_whole_band() -> None:
    rng = np.random.default_rng(1)
    slow = lfilter([0.03], [1.0, -0.97], rng.standard_normal(60 * RATE_HZ))
    noise = slow + 0.02 * rng.standard_normal(slow.size)
    white = np.convolve(noise, floor_filter(noise, np.ones(noise.size), RATE_HZ, 400))[: noise.size]
    power = np.abs(np.fft.rfft(white)) ** 2 / white.size
    hertz = np.fft.rfftfreq(white.size, 1.0 / RATE_HZ)
    for low, high in ((2, 5), (5, 20), (20, 100), (100, 450)):
        assert 0.75 < power[(hertz >= low) & (hertz < high)].mean() < 1.3


def test_noise_that_is_slower_than_a_short_filter_is_white_after_a_long_one() -> None:
    """What shakes a load may do so at half a hertz; the law that acts over strokes must not gain by it."""
    rate = 200
    rng = np.random.default_rng(5)
    left = {memory: [] for memory in (SHORT, LONG)}
    hertz = np.fft.rfftfreq(40 * rate, 1.0 / rate)
    for _ in range(12):
        pole = float(np.exp(-2.0 * np.pi * 0.5 / rate))
        slow = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(42 * rate))[2 * rate :]
        noise = slow + 0.02 * rng.standard_normal(slow.size)
        for memory, powers in left.items():
            sizes = int(memory.block_s * rate), int(memory.filter_s * rate)
            taps = floor_filter(noise, np.ones(noise.size), *sizes, smooth=int(SMOOTH_BINS * memory.block_s))
            powers.append(np.abs(np.fft.rfft(np.convolve(noise, taps)[: noise.size])) ** 2 / noise.size)
    short, long = (np.mean(left[memory], axis=0) for memory in (SHORT, LONG))
    for low, high in ((0.5, 2), (2, 10), (10, 90)):
        assert 0.7 < long[(hertz >= low) & (hertz < high)].mean() < 1.4
    slowest = (hertz >= 0.05) & (hertz < 0.5)
    assert long[slowest].mean() < 2.0
    assert short[slowest].mean() > 3.0 * long[slowest].mean()


def test_a_running_median_keeps_what_is_even_and_drops_a_line() -> None:
    steep = 1.0 / (1.0 + np.arange(200.0) ** 2)
    steep[150] += 3.0
    smooth = running_median(steep, 16)
    assert smooth[150] == pytest.approx(1.0 / (1.0 + 150.0**2), rel=0.05)
    assert running_median(np.ones(50), 4) == pytest.approx(np.ones(50))


def test_a_burst_has_its_level_and_a_rare_spike_has_none() -> None:
    rng = np.random.default_rng(2)
    white = rng.standard_normal(30 * RATE_HZ)
    white[10_000:15_000] *= 4.0
    white[25_000:25_020] += 50.0
    level = level_over_time(white, np.ones(white.size), RATE_HZ)
    assert 3.4 < level[12_500] < 4.6
    assert level[5_000] < 1.2
    assert level[25_010] < 1.2


def test_a_band_in_which_nothing_can_be_known_is_kept_out() -> None:
    noise = np.random.default_rng(3).standard_normal(40 * RATE_HZ)
    heard, deaf = (
        np.abs(np.fft.rfft(floor_filter(noise, np.ones(noise.size), RATE_HZ, 400, deaf=band), RATE_HZ)) ** 2
        for band in (None, np.array([0.010, 0.018]))
    )
    assert (deaf[12:17] < 0.5 * heard[12:17]).all()
    assert deaf[30:] == pytest.approx(heard[30:], rel=0.2)


def test_without_teeth_noise_that_is_loud_while_the_speed_changes_is_noise() -> None:
    """An encoder's steps: lines at even speed, a broad noise while it changes; here a third of the time."""
    rng = np.random.default_rng(4)
    loud = np.arange(60 * RATE_HZ) % 2500 < 900
    noise = rng.standard_normal(loud.size) * np.where(loud, 5.0, 1.0)
    weight = np.where(np.arange(loud.size) % 2500 == 450, 0.0, 1.0)  # the speed passes 0 in the middle of a change
    left = {}
    for teeth in (True, False):
        taps = floor_filter(noise, weight, RATE_HZ, 400, teeth=teeth)
        left[teeth] = float(np.mean(np.convolve(noise, taps)[: noise.size] ** 2))
    assert left[True] > 5.0
    assert 0.6 < left[False] < 0.5 * left[True]


def test_one_noise_whitens_signals_of_any_length() -> None:
    """The next measurement may be shorter than this one: three parts of 8 s of a real axis ended in an error."""
    rng = np.random.default_rng(6)
    taps = minimum_phase(1.0 + 4.0 / (1.0 + (np.linspace(0.0, 1.0, 501) / 0.05) ** 2), 400)
    noise = Noise(taps, np.ones(1))
    for rows in (8000, 5000, 8000):
        values = rng.standard_normal(rows)
        mirrored = np.concatenate([values[taps.size - 1 : 0 : -1], values])
        expected = lfilter(taps, [1.0], mirrored)[taps.size - 1 :]
        assert noise.whiten(values, np.zeros(0)) == pytest.approx(expected, abs=1e-9)


def test_noise_that_is_also_wrong_as_a_whole_is_white_again() -> None:
    """Whitened, w + u g has covariance I; the log of its volume is that of I + g g^T."""
    rng = np.random.default_rng(5)
    unsure = rng.standard_normal((400, 3)) * [0.2, 1.0, 0.05]
    noise = Noise.flat(0.5, 1.0).with_inflated_prior(unsure)
    whole = 0.25 * np.eye(400) + unsure @ unsure.T
    white = np.stack([noise.whiten(column, np.zeros(0)) for column in np.linalg.cholesky(whole).T], axis=1)
    assert white @ white.T == pytest.approx(np.eye(400), abs=1e-3)
    assert noise.log_scale(400, 0) == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-3)
