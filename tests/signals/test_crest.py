"""Crest factor, the paper's low-pass and kurtosis against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from signals import crest
from signals.spectra import long_spectrum, low_pass

RATE_HZ = 8000.0


def time_s(duration_s: float) -> np.ndarray:
    return np.arange(int(duration_s * RATE_HZ)) / RATE_HZ


def filtered(samples: np.ndarray, cutoff_hz: float = 200.0) -> np.ndarray:
    return low_pass(long_spectrum(samples.astype(np.float32), RATE_HZ), cutoff_hz)


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        (np.sin(2 * np.pi * 50 * time_s(1)), np.sqrt(2)),
        (np.sign(np.sin(2 * np.pi * 50 * time_s(1) + 0.01)), 1.0),
        (signal.sawtooth(2 * np.pi * 50 * time_s(10), 0.5), np.sqrt(3)),
        (np.eye(1, 400)[0], 20.0),
    ],
    ids=["sine", "square", "triangle", "one impulse in 400 samples"],
)
def test_crest_factor_of_known_waves(samples: np.ndarray, expected: float) -> None:
    assert crest.crest_factor(samples.astype(np.float32)) == pytest.approx(expected, rel=2e-3)


@given(gain=st.floats(1e-6, 1e6), seed=st.integers(0, 99))
def test_crest_factor_and_kurtosis_do_not_follow_the_gain(gain: float, seed: int) -> None:
    samples = np.random.default_rng(seed).normal(size=999).astype(np.float32)
    louder = samples * np.float32(gain)
    assert crest.crest_factor(louder) == pytest.approx(crest.crest_factor(samples), rel=1e-4)
    assert crest.kurtosis(louder) == pytest.approx(crest.kurtosis(samples), rel=1e-3)


def test_windows_hold_what_their_slice_holds() -> None:
    samples = np.random.default_rng(0).normal(size=5000).astype(np.float32)
    trace = crest.crest_factor_trace(samples, 800, 300)
    assert trace.size == 1 + (5000 - 800) // 300
    for k in range(trace.size):
        expected = crest.crest_factor(samples[300 * k : 300 * k + 800])
        assert trace[k] == pytest.approx(expected, rel=1e-5)


def test_the_trace_of_a_sine_is_the_root_of_two_where_a_window_holds_its_peak() -> None:
    sine = 3 + 0.5 * np.sin(2 * np.pi * 50 * time_s(10))
    trace = crest.crest_trace(sine, RATE_HZ)
    assert trace.values == pytest.approx(np.full(100, np.sqrt(2)), rel=0.012)  # it has a kink where it is mirrored
    assert trace.values[1:-1] == pytest.approx(np.full(98, np.sqrt(2)), rel=1e-3)
    assert (trace.largest, trace.mean) == pytest.approx((np.sqrt(2), np.sqrt(2)), rel=0.012)
    assert (trace.middle_s[0], trace.middle_s[-1]) == pytest.approx((0.05, 9.95))
    assert trace.rms == pytest.approx(np.full(100, trace.whole_rms), rel=5e-3)


def test_what_lies_above_the_low_pass_is_not_in_the_trace() -> None:
    low, high = np.sin(2 * np.pi * 50 * time_s(4)), np.sin(2 * np.pi * 1000 * time_s(4))
    assert crest.crest_trace(low + high, RATE_HZ).whole_rms == pytest.approx(np.sqrt(0.5), rel=1e-3)
    for none in (None, 0):
        assert crest.crest_trace(low + high, RATE_HZ, low_pass_hz=none).whole_rms == pytest.approx(1, rel=1e-3)


@given(size=st.integers(1, 3000), window_s=st.floats(0.001, 1.0), seed=st.integers(0, 9))
def test_the_largest_of_the_trace_is_the_crest_factor_of_the_record(size: int, window_s: float, seed: int) -> None:
    """Of any window, the last one included, though it is shorter."""
    samples = np.random.default_rng(seed).standard_t(3, size + 1)
    trace = crest.crest_trace(samples, RATE_HZ, window_s, None)
    whole = crest.crest_factor((samples - samples.mean()).astype(np.float32))
    assert trace.largest == pytest.approx(whole, rel=1e-5)
    assert trace.mean <= trace.largest
    n = min(size + 1, max(1, round(window_s * RATE_HZ)))
    if (size + 1) % n == 0:
        assert trace.mean <= np.sqrt(n) * (1 + 1e-6)


def test_one_impulse_below_200_hz_reaches_the_root_of_two_b_t() -> None:
    """The Butterworth's band is a little wider than its cutoff."""
    impulse = np.zeros(80_000)
    impulse[40_000] = 1
    trace = crest.crest_trace(impulse, RATE_HZ)
    assert trace.largest == pytest.approx(np.sqrt(2 * 200 * 10), rel=0.1)
    assert trace.mean < np.sqrt(2 * 200 * 0.1)


def test_low_pass_has_the_gain_of_its_formula() -> None:
    time = time_s(4)
    for frequency in (20, 100, 200, 300, 400):
        passed = filtered(np.cos(2 * np.pi * frequency * time))[8000:-8000]
        gain = np.sqrt(2 * np.mean(passed**2))
        assert gain == pytest.approx(1 / (1 + (frequency / 200) ** 8), abs=2e-3)


@settings(deadline=None, max_examples=60)
@given(frequency=st.floats(0.5, 60), phase=st.floats(0, 2 * np.pi), duration=st.floats(0.3, 2.0))
def test_filter_edges_are_no_impulses(frequency: float, phase: float, duration: float) -> None:
    """A smooth signal that starts or ends at full level must come out as smooth."""
    time = time_s(duration)
    smooth = np.sin(2 * np.pi * frequency * time + phase)
    passed = filtered(smooth)
    edges = np.r_[0:400, passed.size - 400 : passed.size]
    assert np.abs(passed[edges]).max() <= 1.02
    assert np.abs(passed - smooth)[edges].max() < 0.2


def test_filter_edges_of_noise_are_no_impulses() -> None:
    """Continuing noise point-symmetrically adds a step of twice its first sample; mirroring must not."""
    for seed in range(20):
        samples = np.random.default_rng(seed).normal(size=8000)
        passed = filtered(samples, 50.0)
        assert np.abs(passed[:200]).max() < 2.5 * np.abs(passed[800:-800]).max()
