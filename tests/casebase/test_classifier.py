"""The classifier: probabilities, prediction sets, and what of a gearbox its own answers never use."""

import numpy as np
import pytest

from casebase.reasoning.classifier import Classifier
from casebase.reasoning.diagnosis import EXCLUDED_BELOW, Reasoner
from casebase.reasoning.evaluation import evaluate
from casebase.search.case_table import CaseTable
from casebase.search.similarity import Floats
from tests.casebase.made import NAMES, measured_table

LABELS = ("normal", "notch", "play")
SIZE = 6


def drawn(rng: np.random.Generator, boxes: int, shift: float, each: int = 2) -> tuple[CaseTable, CaseTable]:
    """Return cases of some gearboxes, so many of each label, and one of each label of another gearbox."""
    labels = np.tile(np.repeat(np.arange(3), each), boxes + 1)
    gearboxes = np.repeat(np.arange(boxes + 1), 3 * each)
    values = rng.normal(size=(labels.size, SIZE)) + np.repeat(rng.normal(size=(boxes + 1, SIZE)), 3 * each, axis=0)
    values[labels > 0, labels[labels > 0] - 1] += shift
    table = measured_table(NAMES[:SIZE], values, [LABELS[each] for each in labels], gearboxes.tolist())
    return table.take(gearboxes < boxes), table.take(np.flatnonzero(gearboxes == boxes)[::each])


@pytest.mark.parametrize("shift", [0.0, 2.0, 20.0])
def test_probabilities_sum_to_one(shift: float) -> None:
    for seed in range(2):
        known, asked = drawn(np.random.default_rng(seed), 2 + 3 * seed, shift)
        for values in asked.values:
            judgement = Reasoner(known).judge(values, "axis")
            probabilities = [each.probability for each in judgement.hypotheses]
            assert sum(probabilities) == pytest.approx(1)
            assert probabilities == sorted(probabilities, reverse=True)
            assert probabilities[-1] >= 0
            assert judgement.fault is not None
            assert 0 < judgement.fault < 1


def test_order_of_the_cases_changes_nothing() -> None:
    rng = np.random.default_rng(1)
    known, asked = drawn(rng, 5, 3.0)
    shuffled = known.take(rng.permutation(len(known)))
    for values in asked.values:
        one, other = (Reasoner(table).judge(values, "axis") for table in (known, shuffled))
        assert [each.label for each in one.hypotheses] == [each.label for each in other.hypotheses]
        for first, second in zip(one.hypotheses, other.hypotheses, strict=True):
            assert first.probability == pytest.approx(second.probability, abs=2e-3)
            assert first.p_value == second.p_value
        assert one.p_value == pytest.approx(other.p_value)


def test_prediction_sets_hold_the_truth_nine_times_in_ten() -> None:
    """On 100 drawn libraries of ten cases of each label and more, asked of a gearbox that they do not have.

    Fewer than ten exclude nothing, and of so few the p-values go in steps: sets hold it rather more often than less.
    """
    held = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        known, asked = drawn(rng, int(rng.integers(5, 11)), float(rng.uniform(1.0, 6.0)))
        classifier = Classifier(known, np.arange(len(known)))
        for values, truth in zip(asked.values, asked.labels, strict=True):
            p_values = classifier.held_out.p_values(classifier.shares(values))
            held.append(p_values[classifier.classes.index(truth)] > EXCLUDED_BELOW)
    assert 0.85 <= np.mean(held) <= 0.97


def test_held_out_answers_never_use_their_own_gearbox() -> None:
    """Labels drawn per gearbox are recited by whoever has seen the gearbox, and by nobody else."""
    rng = np.random.default_rng(3)
    values = np.repeat(rng.normal(size=(12, SIZE)) * 50, 4, axis=0) + rng.normal(size=(48, SIZE)) * 0.01
    labels = np.repeat(rng.permutation(["normal", "notch"] * 6), 4).tolist()
    own, each = (
        Classifier(table, np.arange(48))
        for table in (
            measured_table(NAMES[:SIZE], values, labels, np.repeat(np.arange(12), 4).tolist()),
            measured_table(NAMES[:SIZE], values, labels, list(range(48))),
        )
    )
    right = [np.mean(one.held_out.shares.argmax(axis=1) == one.held_out.truth) for one in (own, each)]
    assert right[0] < 0.8 < 0.9 <= right[1]


def test_a_held_out_answer_stays_whatever_its_gearbox_is_called() -> None:
    """What `evaluate` says of a gearbox follows neither the labels nor the number of that gearbox's other cases."""
    table, _ = drawn(np.random.default_rng(5), 4, 3.0)
    relabelled = table.labels.copy()
    relabelled[table.gearboxes == "g1"] = "play"
    ids, _, origins, axes, gearboxes, samples = table.text
    other = table.with_columns(1, [ids, relabelled, origins, axes, gearboxes, samples], table.values)
    said = [
        [(each.best, each.verdict, each.probability) for each in evaluate(one).outcomes if each.group == "g1"]
        for one in (table, other)
    ]
    assert said[0] == said[1]


def test_a_classifier_that_is_deaf_finds_and_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    table, _ = drawn(np.random.default_rng(6), 5, 8.0)
    hearing = evaluate(table)

    def even(classifier: Classifier, *_: object) -> Floats:
        return np.full(len(classifier.classes), 1 / len(classifier.classes))

    monkeypatch.setattr(Classifier, "shares", even)
    deaf = evaluate(table)
    assert hearing.accuracy.right >= 0.9 * hearing.cases
    assert hearing.said.of >= 0.8 * hearing.cases
    assert deaf.accuracy.right <= 0.5 * deaf.cases
    assert deaf.said.of == 0
