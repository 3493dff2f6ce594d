"""Sounds that are none of a moving axis are not in a library of moving axes, however smooth they are."""

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.field_bank.foreign import FAMILIES
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.tuning import TUNING
from signals.features import Extraction, extract
from signals.recording import Recording
from tests.casebase.made import measured_table
from tests.signals.synthetic import RATE_HZ, Joint, sound

SECONDS = 10


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


@pytest.mark.parametrize("name", ["noise_steady", "empty_room", "fan", "clicks_in_silence", "crowd", "rain"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_sound_of_no_axis_is_not_in_the_library(reasoner: Reasoner, name: str, seed: int) -> None:
    found = reasoner.diagnose(extraction(FAMILIES[name].make(np.random.default_rng(seed), int(RATE_HZ), SECONDS)))
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
