"""A recording keeps its samples, tells its length and hash, and changes its rate without changing its sound."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signals.errors import BrokenAudioError
from signals.recording import Recording


def tone(frequency_hz: float, rate_hz: float, duration_s: float = 1.0) -> Recording:
    time = np.arange(int(duration_s * rate_hz)) / rate_hz
    return Recording((0.5 * np.sin(2 * np.pi * frequency_hz * time)).astype(np.float32), rate_hz)


@settings(deadline=None, max_examples=25)
@given(
    frequency_hz=st.floats(50, 3000),
    rate_hz=st.sampled_from([8000.0, 11025.0, 16000.0, 44100.0, 47999.0, 96000.0, 192000.0]),
)
def test_a_tone_stays_the_same_tone_at_another_rate(frequency_hz: float, rate_hz: float) -> None:
    there = tone(frequency_hz, rate_hz).resampled(8000.0)
    expected = tone(frequency_hz, 8000.0)
    assert there.sample_rate_hz == 8000.0
    inside = slice(400, min(there.samples.size, 8000) - 400)
    np.testing.assert_allclose(there.samples[inside], expected.samples[inside], atol=2e-3)
    assert there.duration_s == pytest.approx(tone(frequency_hz, rate_hz).duration_s, abs=1 / 8000)


@settings(deadline=None, max_examples=25)
@given(
    rate_hz=st.sampled_from([2000.0, 5120.0, 12345.6, 16000.0, 44100.0, 47999.0, 96000.0]),
    frequency_hz=st.floats(0.1, 40),
    phase=st.floats(0, 6.3),
)
def test_resampling_makes_no_impulse_at_the_edges(rate_hz: float, frequency_hz: float, phase: float) -> None:
    """A smooth signal on a large offset, so at full level when the recording starts."""
    time = np.arange(int(0.5 * rate_hz)) / rate_hz
    samples = (0.7 + 0.2 * np.cos(2 * np.pi * frequency_hz * time + phase)).astype(np.float32)
    there = Recording(samples, rate_hz).resampled(8000.0).samples
    exact = 0.7 + 0.2 * np.cos(2 * np.pi * frequency_hz * np.arange(there.size) / 8000 + phase)
    step = 2 * np.pi * frequency_hz * 0.2 / min(rate_hz, 8000.0)
    assert np.abs(there - exact).max() < 0.002 + step


def test_the_hash_follows_samples_and_rate_alone() -> None:
    samples = np.linspace(-1, 1, 100, dtype=np.float32)
    first = Recording(samples, 8000.0)
    assert first.sha256 == Recording(samples.copy(), 8000.0, channel=2, channels=4).sha256
    assert first.sha256 != Recording(samples, 8001.0).sha256
    changed = samples.copy()
    changed[50] += np.float32(1e-6)
    assert first.sha256 != Recording(changed, 8000.0).sha256
    assert len(first.sha256) == 64


@pytest.mark.parametrize(
    ("samples", "rate_hz", "words"),
    [
        (np.zeros(0), 8000.0, "shape"),
        (np.zeros((2, 3)), 8000.0, "shape"),
        (np.array([0.0, np.nan]), 8000.0, "1 of 2"),
        (np.array([0.0, 1e20]), 8000.0, "1 of 2"),
        (np.zeros(9), 0.0, "positive"),
        (np.zeros(9), np.nan, "positive"),
    ],
)
def test_what_is_no_recording_is_refused(samples: np.ndarray, rate_hz: float, words: str) -> None:
    with pytest.raises(BrokenAudioError, match=words):
        Recording(samples.astype(np.float32), rate_hz)


def test_samples_cannot_be_changed_behind_the_hash() -> None:
    recording = tone(100.0, 8000.0)
    with pytest.raises(ValueError, match="read-only"):
        recording.samples[0] = 1.0
