"""Reuse and revise: verdicts, documents, what a person makes of them."""

import json
import math

import numpy as np
import pytest

from casebase.diagnoses import DiagnosisFilter, get_diagnosis, list_diagnoses, revise_diagnosis
from casebase.errors import ConflictError, InvalidRequestError, StaleVersionError
from casebase.library import CaseLibrary
from casebase.reasoning.evaluation import evaluate
from casebase.store.database import strict_json
from casebase.store.models import StoredDiagnosis
from signals.features import FlagLevel, QualityFlag
from tests.casebase.made import NAMES, VERSION, add_case, extraction, store

KINDS = {"normal": (0.0, 0.0), "notch": (8.0, 0.0), "play": (0.0, 8.0)}
SIZE = 12
ON_SQLITE = pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
"""What reasons over features alone does not depend on the database."""


def features(generator: np.random.Generator, label: str) -> list[float]:
    """Return noise of spread 1, none beyond 2, with the class's two marks."""
    values = np.clip(generator.normal(size=SIZE), -2, 2)
    values[:2] += KINDS[label]
    return [float(value) for value in values]


def fill(library: CaseLibrary, labels: tuple[str, ...] = tuple(KINDS), gearboxes: int = 4) -> None:
    """Add two cases of each class from each gearbox."""
    generator = np.random.default_rng(7)
    with library.transaction("anna") as session:
        for gearbox in range(gearboxes):
            for label in labels * 2:
                seed = int(generator.integers(1 << 30))
                add_case(library, session, features(generator, label), label, seed=seed, gearbox=f"g{gearbox}")


def diagnose(library: CaseLibrary, values: list[float], seed: int = 1) -> StoredDiagnosis:
    """Store a recording with these features and diagnose it."""
    with library.transaction("otto") as session:
        row = store(library, session, values, seed=seed, gearbox="new")
        return library.reuse.diagnose(session, row, extraction(values))


@pytest.mark.parametrize("label", KINDS)
def test_a_recording_like_a_class_is_diagnosed(library: CaseLibrary, label: str) -> None:
    fill(library)
    found = diagnose(library, features(np.random.default_rng(5), label))
    assert (found.verdict, found.label) == ("diagnosed", label)
    document = found.document
    assert {"id", "verdict", "label", "probability", "hypotheses", "neighbours", "evidence", "quality"} < set(document)
    assert {"novelty", "recording", "provenance"} < set(document)
    assert json.loads(strict_json(document)) == document
    assert sum(each["probability"] for each in document["hypotheses"]) == pytest.approx(1)  # type: ignore[attr-defined]
    for neighbour in document["neighbours"]:  # type: ignore[attr-defined]
        assert math.fsum(neighbour["contributions"].values()) == pytest.approx(neighbour["distance"], rel=1e-12)
    assert document["hypotheses"][0]["support"]["measured"] >= 1  # type: ignore[index]


@ON_SQLITE
def test_a_kind_of_fault_that_is_not_in_the_library_is_said_to_be_new(library: CaseLibrary) -> None:
    fill(library, ("normal", "play"))
    found = diagnose(library, features(np.random.default_rng(3), "notch"))
    assert (found.verdict, found.label) == ("not_in_library", None)
    novelty = found.document["novelty"]
    assert novelty["distance"] > novelty["threshold"]  # type: ignore[index]
    assert found.document["evidence"][0]["quantity"] == NAMES[0]  # type: ignore[index]


@ON_SQLITE
def test_an_empty_library_says_so(library: CaseLibrary) -> None:
    found = diagnose(library, [1.0] * SIZE)
    assert found.verdict == "not_in_library"
    assert "no case" in found.document["remarks"][0]  # type: ignore[index]


@ON_SQLITE
def test_one_case_per_class_is_enough_to_answer_and_says_what_it_lacks(library: CaseLibrary) -> None:
    generator = np.random.default_rng(0)
    with library.transaction("anna") as session:
        for seed, label in enumerate(KINDS):
            add_case(library, session, features(generator, label), label, seed=seed)
    found = diagnose(library, features(generator, "notch"), seed=99)
    assert found.label in (None, "notch")
    assert found.document["novelty"]["threshold"] is None  # type: ignore[index]
    assert any("cannot fall to 0.05" in remark for remark in found.document["remarks"])  # type: ignore[attr-defined]


@ON_SQLITE
def test_an_unusable_recording_is_an_answer(library: CaseLibrary) -> None:
    fill(library)
    flag = QualityFlag("too_quiet", FlagLevel.UNUSABLE, "nothing but zeros; turn up the gain")
    with library.transaction("otto") as session:
        row = store(library, session, [0.0] * SIZE, seed=5)
        given = extraction([0.0] * SIZE)
        unusable = type(given)(given.features, (flag,), given.motion, given.events, given.extractor_version)
        found = library.reuse.diagnose(session, row, unusable)
    assert found.verdict == "unusable"
    told = {"name": "too_quiet", "severity": "unusable", "reason": flag.reason, "start_s": None, "end_s": None}
    assert found.document["quality"] == [told]
    assert found.document["disturbances"] == []


def test_a_person_has_the_last_word(library: CaseLibrary) -> None:
    fill(library)
    found = diagnose(library, features(np.random.default_rng(3), "notch"))
    with library.transaction("otto") as session:
        with pytest.raises(ConflictError, match="which `label`"):
            library.retain.diagnosis(session, found.id)
        with pytest.raises(InvalidRequestError, match="right `label`"):
            revise_diagnosis(session, found.id, "corrected")
        with pytest.raises(InvalidRequestError):
            revise_diagnosis(session, found.id, "confirmed", label="play")
        with pytest.raises(StaleVersionError):
            revise_diagnosis(session, found.id, "rejected", expected_version=7)
        revise_diagnosis(session, found.id, "corrected", label="pitting", verified_by="gearbox opened")
    with library.transaction("anna") as session:
        case = library.retain.diagnosis(session, found.id)
        assert (case.label, case.verified_by, case.diagnosis_id) == ("pitting", "gearbox opened", found.id)
        assert get_diagnosis(session, found.id).state == "corrected"
        listed = list_diagnoses(session, DiagnosisFilter(state="corrected", gearbox="new"))
        assert [row.id for row in listed.items] == [found.id]
        assert list_diagnoses(session, DiagnosisFilter(axis="other")).items == []


def test_another_process_is_seen_at_the_next_query(library: CaseLibrary) -> None:
    other = CaseLibrary(library.engine, library.data_dir)
    fill(library)
    with library.reading() as session:
        before = library.reuse.reasoner(session, VERSION)
        assert library.reuse.reasoner(session, VERSION) is before
    with other.transaction("bert") as session:
        add_case(other, session, [1.0] * SIZE, "normal", seed=1234)
    with library.reading() as session:
        assert len(library.reuse.reasoner(session, VERSION).table) == len(before.table) + 1


def test_what_is_rolled_back_is_not_remembered(library: CaseLibrary) -> None:
    fill(library)

    def retained_and_broken_off() -> None:
        with library.transaction("bert") as session:
            add_case(library, session, [9.0] * SIZE, "phantom", seed=4321)
            assert "phantom" in library.reuse.reasoner(session, VERSION).table.classes
            raise InvalidRequestError("broken off")

    with pytest.raises(InvalidRequestError, match="broken off"):
        retained_and_broken_off()
    with library.transaction("bert") as session:
        add_case(library, session, [0.5] * SIZE, "normal", seed=4322)
    with library.reading() as session:
        table = library.reuse.reasoner(session, VERSION).table
    assert "phantom" not in table.classes
    assert len(table) == 25


@ON_SQLITE
@pytest.mark.parametrize("label", ["notch"])
def test_a_service_and_its_evaluation_say_the_same(library: CaseLibrary, label: str) -> None:
    """What is said of a gearbox before it is known, and what is said when it is left out again."""
    fill(library)
    generator = np.random.default_rng(21)
    rows = [[0.6 * value for value in features(generator, label)] for _ in range(3)]
    found = [diagnose(library, values, seed=seed) for seed, values in enumerate(rows)]
    with library.transaction("anna") as session:
        for each in found:
            library.retain.diagnosis(session, each.id, label=label)
        outcomes = evaluate(library.retrieve.table(session, VERSION)).outcomes
    left_out = [each for each in outcomes if each.group == "new"]
    said = sorted((each.verdict, each.document["hypotheses"][0]["label"]) for each in found)  # type: ignore[index]
    assert sorted((each.verdict, each.best) for each in left_out) == said
    sure = sorted(each.document["hypotheses"][0]["probability"] for each in found)  # type: ignore[index]
    assert sorted(each.probability for each in left_out) == pytest.approx(sure)
