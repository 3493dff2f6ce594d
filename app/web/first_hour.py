"""The first hour on an axis in words: which step is next, how well the library does, what would make it better."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from sqlalchemy.orm import Session

from app.jobs.job import Job
from app.report.formatting import in_series, name_of, percent, sentence
from app.report.words import CALIBRATED_FROM
from app.service import Service
from casebase.labels import BASELINES
from casebase.origins import MEASURED, SIMULATED
from casebase.reasoning.evaluation import Evaluation, Proportion
from casebase.search.axis_cases import LabelCases, Taken, cases_of_axes
from casebase.store.models import AxisRevision
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import LABELS, obstacle

ENOUGH = 5
"""Fewest recordings of which it is no chance that all are answered rightly: heads or tails does it once in 32 times,
less often than once in twenty (the sign test)."""
NUMBERS = ("no", "one", "two", "three", "four", "five")


class Advice(NamedTuple):
    """What would make the library better on an axis: a sentence on what to do, why, and where (below the root)."""

    do: str
    why: str
    path: str = ""
    link: str = ""


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


class Step(NamedTuple):
    """One step: whether it is done, and its result in a sentence."""

    key: str
    title: str
    done: bool
    result: str


@dataclass(frozen=True)
class Hour:
    """Where the first hour on an axis stands.

    Args:
        axis: its description; None where it is not described.
        obstacles: the usual labels, each with why no case of it can be simulated; None where it can.
        cases: by label.
        taken: the newest measured recordings.
        job: the newest simulation of its cases.
        evaluation: of its held-out cases; None while that is being worked out.
        gearboxes: measured ones that the whole library knows.
    """

    name: str
    axis: AxisRevision | None
    obstacles: Mapping[str, str | None]
    cases: Mapping[str, LabelCases]
    taken: Sequence[Taken]
    job: Job | None
    evaluation: Evaluation | None
    gearboxes: int

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
    def labels(self) -> tuple[str, ...]:
        """Labels of its cases and those that can be simulated, good ones first."""
        return tuple(sorted({*self.cases, *self.obstacles}, key=lambda label: (label not in BASELINES, label)))

    @property
    def is_simulated(self) -> bool:
        """Whether all is simulated that there is of it; of an axis without gears that is nothing."""
        lacking = any(label not in self.cases for label in self.offered)
        return self.axis is not None and not lacking and not (self.obstacles and not self.offered)

    @property
    def is_simulating(self) -> bool:
        return self.job is not None and self.job.state in ("queued", "running")

    @property
    def poor(self) -> int:
        """How many of the newest recordings that were kept are poor."""
        flags = [one.recording.quality for one in self.taken if one.label]
        return sum(any(isinstance(flag, Mapping) and flag.get("severity") == "poor" for flag in of) for of in flags)

    @property
    def does_well(self) -> bool:
        """Whether its recordings are named rightly more often than not, beyond chance."""
        return _total(self.answers(MEASURED)).interval[0] > 0.5

    @property
    def is_asked(self) -> bool:
        """Whether it is being worked out how well the library does."""
        return self.evaluation is None and bool(self.known.measured or self.known.simulated)

    def answers(self, origin: str) -> tuple[Answers, ...]:
        """Return what became of the held-out cases of an origin, label by label; labels without any are left out."""
        outcomes = [one for one in self.evaluation.outcomes if one.origin == origin] if self.evaluation else []
        found = []
        for label in self.labels:
            own = [one for one in outcomes if one.truth == label]
            wrong = tuple(one.case_id for one in own if one.verdict == "diagnosed" and not one.right)
            count = Counter(one.verdict for one in own)
            right, undecided, unlike = count["diagnosed"] - len(wrong), count["ambiguous"], count["not_in_library"]
            found.append(Answers(label, right, len(own), undecided, unlike, wrong))
        return tuple(each for each in found if each.of)

    @property
    def steps(self) -> tuple[Step, ...]:
        """The four steps in their order."""
        return (
            Step("describe", "Describe the axis", self.axis is not None, described(self.axis)),
            Step("record", "Record its gearbox", self.known.measured > self.poor, recorded(self)),
            Step("simulate", "Simulate its cases", self.is_simulated, simulated(self)),
            Step("how-well", "How well does it do?", self.does_well, how_well(self)),
        )

    @property
    def next(self) -> Advice | None:
        """The one next thing to do; None where nothing is left."""
        if self.axis is None:
            return Advice("Describe the axis.", "Its teeth and inertias say what its faults sound like.", "#describe")
        if not self.known.measured:
            return Advice("Record its gearbox.", "One good recording is enough to go on with.", "#record")
        if self.is_simulating:
            return Advice("Wait for the simulation.", "The page goes on by itself.")
        if not self.is_simulated and self.offered:
            return Advice("Simulate its cases.", "It has none of faults that you could not record yet.", "#simulate")
        if self.is_asked and self.is_simulated:
            return Advice(
                "Wait for step 4, how well it does.", "It is being worked out, and the page goes on by itself."
            )
        return next(iter(self.advice), None)

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What would make the library better on this axis, what helps most first."""
        return (*_of_cases(self), *_of_answers(self), *_of_habits(self))


def obstacles(row: AxisRevision | None) -> Mapping[str, str | None]:
    """Return the usual labels, each with why the simulator can make no case of it for an axis; None where it can.

    Nothing is to be simulated of an axis that is not described, or has no gear stage.
    """
    axis = None if row is None else read_axis(row.document)
    return {label: obstacle(axis, label) for label in LABELS} if axis and axis.stages else {}


def axis_cases(service: Service, session: Session) -> Mapping[str | None, Mapping[str, LabelCases]]:
    """Return the cases of every axis by label, counted once for every version of the library."""
    return service.counted(session, "cases of axes", lambda: cases_of_axes(session))


def _units(gearboxes: Collection[str]) -> str:
    return counted(len(gearboxes), "gearbox", "gearboxes") if gearboxes else "gearboxes without a name"


def described(row: AxisRevision | None) -> str:
    """Say what the description of an axis has."""
    if row is None:
        return "It is not described yet."
    axis = read_axis(row.document)
    if not axis.stages:
        return f"Revision {row.revision}: a direct drive. It has no gear whose faults could be simulated."
    names = ", ".join(stage.name for stage in axis.stages)
    return f"Revision {row.revision}: {counted(len(axis.stages), 'gear stage')} ({names}), ratio {axis.ratio:.4g}."


def recorded(hour: Hour) -> str:
    """Say how much of the axis was recorded and kept."""
    if not hour.taken:
        return "No recording yet."
    if not hour.known.measured:
        return "It was recorded, but no recording is a case of the library yet: nobody said what the gearbox has."
    kept = [f"{each.measured} {name_of(label)}" for label, each in hour.cases.items() if each.measured]
    return f"{counted(hour.known.measured, 'measured case')} of {_units(hour.known.gearboxes)}: {in_series(kept)}."


def simulated(hour: Hour) -> str:
    """Say which cases were simulated for the axis."""
    made = [f"{each.simulated} {name_of(label)}" for label, each in hour.cases.items() if each.simulated]
    if hour.axis is not None and not hour.obstacles:
        return "Nothing to do: an axis without a gear stage has no such faults."
    words = (
        f"{counted(hour.known.simulated, 'simulated case')}: {in_series(made)}." if made else "No simulated case yet."
    )
    aside = hour.known.set_aside
    return f"{words} {aside} more lie far from your recordings and are not used." if aside else words


def how_well(hour: Hour) -> str:
    """Say how well the library does on the axis, no better than is known."""
    if not hour.known.measured and not hour.known.simulated:
        return "Nothing is known yet: the library has no case of this axis."
    if hour.evaluation is None:
        return "It is being worked out: each gearbox is left out once, and the library answers without it."
    real, made = hour.answers(MEASURED), hour.answers(SIMULATED)
    if not real:
        of_simulated = f"Of simulated gearboxes of this axis it names {_share(made)} rightly. " if made else ""
        why = (
            "without it the library has nothing to answer from, so it cannot be left out"
            if hour.known.measured
            else "none was recorded and kept"
        )
        return f"{of_simulated}How well it does on your gearbox is not known: {why}."
    low, high = _total(real).interval
    words = (
        f"With the gearbox held out, it names {_share(real)} of your recordings rightly. Of many more like them it "
        f"would be {percent(low)} to {percent(high)} (95 % interval)."
    )
    if all(each.label in BASELINES for each in real):
        words += " No fault was recorded here: whether it hears one is known from simulation alone."
        if made:
            words += f" Of simulated gearboxes it names {_share(made)} rightly."
    return words


def _total(answers: Sequence[Answers]) -> Proportion:
    return Proportion(sum(each.right for each in answers), sum(each.of for each in answers))


def _share(answers: Sequence[Answers]) -> str:
    total = _total(answers)
    return f"{total.right} of {total.of}"


def _of_cases(hour: Hour) -> Iterator[Advice]:
    """What description and recordings lack."""
    if hour.poor:
        yield Advice(
            f"Record again, as the check says, what is poor of the newest: {counted(hour.poor, 'recording')}.",
            "A poor recording adds its disturbance to the library.",
            "#record",
        )
    good = sum(each.measured for label, each in hour.cases.items() if label in BASELINES)
    units = sorted(hour.known.gearboxes)
    if good < ENOUGH:
        recordings = f"{'more ' if good else ''}normal recording{'' if ENOUGH - good == 1 else 's'}"
        yield Advice(
            f"Record {NUMBERS[ENOUGH - good]} {recordings} of {f'gearbox {units[0]}' if units else 'a good gearbox'}.",
            f"{NUMBERS[ENOUGH].capitalize()} right answers of {NUMBERS[ENOUGH]} are hardly chance; of fewer they may "
            "be.",
            "#record",
        )
    blocked = {name_of(label): why for label, why in hour.obstacles.items() if why is not None}
    if blocked:
        words = f"so that cases of {in_series(blocked)} can be simulated."
        yield Advice(f"Complete the description, {words}", sentence(next(iter(blocked.values()))), "#describe")
    if hour.known.measured and len(units) < CALIBRATED_FROM:
        calibrated = " Until the library knows two, it is not calibrated how sure an answer is."
        yield Advice(
            "Record a second gearbox of this axis, or of the same kind, if there is one.",
            "One gearbox does not show in what gearboxes differ."
            f"{calibrated if hour.gearboxes < CALIBRATED_FROM else ''}",
            "#record",
        )


def _of_answers(hour: Hour) -> Iterator[Advice]:
    """What its recordings were answered, each with its gearbox left out."""
    for each in hour.answers(MEASURED):
        if each.wrong:
            yield Advice(
                f"Look at {counted(len(each.wrong), 'case')} of {name_of(each.label)} that it names otherwise.",
                "The label is wrong, the recording is poor, or the library knows too little of this sound.",
                f"/cases/{each.wrong[0]}",
                "The first of them" if len(each.wrong) > 1 else "The case",
            )
        unnamed = each.undecided + each.unlike
        if unnamed and each.of >= ENOUGH:
            yield Advice(
                f"Record {name_of(each.label)} of another gearbox, in the same motion.",
                f"With their gearbox left out, {unnamed} of {each.of} get no name.",
                "#record",
            )


def _of_habits(hour: Hour) -> Iterator[Advice]:
    """What is to be done with every recording from now on."""
    unnamed, aside = hour.known.unnamed, hour.known.set_aside
    if unnamed:
        yield Advice(
            "Say with every recording which gearbox it is of.",
            f"{counted(unnamed, 'case')} name{'s' if unnamed == 1 else ''} none. Each counts as a gearbox of its own, "
            "so the figures look better than they are.",
        )
    if aside:
        yield Advice(
            "Fit the simulated sound to your place with gearcase fit, then simulate again.",
            f"{counted(aside, 'simulated case')} sound{'s' if aside == 1 else ''} unlike every recording of the label, "
            "so they are not used.",
        )
    known = {label for label, each in hour.cases.items() if each.measured}
    faults = [name_of(label) for label in hour.labels if label not in BASELINES and label not in known]
    if faults:
        yield Advice(
            f"When a gearbox of this axis has {in_series(faults, 'or')}, record it before the repair and keep it with "
            "that label.",
            "No such fault was recorded here: what the library knows of it is simulated or of other axes.",
            "#record",
        )


def counted(number: int, one: str, more: str = "") -> str:
    """Write a number of things.

    >>> counted(1, "case"), counted(2, "case"), counted(2, "gearbox", "gearboxes")
    ('1 case', '2 cases', '2 gearboxes')
    """
    return f"{number} {one if number == 1 else more or f'{one}s'}"
