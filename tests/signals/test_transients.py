"""What a cycle has alone is an event of the surroundings; what every cycle has never is."""

import numpy as np
import pytest

from signals.analysis import Analysis
from signals.band import Band
from signals.condition import UNKNOWN
from signals.features import extract
from signals.recording import Recording
from signals.recording_quality.disturbances import survey
from signals.transients import Unrepeated
from tests.signals.synthetic import RATE_HZ, Joint, sound

LABELS = ("normal", "notch", "play")
STROKE_S = Joint().stroke_s


def knock(height: float, frequency_hz: float = 70.0, decay_s: float = 0.03) -> np.ndarray:
    """Return a blow of this height over the effective value of a sound of 0.1."""
    time = np.arange(round(0.3 * RATE_HZ)) / RATE_HZ
    return 0.1 * height * np.sin(2 * np.pi * frequency_hz * time) * np.exp(-time / decay_s)


def knocked(joint: Joint, times_s: tuple[float, ...], height: float = 10.0, frequency_hz: float = 70.0) -> np.ndarray:
    samples = sound(joint).astype(np.float64)
    for time_s in times_s:
        start = round(time_s * RATE_HZ)
        samples[start : start + round(0.3 * RATE_HZ)] += knock(height, frequency_hz)[: samples.size - start]
    return samples.astype(np.float32)


def of(samples: np.ndarray) -> Unrepeated:
    found = Analysis(Recording(samples.astype(np.float32), RATE_HZ), UNKNOWN).unrepeated
    assert found is not None
    return found


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("seed", range(4))
def test_what_repeats_is_no_event(label: str, seed: int) -> None:
    """Away from the ends, where a trace is half of its own mirror image."""
    found = of(sound(Joint(label, seed=seed, duration_s=25.0)))
    assert [each for each in found.events if 0.1 < each.span.start_s < 24.8] == []
    assert max(found.share.values()) < 0.05


@pytest.mark.parametrize("height", [10.0, 40.0])
@pytest.mark.parametrize("frequency_hz", [70.0, 600.0, 2000.0])
@pytest.mark.parametrize("time_s", [3.3, 8.05, 11.9])
def test_a_knock_in_one_cycle_is_one_event_with_its_time(time_s: float, frequency_hz: float, height: float) -> None:
    found = of(knocked(Joint(seed=3, duration_s=25.0), (time_s,), height, frequency_hz))
    event = max(found.events, key=lambda each: max(each.excess_db.values()))
    assert event.knock
    assert event.span.start_s - 0.05 < time_s < event.span.start_s + 0.25
    assert event.span.end_s < time_s + 0.4
    if height < 40:
        assert [each for each in found.events if each.knock and each.span.start_s < 24.8] == [event]
    band = next(band for band in Band if band.value[0] <= frequency_hz < band.value[1])
    assert max(event.excess_db, key=lambda each: event.excess_db[each]) is band


@pytest.mark.parametrize("every", [1, 2])
def test_a_knock_in_every_stroke_or_in_every_cycle_is_none(every: int) -> None:
    joint = Joint(seed=4, duration_s=25.0)
    times = tuple(float(time) + 1.2 for time in joint.reversals_s[1:-3:every])
    assert [each for each in of(knocked(joint, times)).events if each.knock and each.span.start_s < 24.8] == []


def struck_at_some_reversals(strokes: dict[int, float], height: float = 8.0, extra_s: float = 0.25) -> Unrepeated:
    """Return what does not repeat where some reversals have a knock soon after them, so many times as high."""
    joint = Joint(seed=12, duration_s=30.0)
    samples = sound(joint).astype(np.float64)
    for stroke, factor in strokes.items():
        start = round((float(joint.reversals_s[stroke]) + extra_s) * RATE_HZ)
        samples[start : start + round(0.3 * RATE_HZ)] += knock(height * factor)
    return of(samples)


def test_a_knock_at_some_reversals_is_the_machines() -> None:
    """Play is crossed from wherever the gear came to rest in it: not in every cycle, and not as hard each time."""
    found = struck_at_some_reversals({1: 1.0, 2: 0.9, 5: 1.3, 8: 1.1})
    assert [each for each in found.events if each.knock and each.span.start_s < 29.8] == []


def test_as_many_knocks_at_no_time_of_the_motion_are_not() -> None:
    joint = Joint(seed=12, duration_s=30.0)
    times = tuple(float(joint.reversals_s[stroke]) + 0.25 + 0.5 * place for place, stroke in enumerate((1, 2, 5, 8)))
    events = [each for each in of(knocked(joint, times, 8.0)).events if each.knock and each.span.start_s < 29.8]
    assert [each.span.start_s for each in events] == pytest.approx(list(times), abs=0.12)


def test_a_blow_far_harder_than_the_others_at_its_time_is_not_theirs() -> None:
    blow_s = float(Joint(seed=12, duration_s=30.0).reversals_s[5]) + 0.25
    found = struck_at_some_reversals({1: 1.0, 2: 1.0, 5: 3.0, 8: 1.0})
    assert any(each.span.start_s == pytest.approx(blow_s, abs=0.12) for each in found.events if each.knock)


@pytest.mark.parametrize("label", LABELS)
def test_what_is_left_out_leaves_the_features_as_they_were(label: str) -> None:
    """Three knocks in 25 s: what tells a fault moves by less than it scatters from one recording to the next."""
    joint = Joint(label, seed=8, duration_s=25.0)
    plain = extract(Recording(sound(joint), RATE_HZ)).features
    other = extract(Recording(sound(Joint(label, seed=9, duration_s=25.0)), RATE_HZ)).features
    disturbed = extract(Recording(knocked(joint, (5.2, 12.4, 19.1), 20.0), RATE_HZ)).features
    bumps = [plain.names.index(f"{kind}_bump_12_200_hz") for kind in ("notch", "play")]
    assert disturbed.values[bumps] == pytest.approx(plain.values[bumps], abs=2.0)
    bands = [index for index, name in enumerate(plain.names) if name.startswith("band_level")]
    moved = np.abs(disturbed.values[bands] - plain.values[bands])
    scatter = np.abs(other.values[bands] - plain.values[bands])
    assert np.nanmedian(moved) < 0.5 * np.nanmedian(scatter)


def test_a_stroke_under_loud_noise_is_one_event_of_its_length_and_no_knock() -> None:
    joint = Joint(seed=10, duration_s=8 * STROKE_S, start_s=STROKE_S / 2)
    samples = sound(joint).astype(np.float64)
    start, end = (round((joint.start_s + stroke * STROKE_S) * RATE_HZ) for stroke in (2, 3))
    samples[start:end] += 0.3 * np.random.default_rng(1).normal(size=end - start)
    found = of(samples)
    assert list(found.share.values()) == [pytest.approx(1 / 8, abs=0.02)] * 3
    (event,) = found.events
    assert event.span.start_s == pytest.approx(start / RATE_HZ, abs=0.1)
    assert event.span.end_s == pytest.approx(end / RATE_HZ, abs=0.15)
    assert not event.knock


def test_events_are_left_out_of_the_analysis_and_the_motion_stays() -> None:
    joint = Joint("notch", seed=11, duration_s=25.0)
    plain = survey(Recording(sound(joint), RATE_HZ), UNKNOWN)
    surveyed = survey(Recording(knocked(joint, (8.05,), 40.0), RATE_HZ), UNKNOWN)
    assert any(span.start_s < 8.05 < span.end_s for span in surveyed.analysis.left_out)
    assert surveyed.analysis.motion.reversal_times_s == pytest.approx(plain.analysis.motion.reversal_times_s, abs=0.02)
    around = surveyed.analysis.samples[round(8.05 * RATE_HZ) : round(8.1 * RATE_HZ)]
    assert not around.any()
