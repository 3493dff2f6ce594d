"""What is left out of a recording is quiet that is no reversal, wherever it lies and however quiet it is."""

import numpy as np
import pytest

from signals.features import extract
from signals.motion import HOP_HZ
from signals.recording import Recording
from signals.segments import LIMITS, Segments, find_segments
from tests.signals.synthetic import RATE_HZ, Joint, sound

STROKE_S, BRAKING_S, DURATION_S = 3.0, 0.2, 20.0
FALL_DB = 15.0
WITHIN_S = 0.1
"""The smoothing of the loudness, by which an end of silence may be missed."""


def loudness(*, first_s: float = 1.5, duration_s: float = DURATION_S, seed: int = 0) -> np.ndarray:
    """Return the level of an axis that reverses every 3 s, shape (n,) [dB]: 0 on the way, -15 at standstill."""
    time = np.arange(round(duration_s * HOP_HZ)) / HOP_HZ
    away = np.abs((time - first_s + STROKE_S / 2) % STROKE_S - STROKE_S / 2)
    level = np.where(away < BRAKING_S, -FALL_DB, 0.0)
    return level + 0.5 * np.random.default_rng(seed).normal(size=time.size)


def quiet(seconds: float, level_db: float, seed: int = 1) -> np.ndarray:
    return level_db + 0.5 * np.random.default_rng(seed).normal(size=round(seconds * HOP_HZ))


def divided(*parts: np.ndarray) -> Segments:
    return find_segments(np.concatenate(parts).astype(np.float32))


@pytest.mark.parametrize("seed", range(5))
def test_noise_without_quiet_is_left_whole(seed: int) -> None:
    segments = divided(np.random.default_rng(seed).normal(0, 1.5, 4000))
    assert segments.machine.duration_s == DURATION_S
    assert segments.silences == ()


@pytest.mark.parametrize("level_db", [-200.0, -60.0, -30.0, -15.0])
@pytest.mark.parametrize("seconds", [1.0, 3.0, 15.0, 60.0])
def test_silence_before_and_after_leaves_the_same_piece(seconds: float, level_db: float) -> None:
    """At any level from that of the standstill down, and any length."""
    segments = divided(quiet(seconds, level_db), loudness())
    assert segments.machine.start_s == pytest.approx(seconds + LIMITS.margin_s, abs=WITHIN_S)
    assert segments.machine.end_s == seconds + DURATION_S
    (silence,) = segments.silences
    assert silence.start_s == 0.0
    assert silence.end_s == pytest.approx(seconds, abs=WITHIN_S)
    assert segments.pauses == segments.others == ()
    segments = divided(loudness(), quiet(seconds, level_db))
    assert segments.machine.start_s == 0.0
    assert segments.machine.end_s == pytest.approx(DURATION_S - LIMITS.margin_s, abs=WITHIN_S)
    assert [each.end_s for each in segments.silences] == [DURATION_S + seconds]


def test_silence_on_both_sides_and_a_recording_twice_as_loud() -> None:
    for gain_db in (-40.0, 0.0, 30.0):
        segments = divided(quiet(2, -50) + gain_db, loudness() + gain_db, quiet(4, -50) + gain_db)
        assert segments.machine.start_s == pytest.approx(2 + LIMITS.margin_s, abs=WITHIN_S)
        assert segments.machine.end_s == pytest.approx(2 + DURATION_S - LIMITS.margin_s, abs=WITHIN_S)
        assert len(segments.silences) == 2


@pytest.mark.parametrize("seconds", [3.0, 20.0])
@pytest.mark.parametrize("level_db", [-FALL_DB, -50.0])
def test_a_pause_divides_and_the_longer_piece_is_analysed(seconds: float, level_db: float) -> None:
    """Two strokes, a pause, and five strokes; and the other way round."""
    short, long = loudness(duration_s=6.0), loudness(duration_s=15.0)
    first = divided(short, quiet(seconds, level_db), long)
    assert first.machine.start_s == pytest.approx(6.0 + seconds + LIMITS.margin_s, abs=WITHIN_S)
    second = divided(long, quiet(seconds, level_db), short)
    assert second.machine.end_s == pytest.approx(15.0 - LIMITS.margin_s, abs=WITHIN_S)
    for segments, start_s, left_s in ((first, 6.0, 6.0), (second, 15.0, 6.0)):
        (pause,), (other,) = segments.pauses, segments.others
        assert pause.start_s == pytest.approx(start_s, abs=WITHIN_S)
        assert pause.duration_s == pytest.approx(seconds, abs=2 * WITHIN_S)
        assert other.duration_s == pytest.approx(left_s, abs=WITHIN_S)


@pytest.mark.parametrize("still_s", [0.3, 0.8, 1.2])
def test_standstills_that_all_last_as_long_are_no_pauses(still_s: float) -> None:
    time = np.arange(round(30 * HOP_HZ)) / HOP_HZ
    level = np.where((time + 1.0) % 4.0 < still_s, -15.0, 0.0) + 0.3 * np.random.default_rng(3).normal(size=time.size)
    assert divided(level).pauses == ()


@pytest.mark.parametrize("label", ["normal", "notch", "play"])
@pytest.mark.parametrize("seconds", [1.0, 4.0])
@pytest.mark.parametrize("level", [0.0, 1e-4, 1e-3])
def test_silence_shifts_events_and_reversals_by_its_length(label: str, seconds: float, level: float) -> None:
    samples = sound(Joint(label, seed=5))
    still = (level * np.random.default_rng(6).normal(size=round(seconds * RATE_HZ))).astype(np.float32)
    plain, late = (extract(Recording(each, RATE_HZ)) for each in (samples, np.concatenate([still, samples])))
    assert late.motion.period_s == pytest.approx(plain.motion.period_s, rel=0.01)
    assert late.motion.reversal_times_s == pytest.approx(
        [time + seconds for time in plain.motion.reversal_times_s], abs=0.02
    )
    found = {(event.kind, round(event.time_s - seconds, 1)) for event in late.events if event.time_s > seconds + 0.2}
    expected = {(event.kind, round(event.time_s, 1)) for event in plain.events if event.time_s > 0.2}
    assert len(found & expected) >= 0.8 * len(expected)
    assert [flag.name for flag in late.quality if flag.name != "silence"] == [flag.name for flag in plain.quality]
