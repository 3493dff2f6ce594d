"""Lines of a mesh mean the same on one axis alone: of another one they say nothing, and forbid nothing."""

from dataclasses import replace

import pytest

from casebase.reasoning.diagnosis import OF_ONE_AXIS, Reasoner
from signals.condition import OperatingCondition
from signals.features import Extraction, FeatureVector, extract
from signals.recording import Recording
from tests.casebase.made import heard_table
from tests.signals.synthetic import RATE_HZ, Joint, sound

AXIS = OperatingCondition(speed_rad_s=2.5, shaft_orders=(100.0, 12.5, 1.0), mesh_orders=(1200.0, 150.0))


def heard(label: str, seed: int) -> Extraction:
    return extract(Recording(sound(Joint(label, seed=seed)), RATE_HZ), AXIS)


@pytest.fixture(scope="module")
def reasoner() -> Reasoner:
    """A library of four gearboxes of one axis whose meshes are known."""
    return Reasoner(heard_table(heard, 4, "here"))


@pytest.mark.parametrize("label", ["normal", "notch", "play"])
def test_meshes_of_another_axis_are_not_compared(reasoner: Reasoner, label: str) -> None:
    """The same sound, were its mesh lines 60 dB higher: unknown of this axis, as before of another."""
    plain = heard(label, 77)
    names, values = plain.features.names, plain.features.values.copy()
    values[[name in OF_ONE_AXIS for name in names]] += 60.0
    strange = replace(plain, features=FeatureVector(names, values))
    assert reasoner.diagnose(plain, axis="here").label == label
    assert reasoner.diagnose(strange, axis="here").verdict == "not_in_library"
    assert reasoner.diagnose(strange, axis="elsewhere").label == label
