"""What is drawn shows what is there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casebase.signals import views
from casebase.signals.recording import Recording

RATE_HZ = 8000.0


@given(count=st.integers(1, 5000), points=st.integers(1, 300), place=st.floats(0, 1))
def test_no_impulse_is_lost_in_the_waveform(count: int, points: int, place: float) -> None:
    samples = np.zeros(count, dtype=np.float32)
    where = min(count - 1, int(place * count))
    samples[where] = 1
    view = views.waveform(Recording(samples, RATE_HZ), points)
    assert view.time_s.size == min(points, count)
    assert view.highest.max() == 1
    assert abs(view.time_s[view.highest.argmax()] - where / RATE_HZ) <= count / points / RATE_HZ


def test_a_piece_of_the_waveform_is_that_piece() -> None:
    samples = np.random.default_rng(0).normal(size=8000).astype(np.float32)
    view = views.waveform(Recording(samples, RATE_HZ), 100, 0.25, 0.5)
    assert 0.25 <= view.time_s[0] < view.time_s[-1] < 0.5
    assert view.lowest.min() == samples[2000:4000].min()
    assert views.waveform(Recording(samples, RATE_HZ), 100, 2.0, 3.0).time_s.size == 0


def test_the_spectrum_of_a_tone_is_one_line_with_its_power() -> None:
    time = np.arange(80000) / RATE_HZ
    view = views.spectrum(Recording((0.5 * np.sin(2 * np.pi * 440 * time)).astype(np.float32), RATE_HZ))
    assert view.frequency_hz[view.level_db.argmax()] == 440
    power = np.sum(10 ** (view.level_db / 10)) * (view.frequency_hz[1] - view.frequency_hz[0])
    assert power == pytest.approx(0.5**2 / 2, rel=1e-3)
    silent = views.spectrum(Recording(np.zeros(999, dtype=np.float32), RATE_HZ))
    assert np.isfinite(silent.level_db).all()


@pytest.mark.parametrize("duration_s", [0.05, 1.0, 60.0])
def test_a_knock_is_seen_in_the_spectrogram_at_any_length(duration_s: float) -> None:
    samples = np.random.default_rng(0).normal(0, 1e-3, int(duration_s * RATE_HZ)).astype(np.float32)
    samples[samples.size // 3] += 1
    view = views.spectrogram(Recording(samples, RATE_HZ), columns=500, highest_hz=3000)
    assert view.level_db.shape == (view.frequency_hz.size, view.time_s.size)
    assert view.time_s.size <= 500
    assert view.frequency_hz[-1] <= 3000
    loudest = view.time_s[view.level_db.mean(axis=0).argmax()]
    assert loudest == pytest.approx(duration_s / 3, abs=max(0.07, duration_s / 500))
