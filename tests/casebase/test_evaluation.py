"""Evaluate: what is counted, with which interval, and what must not leak."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from casebase.reasoning.evaluation import Proportion, evaluate
from casebase.search.case_table import CaseTable
from tests.casebase import made

SIZE = 10
NAMES = (made.NAMES[2], *made.MARKS, *made.NAMES[3:9], "strongest_impulse_200_1000_hz")


def made_table(seed: int, gearboxes: int = 5, shift: float = 8.0, classes: int = 3) -> CaseTable:
    """Return two cases per class and gearbox; class c > 0 is marked in feature c; feature 9 knows the gearbox."""
    generator = np.random.default_rng(seed)
    values, labels, serials = [], [], []
    for gearbox in range(gearboxes):
        for kind in [*range(classes)] * 2:
            row = generator.normal(size=SIZE)
            row[kind] += shift * (kind > 0)
            row[9] = 20.0 * gearbox + 0.01 * row[9]
            values.append(row)
            labels.append(("normal", "notch", "play")[kind])
            serials.append(f"g{gearbox}")
    return table_of(np.array(values), labels, serials)


def table_of(values: NDArray[np.float64], labels: list[str], gearboxes: list[str]) -> CaseTable:
    """Return a table of measured cases."""
    return made.measured_table(NAMES, values, labels, [int(box[1:]) for box in gearboxes], "a")


@pytest.mark.parametrize(("right", "of"), [(0, 10), (5, 10), (10, 10), (29, 30)])
def test_wilson_interval_solves_its_equation(right: int, of: int) -> None:
    low, high = Proportion(right, of).interval
    for bound in (low, high):
        if 0 < bound < 1:
            deviation = abs(right / of - bound) / np.sqrt(bound * (1 - bound) / of)
            assert deviation == pytest.approx(1.959964, abs=1e-5)
    assert low <= right / of <= high


def test_classes_far_apart_are_found_in_unseen_gearboxes() -> None:
    result = evaluate(made_table(1))
    assert result.accuracy.value is not None
    assert result.accuracy.value >= 0.9
    assert result.gearboxes == 5
    assert result.cases == 30
    document = result.to_document()
    assert sum(sum(row.values()) for row in document["confusion"].values()) == 30  # type: ignore[attr-defined]


def test_a_gearbox_never_votes_for_itself() -> None:
    """Labels that are drawn per gearbox can be recited by anyone who has seen the gearbox, and by nobody else."""
    generator = np.random.default_rng(3)
    values = np.repeat(generator.normal(size=(8, SIZE)) * 50, 3, axis=0) + generator.normal(size=(24, SIZE)) * 0.01
    labels = np.repeat(generator.permutation(["normal", "notch"] * 4), 3).tolist()
    table = table_of(values, labels, [f"g{row // 3}" for row in range(24)])
    by_gearbox, by_case = evaluate(table), evaluate(table, group="case")
    assert by_case.accuracy.value is not None
    assert by_case.accuracy.value >= 0.9
    assert by_gearbox.accuracy.value is not None
    assert by_gearbox.accuracy.value < 0.85


def test_a_class_left_out_is_called_new_more_often_than_known_ones() -> None:
    result = evaluate(made_table(2, shift=12.0))
    assert result.called_new.value is not None
    assert result.called_new.value <= 0.1
    for share in result.left_out.values():
        if share.of:
            assert share.value is not None
    assert (result.left_out["notch"].value or 0) >= 0.8


def test_simulated_cases_are_learned_from_but_not_tested_where_there_are_measured_ones() -> None:
    table = made_table(4)
    origins = table.origins.astype("U9")
    origins[np.isin(table.gearboxes, ["g0", "g1"])] = "simulated"
    mixed = CaseTable(1, "made", table.names, table.ids, table.labels, origins, *table.text[3:], table.values)
    for origin in ("measured", "simulated", "both"):
        found = evaluate(mixed, origin=origin)
        assert (found.cases, found.gearboxes) == (18, len(set(table.gearboxes) - {"g0", "g1"}))


def joined(measured: CaseTable, simulated: CaseTable) -> CaseTable:
    """Return one table of measured and simulated cases."""
    count = len(measured) + len(simulated)
    ids = np.array([f"{row:032x}" for row in range(count)])
    origins = np.where(np.arange(count) < len(measured), "measured", "simulated")
    labels, axes = (np.concatenate([getattr(t, name) for t in (measured, simulated)]) for name in ("labels", "axes"))
    gearboxes = np.concatenate([measured.gearboxes, np.full(len(simulated), "")])
    values = np.concatenate([measured.values, simulated.values])
    return CaseTable(1, "made", measured.names, ids, labels, origins, axes, gearboxes, ids, values)


@pytest.mark.parametrize("spoilt", [1.0, 4.0])
def test_simulated_cases_change_neither_figure_of_novelty(spoilt: float) -> None:
    """Simulated cases with wrong labels, scattered over what no gearbox has shown."""
    measured, simulated = made_table(12, gearboxes=4, shift=8.0), made_table(13, gearboxes=3)
    wrong = replace(
        simulated, labels=np.roll(simulated.labels, 1), values=(spoilt * simulated.values).astype(np.float32)
    )
    found = evaluate(joined(measured, wrong))
    without = found.without_simulated
    assert without is not None
    assert without == evaluate(joined(measured, wrong), origin="measured")
    assert found.left_out == without.left_out
    assert found.called_new == without.called_new
    assert found.accuracy.right >= without.accuracy.right
    assert any(share.right for share in found.left_out.values())


def test_of_an_axis_its_own_cases_are_asked_measured_and_simulated_ones() -> None:
    table = joined(made_table(1, gearboxes=3), made_table(2, gearboxes=3))
    table = replace(table, axes=np.where(np.arange(len(table)) % 2, "b", "a"))
    found = evaluate(table, axis="b")
    assert {one.case_id for one in found.outcomes} == set(table.ids[table.axes == "b"].tolist())
    assert {one.origin for one in found.outcomes} == {"measured", "simulated"}
    assert not evaluate(table, axis="nobody's").outcomes


def test_probabilities_are_calibrated_on_unseen_gearboxes() -> None:
    """Over many small libraries, recordings said with a mean probability are right that often, within 0.15."""
    said, right = [], []
    for seed in range(3):
        outcomes = evaluate(made_table(seed, shift=3.0)).outcomes
        said += [each.probability for each in outcomes]
        right += [each.best == each.truth for each in outcomes]
    assert np.mean(said) == pytest.approx(np.mean(right), abs=0.15)
