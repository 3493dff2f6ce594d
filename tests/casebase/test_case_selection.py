"""Which cases count for an axis: its own measured ones, and of others what it has none of itself."""

from dataclasses import replace

import numpy as np
import pytest

from casebase.reasoning.diagnosis import Reasoner
from casebase.search.case_selection import fitted
from casebase.search.case_table import CaseTable
from tests.casebase.made import NAMES, measured_table

LABELS = ("normal", "notch", "play")
SIZE = 6


def cases(seed: int, axis: str, origin: str, *, boxes: int = 4, shift: float = 6.0, turned: int = 0) -> CaseTable:
    """Return two cases of each label and gearbox; the mark of a fault is `turned` features further on."""
    rng = np.random.default_rng(seed)
    numbers = np.tile(np.repeat(np.arange(3), 2), boxes)
    values = rng.normal(size=(numbers.size, SIZE))
    values[numbers > 0, (numbers[numbers > 0] - 1 + turned) % SIZE] += shift
    gearboxes = np.repeat(np.arange(boxes), 6) + 100 * seed
    table = measured_table(NAMES[:SIZE], values, [LABELS[each] for each in numbers], gearboxes.tolist(), axis)
    origins = np.full(len(table), origin, "U9")
    return replace(table, origins=origins, gearboxes=np.where(origins == "measured", table.gearboxes, ""))


def together(*tables: CaseTable) -> CaseTable:
    columns = [np.concatenate(parts) for parts in zip(*(each.text for each in tables), strict=True)]
    columns[0] = columns[5] = np.array([f"{row:032x}" for row in range(columns[0].size)])
    return tables[0].with_columns(1, columns, np.concatenate([each.values for each in tables]))


def counting(table: CaseTable, axis: str | None) -> np.ndarray:
    return Reasoner(table).model(axis).counting


def test_simulated_cases_of_an_axis_count_until_it_is_measured() -> None:
    simulated, elsewhere = cases(1, "here", "simulated"), cases(2, "elsewhere", "measured", turned=2)
    own = np.arange(len(simulated))
    assert counting(simulated, "here").all()
    assert counting(together(simulated, elsewhere), "here")[own].all(), "measured cases elsewhere take nothing away"
    measured = cases(3, "here", "measured")
    found = counting(together(simulated, measured), "here")
    assert not found[own].any()
    assert found[len(simulated) :].all()


def test_simulated_cases_count_for_what_was_never_measured() -> None:
    measured, simulated = cases(4, "here", "measured"), cases(5, "here", "simulated")
    measured = measured.take(measured.labels != "play")
    table = together(measured, simulated)
    assert counting(table, "here").tolist() == ((table.origins == "measured") | (table.labels == "play")).tolist()


def test_cases_of_another_axis_count_where_they_are_alike() -> None:
    """Where its own cases say that a notch looks otherwise there, they do not."""
    own = cases(6, "here", "measured", shift=2.5)
    like, other = (cases(7, "elsewhere", "measured", boxes=12, shift=2.5, turned=turned) for turned in (0, 1))
    assert counting(together(own, like), "here").all()
    assert counting(together(own, other), "here").tolist() == [True] * len(own) + [False] * len(other)


def test_an_axis_that_nobody_named_has_all_cases() -> None:
    assert counting(together(cases(8, "a", "measured"), cases(9, "b", "measured")), None).all()


def test_a_library_of_one_label_names_none_for_sure() -> None:
    table = cases(10, "here", "measured")
    one = table.take(table.labels == "normal")
    assert fitted(one, "here") is None
    reasoner = Reasoner(one)
    for values in (one.values[0], one.values[0] + np.float32(50)):
        judgement = reasoner.judge(values, "here")
        assert judgement.best.probability < 0.9
        assert judgement.verdict() != "diagnosed"
        assert judgement.fault is None
    assert judgement.novel


@pytest.mark.parametrize("axis", ["here", "elsewhere"])
def test_an_axis_is_answered_by_its_own_cases(axis: str) -> None:
    """What marks a notch at one axis marks nothing at the other."""
    table = together(cases(11, "here", "measured"), cases(12, "elsewhere", "measured", turned=2))
    reasoner, own = Reasoner(table), table.axes == axis
    asked = cases(13, axis, "measured", turned=0 if axis == "here" else 2)
    said = [reasoner.judge(values, axis).best.label for values in asked.values]
    assert np.mean(np.array(said) == asked.labels) >= 0.9
    assert reasoner.model(axis).counting[own].all()
