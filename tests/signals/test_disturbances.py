"""Each disturbance is found by its name and its time, and a good recording has none."""

import numpy as np
import pytest
from scipy import signal

from signals.condition import UNKNOWN, OperatingCondition
from signals.features import extract
from signals.recording import Recording
from signals.recording_quality.disturbances import flags, survey
from signals.recording_quality.quality import FlagLevel, QualityFlag
from tests.signals.synthetic import RATE_HZ, Joint, sound

JOINT = Joint(seed=21, duration_s=25.0)
GOOD = sound(JOINT).astype(np.float64)
NOISE = np.random.default_rng(2).normal(size=GOOD.size)
RMS = float(GOOD.std())


def found(samples: np.ndarray, condition: OperatingCondition = UNKNOWN) -> dict[str, QualityFlag]:
    """Return the disturbances by name."""
    flagged = flags(survey(Recording(samples.astype(np.float32), RATE_HZ), condition))
    return {each.name: each for each in flagged if each.disturbance is not None}


def window(start_s: float, end_s: float) -> np.ndarray:
    """Return 1 between two times and 0 elsewhere, with soft ends."""
    time = np.arange(GOOD.size) / RATE_HZ
    return np.clip(np.minimum(time - start_s, end_s - time) / 0.1, 0, 1)


def blow(times_s: tuple[float, ...], height: float = 15.0, frequency_hz: float = 300.0) -> np.ndarray:
    time = np.arange(round(0.2 * RATE_HZ)) / RATE_HZ
    samples = GOOD.copy()
    for time_s in times_s:
        part = samples[round(time_s * RATE_HZ) :][: time.size]
        part += (height * RMS * np.sin(2 * np.pi * frequency_hz * time) * np.exp(-time / 0.02))[: part.size]
    return samples


@pytest.mark.parametrize("label", ["normal", "notch", "play"])
@pytest.mark.parametrize("seed", range(8))
def test_a_good_recording_has_none(label: str, seed: int) -> None:
    assert found(sound(Joint(label, seed=seed, duration_s=20.0))) == {}


def test_silence_is_named_at_either_end() -> None:
    still = np.zeros(round(3 * RATE_HZ))
    for samples, span in ((np.r_[still, GOOD], (0.0, 3.0)), (np.r_[GOOD, still], (25.0, 28.0))):
        flag = found(samples)["silence"]
        assert (flag.start_s, flag.end_s) == pytest.approx(span, abs=0.2)
        assert flag.severity is FlagLevel.NOTE


def test_a_pause_is_named_with_what_is_left_out() -> None:
    """The axis waits at a reversal of the middle."""
    place = round(JOINT.reversals_s[4] * RATE_HZ)
    rest = 0.002 * RMS * np.random.default_rng(3).normal(size=round(5 * RATE_HZ))
    flag = found(np.r_[GOOD[:place], rest, GOOD[place:]])["pause"]
    assert (flag.start_s, flag.end_s) == pytest.approx((place / RATE_HZ, place / RATE_HZ + 5), abs=0.4)
    assert f"{place / RATE_HZ - 0.2:.0f}" in flag.reason


def test_knocks_are_named_by_how_many_and_how_regular_they_are() -> None:
    (only,) = found(blow((8.0,))).values()
    assert (only.name, only.start_s) == ("bump", pytest.approx(8.0, abs=0.1))
    handled = found(blow((2.3, 5.2, 6.1, 11.0, 11.9, 18.4)))
    assert handled["handling"].start_s == pytest.approx(2.3, abs=0.1)
    assert "second_machine" not in handled
    struck = found(blow(tuple(np.arange(0.5, 24.5, 1.7))))
    assert "every 1.70 s" in struck["second_machine"].reason
    assert "handling" not in struck


RUMBLE = signal.sosfilt(signal.butter(2, 60, fs=RATE_HZ, output="sos"), NOISE)
RUMBLE *= RMS / RUMBLE.std()


@pytest.mark.parametrize("height", [0.6, 1.0, 3.0])
def test_rumble_is_wind(height: float) -> None:
    assert set(found(GOOD + height * RUMBLE * window(8.0, 10.5))) == {"wind"}


def test_what_reaches_higher_is_foreign() -> None:
    chirp = signal.chirp(np.arange(GOOD.size) / RATE_HZ, 400, 25.0, 2500)
    heard = found(GOOD + 0.6 * RMS * chirp * window(13.0, 15.0))
    assert "wind" not in heard
    flag = heard["foreign_sound"]
    assert flag.start_s == pytest.approx(13.0, abs=0.3)
    assert flag.end_s is not None
    assert flag.end_s < 15.3


def test_more_noise_is_said_and_forbids_nothing() -> None:
    assert "noise" not in found(GOOD + 0.1 * RMS * NOISE)
    assert found(GOOD + 0.4 * RMS * NOISE)["noise"].severity is FlagLevel.NOTE
    assert found(GOOD + 0.8 * RMS * NOISE)["noise"].severity is FlagLevel.NOTE


def test_a_gain_that_rises_at_standstill_is_named() -> None:
    """Twice as loud after every start, and down to 1 within a second, noise and all.

    In silence it is a gear that is louder where it accelerates.
    """
    since = (np.arange(GOOD.size) / RATE_HZ - JOINT.start_s) % JOINT.stroke_s
    gain = 1 + np.exp(-np.maximum(since - 0.35, 0) / 0.5)
    noisy = GOOD + 0.4 * RMS * NOISE
    assert found(gain * noisy)["automatic_gain"].severity is FlagLevel.NOTE
    for other in (noisy, GOOD, gain * GOOD):
        assert "automatic_gain" not in found(other)


def test_a_missing_low_band_is_named() -> None:
    def above(cut_hz: float) -> np.ndarray:
        sections = signal.butter(4, cut_hz, "highpass", fs=RATE_HZ, output="sos")
        return np.asarray(signal.sosfilt(sections, GOOD))

    assert "low_band_missing" not in found(above(20.0))
    for cut_hz in (200.0, 300.0):
        assert found(above(cut_hz))["low_band_missing"].severity is FlagLevel.POOR


def test_lost_samples_are_left_out_and_named_once() -> None:
    samples = GOOD.copy()
    for start in (30000, 90000):
        samples[start : start + 400] = samples[start]
    named = found(samples)
    assert set(named) == {"dropouts"}
    surveyed = survey(Recording(samples.astype(np.float32), RATE_HZ), UNKNOWN)
    assert [round(span.start_s, 2) for span in surveyed.lost] == pytest.approx([3.75, 11.25], abs=0.01)


def test_a_steady_machine_is_not_divided() -> None:
    """It has no reversals, so what is quiet is no standstill and nothing can be held against a cycle."""
    samples = np.r_[np.zeros(round(2 * RATE_HZ)), GOOD]
    surveyed = survey(Recording(samples.astype(np.float32), RATE_HZ), OperatingCondition(steady=True))
    assert (surveyed.start_s, surveyed.analysis.duration_s) == (0.0, 27.0)
    assert surveyed.analysis.unrepeated is None


def test_where_most_would_be_left_out_nothing_is() -> None:
    """Then the disturbance is what is heard, and the recording is poor."""
    rng = np.random.default_rng(5)
    samples = GOOD + 3 * np.repeat(rng.random(50) > 0.4, GOOD.size // 50) * RUMBLE
    surveyed = survey(Recording(samples.astype(np.float32), RATE_HZ), UNKNOWN)
    assert surveyed.analysis.unrepeated is not None
    assert sum(event.span.duration_s for event in surveyed.analysis.unrepeated.events) > 12.5
    assert surveyed.analysis.left_out == ()
    assert {flag.severity for flag in found(samples).values()} == {FlagLevel.POOR}


def test_times_count_from_the_start_of_the_recording() -> None:
    lead = np.zeros(round(4 * RATE_HZ))
    early, late = found(blow((8.0,)))["bump"], found(np.r_[lead, blow((8.0,))])["bump"]
    assert early.start_s is not None
    assert late.start_s == pytest.approx(early.start_s + 4.0, abs=0.02)


def test_given_reversals_are_moved_with_the_piece() -> None:
    """A lead-in of 4 s shifts what was given from the start of the recording."""
    lead = np.zeros(round(4 * RATE_HZ))
    times = tuple(float(time) + 4.0 for time in JOINT.reversals_s if 0 < time < 25)
    given = extract(
        Recording(np.r_[lead, GOOD].astype(np.float32), RATE_HZ), OperatingCondition(reversal_times_s=times)
    )
    assert given.motion.reversal_times_s == pytest.approx(times, abs=0.01)


@pytest.mark.parametrize("hops", [4001, 4003, 4017])
def test_half_a_sample_less_than_whole_hops_is_read(hops: int) -> None:
    """What is left out is counted by the length as recorded, a trace by the resampled one, which is rounded up."""
    resampled = signal.resample_poly(blow((7.4,), 60.0), 441, 80)[: int(hops * 44100 / 200)]
    extraction = extract(Recording(resampled.astype(np.float32), 44100.0))
    assert {"bump", "handling"} & {flag.name for flag in extraction.quality}
