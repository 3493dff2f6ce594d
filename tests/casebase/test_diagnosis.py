"""What a diagnosis does not follow: gain, copies of the recording itself, who asks, and meshes of another axis."""

from dataclasses import replace

import numpy as np
import pytest

from casebase.reasoning.diagnosis import OF_ONE_AXIS, Diagnosis, Reasoner
from casebase.search.case_table import CaseTable
from signals.condition import UNKNOWN, OperatingCondition
from signals.features import Extraction, FeatureVector, extract
from signals.recording import Recording
from tests.casebase.made import heard_table
from tests.signals.synthetic import RATE_HZ, Joint, sound

LABELS = ("normal", "notch", "play")
AXIS = OperatingCondition(speed_rad_s=2.5, shaft_orders=(100.0, 12.5, 1.0), mesh_orders=(1200.0, 150.0))


def heard(label: str, seed: int, gain: float = 1.0, told: OperatingCondition = UNKNOWN) -> Extraction:
    return extract(Recording((gain * sound(Joint(label, seed=seed))).astype(np.float32), RATE_HZ), told)


@pytest.fixture(scope="module")
def table() -> CaseTable:
    """Three gearboxes, each normal, notch and play."""
    return heard_table(heard, 3)


@pytest.fixture(scope="module")
def of_here() -> Reasoner:
    """Four gearboxes of one axis whose meshes are known."""
    return Reasoner(heard_table(lambda label, seed: heard(label, seed, told=AXIS), 4, "here"))


def said(diagnosis: Diagnosis) -> tuple[str, str | None, list[str]]:
    return diagnosis.verdict, diagnosis.label, [each.label for each in diagnosis.hypotheses]


def probabilities(diagnosis: Diagnosis) -> dict[str, float]:
    return {each.label: each.probability for each in diagnosis.hypotheses}


@pytest.mark.parametrize("label", LABELS)
@pytest.mark.parametrize("gain", [0.1, -1.0])
def test_gain_of_the_sound_changes_nothing(table: CaseTable, label: str, gain: float) -> None:
    reasoner = Reasoner(table)
    plain, louder = (reasoner.diagnose(heard(label, 70, each), axis="axis") for each in (1.0, gain))
    assert said(plain) == said(louder)
    assert probabilities(plain) == pytest.approx(probabilities(louder), abs=0.01)


@pytest.mark.parametrize("row", [0, 2, 4])
def test_copies_of_a_case_do_not_change_its_diagnosis(table: CaseTable, row: int) -> None:
    """What is the same sound does not count, be it one case or three."""
    copies = table.take(np.array([*range(len(table)), row, row]))
    ids = np.array([f"{each:032x}" for each in range(len(copies))])
    copies = replace(copies, ids=ids)
    asked = heard(LABELS[row // 2], row % 2)
    np.testing.assert_array_equal(asked.features.values, table.values[row])
    one, three = (
        Reasoner(each).diagnose(asked, each.samples == table.samples[row], "axis", "g0") for each in (table, copies)
    )
    assert said(one) == said(three)
    assert probabilities(one) == pytest.approx(probabilities(three), abs=0.05)


def test_as_sure_as_the_cases_allow_is_said(table: CaseTable) -> None:
    found = Reasoner(table).diagnose(heard("normal", 70), axis="axis")
    assert found.probability == pytest.approx(1 - 1 / (len(table) + 2))
    assert any("surer" in each for each in found.remarks)


def test_a_library_of_one_label_says_so(table: CaseTable) -> None:
    known = table.take(table.labels == "normal")
    found = Reasoner(known).diagnose(heard("normal", 70))
    assert found.verdict == "ambiguous"
    assert found.probability is not None
    assert found.probability < 0.9
    assert any("one label alone" in remark for remark in found.remarks)
    assert not found.faults


@pytest.mark.parametrize("label", LABELS)
def test_meshes_of_another_axis_are_not_compared(of_here: Reasoner, label: str) -> None:
    """The same sound, were its mesh lines 60 dB higher: unknown of this axis, as before of another."""
    plain = heard(label, 77, told=AXIS)
    names, values = plain.features.names, plain.features.values.copy()
    values[[name in OF_ONE_AXIS for name in names]] += 60.0
    strange = replace(plain, features=FeatureVector(names, values))
    assert of_here.diagnose(plain, axis="here").label == label
    assert of_here.diagnose(strange, axis="here").verdict == "not_in_library"
    assert of_here.diagnose(strange, axis="elsewhere").label == label
