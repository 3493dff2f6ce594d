"""Where the first hour on an axis stands: which step is next, how well the library does, what would make it better."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from sqlalchemy.orm import Session

from app.jobs.job import Job
from app.report.formatting import name_of
from app.report.words import CALIBRATED_FROM
from app.service import Service
from casebase.labels import BASELINES
from casebase.origins import MEASURED, SIMULATED
from casebase.reasoning.evaluation import Evaluation, Proportion
from casebase.search.axis_cases import LabelCases, Taken, cases_of_axes
from casebase.store.models import AxisRevision
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import LABELS, obstacle

ENOUGH = 5
"""Fewest recordings of which it is no chance that all are answered rightly: heads or tails does it once in 32 times,
less often than once in twenty (the sign test)."""


class Answers(NamedTuple):
    """What became of held-out cases of one label and origin.

    `right` of all were named, and rightly; `undecided` and `unlike` (not in the library) were not named; `wrong` are
    the cases that were named wrongly.
    """

    label: str
    right: int
    of: int
    undecided: int
    unlike: int
    wrong: tuple[str, ...]


class Advice(NamedTuple):
    """What would make the library better on an axis, and where (below the root); `of` answers, if they say so.

    Its sentences stand in _hour.html.
    """

    kind: str
    path: str = ""
    of: Answers | None = None


@dataclass(frozen=True)
class Hour:
    """Where the first hour on an axis stands.

    Args:
        axis: its description; None where it is not described.
        cases: by label.
        taken: the newest measured recordings.
        job: the newest simulation of its cases.
        evaluation: of its held-out cases; None while that is being worked out.
        gearboxes: measured ones that the whole library knows.
    """

    axis: AxisRevision | None
    cases: Mapping[str, LabelCases]
    taken: Sequence[Taken]
    job: Job | None
    evaluation: Evaluation | None
    gearboxes: int

    @cached_property
    def description(self) -> Axis | None:
        return None if self.axis is None else read_axis(self.axis.document)

    @cached_property
    def obstacles(self) -> Mapping[str, str | None]:
        return obstacles(self.axis)

    @cached_property
    def known(self) -> LabelCases:
        """Its cases of all labels together."""
        every = self.cases.values()
        return LabelCases(
            sum(each.measured for each in every),
            sum(each.unnamed for each in every),
            frozenset[str]().union(*(each.gearboxes for each in every)),
            sum(each.simulated for each in every),
            sum(each.set_aside for each in every),
        )

    @property
    def offered(self) -> tuple[str, ...]:
        """Labels whose cases can be simulated."""
        return tuple(label for label, why in self.obstacles.items() if why is None)

    @property
    def blocked(self) -> Mapping[str, str]:
        """Names of the others, each with what the description lacks."""
        return {name_of(label): why for label, why in self.obstacles.items() if why is not None}

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of its cases and those that can be simulated, good ones first."""
        return tuple(sorted({*self.cases, *self.obstacles}, key=lambda label: (label not in BASELINES, label)))

    @property
    def faults(self) -> list[str]:
        """Names of those that were never recorded here."""
        known = {*BASELINES, *(label for label, each in self.cases.items() if each.measured)}
        return [name_of(label) for label in self.labels if label not in known]

    def of_labels(self, origin: str) -> list[str]:
        """How many cases of an origin each label has, in words."""
        counts = {label: int(getattr(each, origin)) for label, each in self.cases.items()}
        return [f"{count} {name_of(label)}" for label, count in counts.items() if count]

    @property
    def done(self) -> Mapping[str, bool]:
        """The four steps in their order, and which are done."""
        lacking = any(label not in self.cases for label in self.offered)
        return {
            "describe": self.axis is not None,
            "record": self.known.measured > self.poor,
            # of an axis without gears nothing is to be simulated
            "simulate": self.axis is not None and not lacking and not (self.obstacles and not self.offered),
            "how-well": self.total(MEASURED).interval[0] > 0.5,  # more often right than not, beyond chance
        }

    @property
    def is_simulating(self) -> bool:
        return self.job is not None and self.job.state in ("queued", "running")

    @property
    def poor(self) -> int:
        """How many of the newest recordings that were kept are poor."""
        flags = [one.recording.quality for one in self.taken if one.label]
        return sum(any(isinstance(flag, Mapping) and flag.get("severity") == "poor" for flag in of) for of in flags)

    @property
    def good(self) -> int:
        """How many measured cases of a good gearbox there are."""
        return sum(each.measured for label, each in self.cases.items() if label in BASELINES)

    @property
    def lacking(self) -> int:
        """How many more of them are enough."""
        return max(0, ENOUGH - self.good)

    @property
    def is_calibrated(self) -> bool:
        """Whether the library knows enough gearboxes for how sure it is to be calibrated."""
        return self.gearboxes >= CALIBRATED_FROM

    @property
    def is_asked(self) -> bool:
        """Whether it is being worked out how well the library does."""
        return self.evaluation is None and bool(self.known.measured or self.known.simulated)

    @cached_property
    def answers(self) -> Mapping[str, Mapping[str, Answers]]:
        """What became of the held-out cases, by origin and label; labels without any are left out."""
        found: dict[str, dict[str, Answers]] = {MEASURED: {}, SIMULATED: {}}
        outcomes = self.evaluation.outcomes if self.evaluation else ()
        for origin, label in ((origin, label) for origin in found for label in self.labels):
            own = [one for one in outcomes if (one.origin, one.truth) == (origin, label)]
            wrong = tuple(one.case_id for one in own if one.verdict == "diagnosed" and not one.right)
            count = Counter(one.verdict for one in own)
            right, undecided, unlike = count["diagnosed"] - len(wrong), count["ambiguous"], count["not_in_library"]
            if own:
                found[origin][label] = Answers(label, right, len(own), undecided, unlike, wrong)
        return found

    def total(self, origin: str) -> Proportion:
        """How many of the held-out cases of an origin were named rightly."""
        answers = self.answers[origin].values()
        return Proportion(sum(each.right for each in answers), sum(each.of for each in answers))

    @property
    def next(self) -> Advice | None:
        """The one next thing to do; None where nothing is left."""
        is_simulated = self.done["simulate"]
        if self.axis is None:
            return Advice("describe", "#describe")
        if not self.known.measured:
            return Advice("record", "#record")
        if self.is_simulating:
            return Advice("simulating")
        if not is_simulated and self.offered:
            return Advice("simulate", "#simulate")
        if self.is_asked and is_simulated:
            return Advice("evaluating")
        return next(iter(self.advice), None)

    @cached_property
    def advice(self) -> tuple[Advice, ...]:
        """What would make the library better on this axis, what helps most first."""
        known = self.known
        found = [Advice("poor", "#record")] if self.poor else []
        found += [Advice("normal", "#record")] if self.lacking else []
        found += [Advice("complete", "#describe")] if self.blocked else []
        found += [Advice("second", "#record")] if known.measured and len(known.gearboxes) < CALIBRATED_FROM else []
        for each in self.answers[MEASURED].values():
            found += [Advice("wrong", f"/cases/{each.wrong[0]}", each)] if each.wrong else []
            found += [Advice("unnamed", "#record", each)] if each.undecided + each.unlike and each.of >= ENOUGH else []
        found += [Advice("name")] if known.unnamed else []
        found += [Advice("fit")] if known.set_aside else []
        return (*found, *([Advice("fault", "#record")] if self.faults else []))


def obstacles(row: AxisRevision | None) -> Mapping[str, str | None]:
    """Return the usual labels, each with why the simulator can make no case of it for an axis; None where it can.

    Nothing is to be simulated of an axis that is not described, or has no gear stage.
    """
    axis = None if row is None else read_axis(row.document)
    return {label: obstacle(axis, label) for label in LABELS} if axis and axis.stages else {}


def axis_cases(service: Service, session: Session) -> Mapping[str | None, Mapping[str, LabelCases]]:
    """Return the cases of every axis by label, counted once for every version of the library."""
    return service.counted(session, "cases of axes", lambda: cases_of_axes(session))
