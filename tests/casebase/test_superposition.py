"""Two faults at once are both listed, one alone is not doubled, and a sound gear has none."""

from collections import Counter

import numpy as np
import pytest

from casebase.reasoning.diagnosis import Reasoner
from signals.features import extract
from signals.recording import Recording
from tests.casebase.made import heard_table
from tests.signals.synthetic import RATE_HZ, Joint, rings, sound


def joint(seed: int, *labels: str) -> Recording:
    """Return the sound of one joint with these faults, each of a strength of its own."""
    rng = np.random.default_rng(seed)
    samples = sound(Joint(seed=seed)).astype(np.float64)
    samples /= samples.std()
    time = np.arange(samples.size) / RATE_HZ
    for label in set(labels) - {"normal"}:
        fault = Joint(label, seed=seed)
        samples += rng.uniform(0.7, 1.4) * 0.15 * fault.ring * rings(fault, time)
    return Recording((0.1 * samples / samples.std()).astype(np.float32), RATE_HZ)


@pytest.fixture(scope="module")
def reasoner() -> Reasoner:
    """A library of five gearboxes, each normal, notch and play alone."""
    return Reasoner(heard_table(lambda label, seed: extract(joint(seed, label)), 5, apart=100))


@pytest.mark.parametrize("fault", ["notch", "play"])
def test_one_fault_is_not_doubled(reasoner: Reasoner, fault: str) -> None:
    listed = Counter(
        tuple(f.label for f in reasoner.diagnose(extract(joint(7000 + i, fault))).faults) for i in range(8)
    )
    assert listed[(fault,)] >= 7
    assert set(listed) <= {(fault,), ()}


def test_two_faults_are_both_listed(reasoner: Reasoner) -> None:
    """Of a library that has no case of both, most are named, and none is called sound."""
    found = [reasoner.diagnose(extract(joint(7000 + i, "notch", "play"))) for i in range(12)]
    assert all(each.label != "normal" for each in found)
    assert sum({f.label for f in each.faults} == {"notch", "play"} for each in found) >= 5
    for each in found:
        assert [f.probability for f in each.faults] == sorted((f.probability for f in each.faults), reverse=True)


def test_a_sound_gear_has_none(reasoner: Reasoner) -> None:
    assert all(not reasoner.diagnose(extract(joint(7000 + i))).faults for i in range(4))
