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
