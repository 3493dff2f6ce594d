"""Each flag is raised by its fault alone, and not by a good recording of any kind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signals.condition import UNKNOWN, OperatingCondition
from signals.features import Extraction, FlagLevel, extract
from signals.recording import Recording
from tests.signals.synthetic import RATE_HZ, Joint, sound

TIME = np.arange(160000) / RATE_HZ
GOOD = sound(Joint(seed=11))


def flagged(
    samples: np.ndarray, rate_hz: float = RATE_HZ, condition: OperatingCondition = UNKNOWN, channels: int = 1
) -> Extraction:
    return extract(Recording(samples.astype(np.float32), rate_hz, 0, channels), condition)


def flags(extraction: Extraction) -> dict[str, FlagLevel]:
    return {flag.name: flag.severity for flag in extraction.quality}


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 10**6), label=st.sampled_from(["normal", "play", "notch"]), bits=st.sampled_from([16, 24]))
def test_a_good_recording_has_no_flag(seed: int, label: str, bits: int) -> None:
    samples = sound(Joint(label=label, seed=seed))
    assert flags(flagged(np.round(samples * 2 ** (bits - 1)) / 2 ** (bits - 1))) == {}


@pytest.mark.parametrize("frequency_hz", [3.0, 50.0, 440.0])
def test_a_pure_tone_is_not_clipped(frequency_hz: float) -> None:
    for rate_hz in (8000.0, 48000.0):
        time = np.arange(int(5 * rate_hz)) / rate_hz
        tone = np.round(np.sin(2 * np.pi * frequency_hz * time) * 2**15) / 2**15
        assert "clipped" not in flags(flagged(tone, rate_hz))


def test_clipping_is_flagged_at_any_level_and_forbids_when_much_is_lost() -> None:
    for gain in (1.0, 0.01):
        for share in (0.995, 0.98):
            limit = np.quantile(np.abs(GOOD), share)
            assert flags(flagged(gain * np.clip(GOOD, -limit, limit)))["clipped"] is FlagLevel.NOTE
    hard = flagged(np.clip(GOOD, -0.05, 0.05))
    assert flags(hard)["clipped"] is FlagLevel.UNUSABLE
    assert hard.unusable_reason is not None
    assert "gain" in hard.unusable_reason


def test_a_recording_of_some_steps_is_too_quiet_and_not_clipped_as_well() -> None:
    """Advice to raise the gain and to lower it at once would help nobody."""
    for level in (1e-4, 3e-4):
        quiet = flags(flagged(np.round(GOOD / np.abs(GOOD).max() * level * 2**15) / 2**15))
        assert "too_quiet" in quiet
        assert "clipped" not in quiet


def test_offset_level_and_silence() -> None:
    assert flags(flagged(GOOD + 0.02))["dc_offset"] is FlagLevel.NOTE
    assert flags(flagged(GOOD + 0.5))["dc_offset"] is FlagLevel.NOTE
    steps = GOOD / GOOD.std()
    assert flags(flagged(np.round(5 * steps) / 2**15))["too_quiet"] is FlagLevel.POOR
    assert flags(flagged(np.round(steps) / 2**15))["too_quiet"] is FlagLevel.UNUSABLE
    silent = flagged(np.full(16000, 0.25))
    assert not silent.usable
    assert "silent" in str(silent.unusable_reason)


def test_too_short_for_the_motion() -> None:
    name = "too_short_for_motion"
    lengths = {3.5: FlagLevel.POOR, 7.0: FlagLevel.POOR, 12.0: FlagLevel.NOTE}
    for duration_s, severity in lengths.items():
        short = flags(flagged(sound(Joint(duration_s=duration_s, start_s=1.7))))
        assert short == {name: severity}
    steady = np.random.default_rng(0).normal(0, 0.1, 40000)
    assert flags(flagged(steady)) == {name: FlagLevel.NOTE}
    assert flags(flagged(steady, condition=OperatingCondition(steady=True))) == {}


def test_a_period_that_the_sound_does_not_have() -> None:
    right = flagged(GOOD, condition=OperatingCondition(motion_period_s=6.2))
    wrong = flagged(GOOD, condition=OperatingCondition(motion_period_s=4.0))
    assert flags(right) == {}
    assert flags(wrong) == {"motion_contradicts": FlagLevel.POOR}


def test_bandwidth() -> None:
    narrow = Recording(GOOD, RATE_HZ).resampled(1500.0)
    assert flags(extract(narrow))["bandwidth_too_low"] is FlagLevel.NOTE
    upsampled = narrow.resampled(RATE_HZ)
    assert flags(extract(upsampled))["bandwidth_too_low"] is FlagLevel.NOTE
    assert flags(extract(Recording(GOOD, RATE_HZ).resampled(800.0)))["bandwidth_too_low"] is FlagLevel.POOR
    assert not extract(Recording(GOOD, RATE_HZ).resampled(300.0)).usable


def test_what_a_low_sample_rate_leaves_out_is_said() -> None:
    """8 kHz is the promise; at half of it bands above some 1.9 kHz have no value."""
    slow = extract(Recording(GOOD, RATE_HZ).resampled(4000.0))
    flag = next(flag for flag in slow.quality if flag.name == "bandwidth_too_low")
    assert flag.severity is FlagLevel.NOTE
    assert flag.reason.startswith("the sample rate is 4000 Hz, so the recording holds nothing above 1")
    assert slow.usable
    assert flags(extract(Recording(GOOD, RATE_HZ).resampled(48000.0))) == {}


def test_hum_that_swells_is_flagged_and_steady_hum_is_not() -> None:
    hum = 0.1 * np.sin(2 * np.pi * 50 * TIME)
    assert flags(flagged(GOOD + hum)) == {}
    swelling = flags(flagged(GOOD + hum * (1 + 0.95 * np.sin(2 * np.pi * 0.4 * TIME))))
    assert swelling == {"unsteady_hum": FlagLevel.NOTE}


def test_one_of_several_channels_is_said() -> None:
    extraction = flagged(GOOD, channels=4)
    assert flags(extraction) == {"channel_choice": FlagLevel.NOTE}
    assert "channel 0 of 0 to 3" in extraction.quality[0].reason
