"""What a microphone hears: linear in the force, still when nothing moves, resonant where its housing is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode, hear, microphone_of
from sim.errors import ParameterError

MODES = (Mode(320.0, 0.05, 1.0), Mode(1500.0, 0.02, 0.5))
RATE = SAMPLE_RATE_HZ


def test_sound_is_linear_in_the_force() -> None:
    random = np.random.default_rng(0)
    one, other = random.standard_normal((2, 8000, 2))
    speed, deaf_to_noise = np.ones(8000), Microphone(MODES)
    both = hear(one + 3 * other, speed, RATE, deaf_to_noise, 0)
    parts = hear(one, speed, RATE, deaf_to_noise, 0) + 3 * hear(other, speed, RATE, deaf_to_noise, 0)
    np.testing.assert_allclose(both, parts, atol=1e-4 * float(np.abs(both).max()))


@pytest.mark.parametrize("mode", MODES)
def test_a_tone_at_resonance_is_heard_as_the_mode_says(mode: Mode) -> None:
    time_s = np.arange(16000) / RATE
    force = np.sin(2 * np.pi * mode.frequency_hz * time_s)[:, None]
    heard = hear(force, np.zeros(16000), RATE, Microphone((mode,)), 0)[8000:]
    assert np.sqrt(2 * np.mean(heard**2)) == pytest.approx(mode.amplitude / (2 * mode.damping_ratio), rel=0.01)


def test_rubbing_follows_the_speed_and_ends_at_standstill() -> None:
    speed = np.repeat([0.0, 1.0, 2.0], 80000)
    microphone = Microphone(MODES, rubbing_n_m=2.0, rubbing_exponent=1.0)
    heard = hear(np.zeros((240000, 1)), speed, RATE, microphone, 1)
    still, slow, fast = (np.sqrt(np.mean(part[8000:-100] ** 2)) for part in np.split(heard, 3))
    assert still < 1e-3 * slow
    assert fast / slow == pytest.approx(2.0, rel=0.05)


def test_ambient_noise_has_the_slope_that_was_asked_for() -> None:
    microphone = Microphone(MODES, ambient_n_m=1.0, ambient_slope=1.0)
    heard = hear(np.zeros((160000, 1)), np.zeros(160000), RATE, microphone, 2)
    frequency, density = signal.welch(heard, RATE, nperseg=4096)
    inside = (frequency > 30) & (frequency < 3000)
    slope = np.polyfit(np.log(frequency[inside]), np.log(density[inside]), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.05)
    assert np.sqrt(np.mean(heard**2)) == pytest.approx(1.0, rel=0.1)


def test_the_seed_decides_the_noise_and_nothing_else() -> None:
    noisy = Microphone(MODES, rubbing_n_m=1.0)
    force, speed = np.zeros((4000, 1)), np.ones(4000)
    np.testing.assert_array_equal(hear(force, speed, RATE, noisy, 3), hear(force, speed, RATE, noisy, 3))
    assert not np.array_equal(hear(force, speed, RATE, noisy, 3), hear(force, speed, RATE, noisy, 4))
    silent = replace(noisy, rubbing_n_m=0.0)
    np.testing.assert_array_equal(hear(force, speed, RATE, silent, 3), hear(force, speed, RATE, silent, 4))


def test_wrong_microphones_are_refused() -> None:
    with pytest.raises(ParameterError, match="rubbing_n_m: must be >= 0, got -1"):
        Microphone(rubbing_n_m=-1.0)
    with pytest.raises(ParameterError, match="damping ratio between 0 and 1"):
        Mode(100.0, 1.5, 1.0)


def test_a_microphone_survives_its_document() -> None:
    from dataclasses import asdict

    microphone = Microphone(MODES, gain=0.1, mesh_weights=(1.0, 0.5), rubbing_n_m=2.0)
    assert microphone_of(asdict(microphone)) == microphone
