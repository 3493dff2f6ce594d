"""Measured recordings of gearboxes that the library has never seen; skipped where the data are not."""

import csv
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from casebase.description import Labelling, RecordingDescription
from casebase.library import CaseLibrary
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.evaluation import Evaluation, evaluate
from casebase.search.case_table import CaseTable, load_table
from signals.condition import OperatingCondition
from signals.features import EXTRACTOR_VERSION, extract
from signals.reading.decode import read_recording
from tests.shared_data import shared


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> CaseLibrary:
    """A library of all recordings of the manifest."""
    folder = shared("data", "axis_recordings")
    library = CaseLibrary.open(tmp_path_factory.mktemp("measured"))
    with (folder / "manifest.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            take(library, folder, row)
    return library


def take(library: CaseLibrary, folder: Path, row: dict[str, str]) -> None:
    """Decode, extract, store and retain one recording."""
    recording = read_recording(folder / row["file"])
    condition = OperatingCondition(speed_rad_s=float(row["speed_rad_s"]), payload_kg_m2=float(row["payload_kg_m2"]))
    description = RecordingDescription(row["file"], axis="axis-a", gearbox=row["gearbox"], condition=condition)
    with library.transaction("admin") as session:
        stored = library.retain.recording(
            session, folder / row["file"], recording, extract(recording, condition), description
        )
        library.retain.case(session, stored, Labelling(row["label"], verified_by="made so"))


@pytest.fixture(scope="module")
def table(filled: CaseLibrary) -> CaseTable:
    """All cases."""
    with filled.reading() as session:
        return load_table(session, EXTRACTOR_VERSION)


@pytest.fixture(scope="module")
def evaluation(table: CaseTable) -> Evaluation:
    """The library's cross-validation."""
    return evaluate(table)


def test_gearboxes_never_seen_are_diagnosed(evaluation: Evaluation) -> None:
    assert evaluation.gearboxes == 5
    assert evaluation.cases == 30
    assert evaluation.accuracy.value is not None
    assert evaluation.accuracy.value >= 0.95


def test_a_fault_that_is_not_in_the_library_is_called_new_and_known_ones_are_not(evaluation: Evaluation) -> None:
    assert (evaluation.called_new.value or 0.0) <= 0.05
    for label in ("notch", "play"):
        share = evaluation.left_out[label].value
        assert share is not None
        assert share >= 0.9


@pytest.mark.parametrize(("boxes", "least"), [(2, 0.85), (4, 0.95)])
def test_so_many_other_gearboxes_are_enough_for_most(table: CaseTable, boxes: int, least: float) -> None:
    """The most probable label, over every choice of gearboxes that are known."""
    right = []
    for chosen in combinations(np.unique(table.gearboxes), boxes):
        inside = np.isin(table.gearboxes, chosen)
        reasoner, tested = Reasoner(table.take(inside)), table.take(~inside)
        said = [reasoner.judge(values, "axis-a").best.label for values in tested.values]
        right += [one == truth for one, truth in zip(said, tested.labels, strict=True)]
    assert np.mean(right) >= least


def said_by(table: CaseTable, boxes: int) -> list[tuple[str, bool]]:
    """Return verdict and whether the label is right, of every gearbox by so many that follow it in the circle."""
    names = np.unique(table.gearboxes)
    found = []
    for place, gearbox in enumerate(names):
        known = table.take(np.isin(table.gearboxes, np.roll(names, -place - 1)[:boxes]))
        reasoner, tested = Reasoner(known), table.take(table.gearboxes == gearbox)
        for values, truth in zip(tested.values, tested.labels, strict=True):
            judgement = reasoner.judge(values, "axis-a", str(gearbox))
            found.append((judgement.verdict(), judgement.best.label == truth))
    return found


@pytest.mark.parametrize(("boxes", "least"), [(2, 20), (4, 26)])
def test_most_are_said_right_and_none_wrong(table: CaseTable, boxes: int, least: int) -> None:
    said = [right for verdict, right in said_by(table, boxes) if verdict == "diagnosed"]
    assert sum(said) >= least
    assert all(said)


def test_libraries_whose_gearboxes_nobody_noted_do_as_well(table: CaseTable) -> None:
    """Every case then counts as of a gearbox of its own."""
    unnoted = np.zeros_like(table.gearboxes)
    right, called_new, found = [], [], []
    for gearbox in np.unique(table.gearboxes):
        inside = table.gearboxes != gearbox
        for missing in (None, "notch", "play"):
            rows = inside & (table.labels != (missing or ""))
            blank = replace(table, gearboxes=unnoted).take(rows)
            reasoner = Reasoner(blank)
            tested = table.take(~inside & ((table.labels == missing) | (missing is None)))
            for values, truth in zip(tested.values, tested.labels, strict=True):
                judgement = reasoner.judge(values, "axis-a")
                if missing is None:
                    right.append(judgement.best.label == truth)
                    called_new.append(judgement.novel)
                else:
                    found.append(judgement.novel)
    assert np.mean(right) >= 0.95
    assert np.mean(called_new) <= 0.05
    assert np.mean(found) >= 0.9
