"""Telemetry tells when the axis stood still, as the sound does."""

from dataclasses import replace

import numpy as np
import pytest
import soundfile

from signals.analysis import Analysis
from signals.condition import UNKNOWN
from signals.motion import reversal_times_s
from signals.recording import Recording
from signals.telemetry import read_telemetry
from tests.shared_data import shared

TIME = np.arange(40000) * 0.0005


def test_reversals_of_a_cosine_are_its_extremes() -> None:
    noise = np.random.default_rng(0).normal(0, 1e-4, TIME.size)
    position = 2 + 0.7 * np.cos(2 * np.pi * TIME / 5 + 0.5) + noise
    times = np.array(reversal_times_s(TIME, position))
    expected = (np.arange(1, 8) * np.pi - 0.5) * 5 / (2 * np.pi)
    np.testing.assert_allclose(times, expected[expected < times[-1] + 0.1], atol=0.02)
    assert times.size == 7


def test_a_pause_at_the_end_is_one_reversal_in_its_middle() -> None:
    position = np.interp(TIME, [0, 3, 4, 7, 8, 11, 12, 15, 20], [0, 1, 1, 0, 0, 1, 1, 0, 0])
    np.testing.assert_allclose(reversal_times_s(TIME, position), [3.5, 7.5, 11.5], atol=0.01)


@pytest.mark.parametrize("name", ["d01", "d03", "d04"])
def test_sound_and_telemetry_agree_on_the_reversals(name: str) -> None:
    telemetry = read_telemetry(shared("challenge", "dev", name, "telemetry.csv"))
    samples, rate_hz = soundfile.read(shared("challenge", "dev", name, "sound.wav"), dtype="float32")
    recording = Recording(samples, rate_hz)
    reversals = reversal_times_s(telemetry.time_s - telemetry.time_s[0], telemetry["motor_position_rad"])
    told = Analysis(recording, replace(UNKNOWN, reversal_times_s=reversals)).motion
    heard = Analysis(recording, UNKNOWN).motion
    assert told.period_s == pytest.approx(heard.period_s, rel=0.003)
    for time in told.reversal_times_s:
        assert np.abs(np.array(heard.reversal_times_s) - time).min() < 0.06
