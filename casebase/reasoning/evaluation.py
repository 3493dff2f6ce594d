"""How well the library diagnoses recordings of gearboxes that it has never seen; and what it has never seen at all."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.errors import InvalidRequestError
from casebase.reasoning.diagnosis import Judgement, Reasoner
from casebase.reasoning.novelty import spread_out
from casebase.search.case_table import CaseTable, Mask
from casebase.store.models import Case, StoredRecording
from signals.recording_quality.quality import FlagLevel

COVERAGE = 0.95
FOLDS = 10
MOST_TESTED = 400
RIGHT = (
    "the answer is the case's label: an ambiguous answer counts by its most probable label, and not_in_library is "
    "never right of a class that the library has"
)
GROUPS = ("gearbox", "axis", "case")


@dataclass(frozen=True)
class Proportion:
    """A share with its interval.

    Source: Wilson, Probable inference, JASA 22 (1927).
    """

    right: int
    of: int

    @property
    def value(self) -> float | None:
        """The share itself; None of nothing."""
        return self.right / self.of if self.of else None

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval; 0 and 1 of nothing."""
        if not self.of:
            return 0.0, 1.0
        z = float(special.ndtri(0.5 + COVERAGE / 2))
        share, size = self.right / self.of, self.of
        middle = (share + z * z / (2 * size)) / (1 + z * z / size)
        half = z / (1 + z * z / size) * np.sqrt(share * (1 - share) / size + z * z / (4 * size * size))
        low, high = float(middle - half), float(middle + half)
        return (0.0 if self.right == 0 else low), (1.0 if self.right == self.of else high)

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        low, high = self.interval
        return {"value": self.value, "right": self.right, "of": self.of, "low": low, "high": high}


@dataclass(frozen=True)
class Outcome:
    """What was said of one case when its group was left out of the library."""

    case_id: str
    origin: str
    group: str
    truth: str
    best: str
    verdict: str
    probability: float

    @property
    def answer(self) -> str:
        """What counts as said: `not_in_library` where that was the verdict, else the most probable label."""
        return self.verdict if self.verdict == "not_in_library" else self.best

    @property
    def right(self) -> bool:
        """Whether the answer is the true label; of a known class `not_in_library` never is."""
        return self.answer == self.truth


@dataclass(frozen=True)
class Evaluation:
    """The library's own cross-validation.

    Args:
        accuracy: cases whose answer is their label, the diagonal of `confusion`: see RIGHT.
        said: of those called `diagnosed`, how many were right.
        called_new: cases of known classes called `not_in_library`.
        cases: how many were diagnosed.
        known: how many cases the library was, those that were left out included.
        confusion: true label -> answered label -> case ids; `not_in_library` is a column.
        left_out: per class, how many of its cases are called new by a library without that class.
        without_simulated: the same cases by the measured ones alone; None unless simulated ones were learned from too.
    """

    group: str
    origin: str
    cases: int
    known: int
    gearboxes: int
    accuracy: Proportion
    said: Proportion
    called_new: Proportion
    per_class: Mapping[str, Proportion]
    confusion: Mapping[str, Mapping[str, tuple[str, ...]]]
    left_out: Mapping[str, Proportion]
    outcomes: tuple[Outcome, ...]
    without_simulated: "Evaluation | None" = None

    def figures(self) -> dict[str, object]:
        """Return how often it is right, and both figures of novelty, as JSON."""
        return {
            "accuracy": self.accuracy.to_document(),
            "known_called_new": self.called_new.to_document(),
            "left_out_class_called_new": {label: each.to_document() for label, each in self.left_out.items()},
        }

    def to_document(self) -> dict[str, object]:
        """Return it as JSON; `confusion` holds counts, `cells` the case ids behind them."""
        return {
            "group": self.group,
            "origin": self.origin,
            "cases": self.cases,
            "known_cases": self.known,
            "gearboxes": self.gearboxes,
            "right_means": RIGHT,
            **self.figures(),
            "accuracy_when_diagnosed": self.said.to_document(),
            "per_class": {label: each.to_document() for label, each in self.per_class.items()},
            "confusion": {
                truth: {answer: len(ids) for answer, ids in row.items()} for truth, row in self.confusion.items()
            },
            "cells": {
                truth: {answer: list(ids) for answer, ids in row.items()} for truth, row in self.confusion.items()
            },
            "without_simulated": None if self.without_simulated is None else self.without_simulated.figures(),
        }


def evaluate(
    table: CaseTable,
    *,
    group: str = "gearbox",
    origin: str = "both",
    axis: str | None = None,
    poor: Collection[str] = (),
) -> Evaluation:
    """Leave out one gearbox at a time and diagnose it by the other cases; then the same without its label.

    Every case is judged as a diagnosis judges it: by its axis and gearbox, and its quality. More than twenty gearboxes
    are left out in tenths.

    Args:
        table: the cases.
        group: what is left out together: gearbox, axis or case.
        origin: `measured` or `simulated` learns from such cases alone, `both` from all. Measured cases are what is
            diagnosed wherever there are any.
        axis: diagnosed are the cases of this axis alone, measured and simulated ones; the same without simulated cases
            is then not asked.
        poor: ids of cases whose recordings are too poor to be diagnosed.

    Raises:
        InvalidRequestError: if the group or origin is not known.
    """
    if group not in GROUPS:
        raise InvalidRequestError(f"group must be one of {', '.join(GROUPS)}, got {group!r}")
    if origin not in ("measured", "simulated", "both"):
        raise InvalidRequestError(f"origin must be measured, simulated or both, got {origin!r}")
    usable = np.ones(len(table), bool) if origin == "both" else table.origins == origin
    names, tested = _names(table, group), _tested(table, group, axis)
    outcomes: list[Outcome] = []
    found: dict[str, list[bool]] = {label: [] for label in table.classes}
    for held_out in _held_out(table, group, tested):
        inside = usable & ~held_out & ~np.isin(table.sounds, table.sounds[tested & held_out])
        outcomes += _outcomes(table, inside, tested & held_out, names, frozenset(poor))
        for label in table.classes:
            found[label] += _called_new(table, inside & (table.labels != label), tested & held_out, label)
    result = _evaluation(table, group, origin, tuple(outcomes), found)
    if axis is not None or origin != "both" or np.unique(table.origins).size < 2:
        return result
    return replace(result, without_simulated=evaluate(table, group=group, origin="measured", poor=poor))


def poor_recordings(session: Session) -> frozenset[str]:
    """Return ids of the cases whose recordings have a flaw for which no label is relied on."""
    statement = select(Case.id, StoredRecording.quality).join(StoredRecording, StoredRecording.id == Case.recording_id)
    return frozenset(
        identity
        for identity, quality in session.execute(statement)
        if any(isinstance(flag, Mapping) and flag["severity"] != FlagLevel.NOTE for flag in quality)
    )


def _tested(table: CaseTable, group: str, axis: str | None) -> Mask:
    """Return what is diagnosed, at most MOST_TESTED of it, evenly spread: measured cases where there are any.

    Of an axis it is its own cases, measured ones and as many simulated ones.
    """
    measured, named = table.origins == "measured", _names(table, group) != ""
    if axis is None:
        kinds = [(measured if measured.any() else np.ones(len(table), bool)) & named]
    else:
        own = named & (table.axes == axis)
        kinds = [own & measured, own & ~measured]
    tested = np.zeros(len(table), bool)
    for wanted in kinds:
        tested[spread_out(np.flatnonzero(wanted), MOST_TESTED)] = True
    return tested


def _held_out(table: CaseTable, group: str, tested: Mask) -> list[Mask]:
    """Return what is left out together: one gearbox or axis at a time, parts of them where they are many."""
    if group == "gearbox":
        return [table.parts == part for part in np.unique(table.parts[tested])]
    names = _names(table, group)
    groups = np.unique(names[tested])
    count = min(groups.size, FOLDS)
    return [np.isin(names, groups[start::count]) for start in range(count)]


def _names(table: CaseTable, group: str) -> NDArray[np.str_]:
    if group == "gearbox":
        return table.groups
    return table.axes if group == "axis" else table.ids


def _outcomes(
    table: CaseTable, inside: Mask, tested: Mask, names: NDArray[np.str_], poor: Collection[str]
) -> list[Outcome]:
    """Return what a library of the cases inside says of the tested ones."""
    return [
        Outcome(
            str(table.ids[row]),
            str(table.origins[row]),
            str(names[row]),
            str(table.labels[row]),
            judgement.best.label,
            judgement.verdict(str(table.ids[row]) in poor),
            judgement.best.probability,
        )
        for row, judgement in _judged(table, inside, tested)
    ]


def _called_new(table: CaseTable, inside: Mask, tested: Mask, label: str) -> list[bool]:
    """Return whether a library of the cases inside, which has no such label, calls the tested ones of it new."""
    return [judgement.novel for _, judgement in _judged(table, inside, tested & (table.labels == label))]


def _judged(table: CaseTable, inside: Mask, tested: Mask) -> list[tuple[int, Judgement]]:
    if not inside.any() or not tested.any():
        return []
    reasoner = Reasoner(table.take(inside))
    rows = np.flatnonzero(tested).tolist()
    return [
        (row, reasoner.judge(table.values[row], table.axes[row] or None, table.gearboxes[row] or None)) for row in rows
    ]


def _evaluation(
    table: CaseTable, group: str, origin: str, outcomes: tuple[Outcome, ...], found: Mapping[str, list[bool]]
) -> Evaluation:
    right = [each.right for each in outcomes]
    said = [each.right for each in outcomes if each.verdict == "diagnosed"]
    new = [each.verdict == "not_in_library" for each in outcomes]
    confusion: dict[str, dict[str, tuple[str, ...]]] = {}
    for each in outcomes:
        row = confusion.setdefault(each.truth, {})
        row[each.answer] = (*row.get(each.answer, ()), each.case_id)
    per_class = {label: _share([each.right for each in outcomes if each.truth == label]) for label in table.classes}
    return Evaluation(
        group,
        origin,
        len(outcomes),
        len(table),
        len(table.take(np.isin(table.ids, [each.case_id for each in outcomes])).gearboxes_known),
        _share(right),
        _share(said),
        _share(new),
        per_class,
        confusion,
        {label: _share(answers) for label, answers in found.items()},
        outcomes,
    )


def _share(answers: list[bool]) -> Proportion:
    return Proportion(sum(answers), len(answers))
