"""What is drawn shows what is there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.recordings import views
from signals.recording import Recording

RATE_HZ = 8000.0


@given(count=st.integers(2, 5000), points=st.integers(1, 300), place=st.floats(0, 1))
def test_no_impulse_is_lost_in_the_waveform(count: int, points: int, place: float) -> None:
    samples = np.zeros(count, dtype=np.float32)
    where = min(count - 1, int(place * count))
    samples[where] = 1
    view = views.waveform(Recording(samples, RATE_HZ), points)
    assert len(view.time_s) <= points
    assert max(view.high) == 1
    start = view.time_s[int(np.argmax(view.high))]
    assert start <= where / RATE_HZ < start + view.interval_s * (1 + 1e-9)


def test_the_spectrum_of_silence_is_finite() -> None:
    silent = views.spectrum(Recording(np.zeros(999, dtype=np.float32), RATE_HZ), 2.0)
    assert np.isfinite(silent.level_db).all()


@pytest.mark.parametrize("duration_s", [0.1, 1.0, 60.0])
def test_a_knock_is_seen_in_the_spectrogram_at_any_length(duration_s: float) -> None:
    samples = np.random.default_rng(0).normal(0, 1e-3, int(duration_s * RATE_HZ)).astype(np.float32)
    samples[samples.size // 3] += 1
    view = views.spectrogram(Recording(samples, RATE_HZ), columns=500)
    level_db = np.array(view.level_db)
    assert level_db.shape == (len(view.frequency_hz), len(view.time_s))
    assert len(view.time_s) <= 500
    loudest = view.time_s[level_db.mean(axis=0).argmax()]
    assert loudest == pytest.approx(duration_s / 3, abs=max(0.07, duration_s / 250))


def test_the_crest_factors_show_when_the_knock_was() -> None:
    samples = np.random.default_rng(3).normal(0, 0.01, 80000)
    samples[50000:50080] += np.hanning(80)
    view = views.crest(Recording(samples.astype(np.float32), RATE_HZ), 0.5, 0)
    factors = np.array(view.crest_factor, dtype=float)
    assert abs(view.time_s[int(factors.argmax())] - 50040 / RATE_HZ) <= 0.25
    np.testing.assert_allclose(factors, np.array(view.peak) / view.whole_rms)
    assert view.whole_record == factors.max()


def test_silence_has_no_crest_factor() -> None:
    view = views.crest(Recording(np.zeros(2000, dtype=np.float32), RATE_HZ))
    assert (view.whole_record, view.mean, view.crest_factor) == (None, None, [None] * 3)
