"""Sounds that are none of a moving axis are not in a library of moving axes, however smooth they are."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.tuning import TUNING
from signals.features import Extraction, extract
from signals.recording import Recording
from tests.casebase.made import measured_table
from tests.signals.synthetic import RATE_HZ, Joint, sound

SECONDS = 10
COUNT = int(SECONDS * RATE_HZ)
Made = Callable[[np.random.Generator], NDArray[np.floating]]


def extraction(samples: NDArray[np.floating]) -> Extraction:
    return extract(Recording((0.1 * samples / np.abs(samples).max()).astype(np.float32), RATE_HZ))


def joint(label: str, seed: int) -> Extraction:
    return extraction(sound(Joint(label, seed=seed, duration_s=SECONDS, stroke_s=2.1 + 0.02 * seed)))


@pytest.fixture(scope="module")
def reasoner() -> Reasoner:
    """Three gearboxes, every class of each."""
    labels = [label for _ in range(3) for label in ("normal", "notch", "play")]
    extractions = [joint(label, seed) for seed, label in enumerate(labels)]
    values = np.array([each.features.values for each in extractions])
    return Reasoner(measured_table(extractions[0].features.names, values, labels, [0, 0, 0, 1, 1, 1, 2, 2, 2]))


def white(generator: np.random.Generator) -> NDArray[np.floating]:
    return generator.normal(size=COUNT)


def pink(generator: np.random.Generator) -> NDArray[np.floating]:
    spectrum = np.fft.rfft(generator.normal(size=COUNT))
    return np.fft.irfft(spectrum / np.sqrt(np.maximum(np.arange(spectrum.size), 1)), COUNT)


def fan(generator: np.random.Generator) -> NDArray[np.floating]:
    sos = signal.butter(2, (60, 900), "bandpass", fs=RATE_HZ, output="sos")
    return signal.sosfilt(sos, white(generator)) + 0.3 * np.sin(2 * np.pi * 97 * np.arange(COUNT) / RATE_HZ)


def hum(generator: np.random.Generator) -> NDArray[np.floating]:
    return np.sin(2 * np.pi * 50 * np.arange(COUNT) / RATE_HZ) + 1e-3 * white(generator)


def clicks_in_silence(generator: np.random.Generator) -> NDArray[np.floating]:
    samples = 1e-3 * white(generator)
    for start in generator.integers(0, COUNT - 60, 30):
        samples[start : start + 60] += np.exp(-np.arange(60) / 10) * np.sin(np.arange(60))
    return samples


def notes(generator: np.random.Generator) -> NDArray[np.floating]:
    time = np.arange(COUNT // 20) / RATE_HZ
    pitches = 220 * 2 ** (generator.integers(0, 24, 20) / 12)
    return np.concatenate([np.sin(2 * np.pi * pitch * time) * np.exp(-4 * time) for pitch in pitches])


@pytest.mark.parametrize("made", [white, pink, fan, hum, clicks_in_silence, notes])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_sound_of_no_axis_is_not_in_the_library(reasoner: Reasoner, made: Made, seed: int) -> None:
    found = reasoner.diagnose(extraction(made(np.random.default_rng(seed))))
    assert found.verdict == "not_in_library"
    assert found.label is None
    assert found.p_value is not None
    assert found.p_value < TUNING.level


@pytest.mark.parametrize("label", ["normal", "notch", "play"])
def test_a_joint_among_noise_still_moves(reasoner: Reasoner, label: str) -> None:
    """With noise as loud as the sound itself the motion stays audible."""
    clean = sound(Joint(label, seed=50, duration_s=SECONDS))
    noise = np.random.default_rng(3).normal(scale=np.sqrt(np.mean(clean**2)), size=clean.size)
    found = reasoner.diagnose(extraction(clean + noise))
    assert not any("no regular motion" in remark for remark in found.remarks)
