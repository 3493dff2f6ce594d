"""A fold finds what repeats with the motion, tells one direction from both, and finds nothing in noise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signals.analysis import Analysis
from signals.band import Band
from signals.condition import UNKNOWN, OperatingCondition
from signals.events import EventKind, find_events
from signals.features import extract
from signals.half_cycles import FALSE_ALARM, noise_peak_db
from signals.recording import Recording
from tests.signals.synthetic import RATE_HZ, Joint, ring_times_s, sound

PLAY, NOTCH = "play_bump_12_200_hz", "notch_bump_12_200_hz"


def features(joint: Joint) -> tuple[float, float]:
    vector = extract(Recording(sound(joint), RATE_HZ)).features
    return vector[PLAY], vector[NOTCH]


@settings(deadline=None, max_examples=8)
@given(
    seed=st.integers(0, 10**6),
    stroke_s=st.floats(2.5, 4.0),
    ring_hz=st.floats(30, 120),
    phase=st.floats(0, 1),
    duration_s=st.sampled_from([11.0, 20.0, 30.0]),
)
def test_a_hidden_notch_and_hidden_play_are_told_apart(
    seed: int, stroke_s: float, ring_hz: float, phase: float, duration_s: float
) -> None:
    found = {
        label: features(Joint(label, seed, duration_s, stroke_s, ring=14.0, ring_hz=ring_hz, notch_phase=phase))
        for label in ("normal", "play", "notch")
    }
    assert found["play"][0] > 2 + max(0, found["normal"][0], found["notch"][0])
    assert found["notch"][1] > 4 + max(0, found["normal"][1], found["play"][1])


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10**6))
def test_a_healthy_joint_stays_near_what_noise_reaches(seed: int) -> None:
    assert max(features(Joint(seed=seed))) < 3


@pytest.mark.parametrize("label", ["play", "notch"])
def test_a_harder_fault_stands_higher_by_its_decibels(label: str) -> None:
    place = ("play", "notch").index(label)
    heights = [features(Joint(label=label, seed=5, ring=ring))[place] for ring in (6.0, 12.0, 24.0)]
    assert 3 < heights[1] - heights[0] < 8
    assert 1.5 < heights[2] - heights[1] < 8


def test_events_stand_where_the_fault_rings() -> None:
    for label, kind in (("play", EventKind.PLAY), ("notch", EventKind.NOTCH)):
        joint = Joint(label=label, seed=1, ring=12.0)
        events = find_events(Analysis(Recording(sound(joint), RATE_HZ), UNKNOWN))
        times = [event.time_s for event in events if event.kind is kind]
        true = ring_times_s(joint)
        assert len(times) >= 3
        assert max(np.abs(true - time).min() for time in times) < 0.04
        assert list(events) == sorted(events, key=lambda event: event.time_s)
        impulses = [event.time_s for event in events if event.kind is EventKind.IMPULSE]
        inside = true[(true > 0.05) & (true < 19.9)]
        assert all(min(abs(np.array(impulses) - time)) < 0.04 for time in inside)


def test_impulses_of_a_train_have_the_period_of_the_train() -> None:
    rng = np.random.default_rng(2)
    samples = rng.normal(0, 0.01, 80000)
    for start in np.arange(0.13, 9.9, 0.7):
        samples[int(start * RATE_HZ) : int(start * RATE_HZ) + 120] += 0.2 * np.sin(np.arange(120) * 2 * np.pi / 120)
    analysis = Analysis(Recording(samples.astype(np.float32), RATE_HZ), OperatingCondition(steady=True))
    times, heights = analysis.impulses(Band.LOW)
    strong = times[heights > 6]
    assert strong.size == 14
    assert times.size <= 16
    np.testing.assert_allclose(np.diff(strong), 0.7, atol=0.011)


@pytest.mark.parametrize("strokes", [1, 2, 3, 4, 6])
def test_noise_rises_above_its_peak_as_often_as_said(strokes: int) -> None:
    """Medians of independent chi-squared draws pass the threshold at the rate of the false alarm."""
    rng = np.random.default_rng(strokes)
    freedom, positions, runs = 8, 60, 4000
    noise = np.sort(rng.chisquare(freedom, (strokes, runs, positions)), axis=0)[(strokes - 1) // 2]
    height_db = 10 * np.log10(noise.max(axis=1) / 7.344)
    rate = np.mean(height_db > noise_peak_db(strokes, freedom, positions))
    assert FALSE_ALARM / 5 < rate < FALSE_ALARM
