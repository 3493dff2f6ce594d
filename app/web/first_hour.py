"""The first hour on an axis in words: which step is next, how well the library does, what would make it better."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from app.jobs.job import Job
from app.report.formatting import percent, sentence
from app.report.words import CALIBRATED_FROM, name_of
from app.service import Service
from app.web.counted import counted as kept_count
from casebase.labels import BASELINES
from casebase.origins import MEASURED, SIMULATED
from casebase.reasoning.evaluation import Evaluation, Outcome, Proportion
from casebase.search.axis_cases import LabelCases, Taken, cases_of_axes
from casebase.store.models import AxisRevision, StoredRecording
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import LABELS, obstacle

ENOUGH = 5
"""Fewest recordings of which it is no chance that all are answered rightly: heads or tails does it once in 32 times,
less often than once in twenty (the sign test)."""


@dataclass(frozen=True)
class Advice:
    """What would make the library better on an axis: a sentence on what to do, why, and where (below the root)."""

    do: str
    why: str
    path: str = ""
    link: str = ""


@dataclass(frozen=True)
class Answers:
    """What became of held-out cases of one label and origin."""

    label: str
    outcomes: tuple[Outcome, ...]

    def _count(self, verdict: str) -> int:
        return sum(one.verdict == verdict for one in self.outcomes)

    @property
    def right(self) -> int:
        """How many were named, and rightly."""
        return sum(one.verdict == "diagnosed" and one.right for one in self.outcomes)

    @property
    def undecided(self) -> int:
        return self._count("ambiguous")

    @property
    def unlike(self) -> int:
        """How many were called not in the library."""
        return self._count("not_in_library")

    @property
    def wrong(self) -> tuple[str, ...]:
        """The cases that were named wrongly."""
        return tuple(one.case_id for one in self.outcomes if one.verdict == "diagnosed" and not one.right)

    @property
    def share(self) -> Proportion:
        """How many were named rightly, of all."""
        return Proportion(self.right, len(self.outcomes))


@dataclass(frozen=True)
class Step:
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

    @property
    def measured(self) -> int:
        """Measured cases."""
        return sum(each.measured for each in self.cases.values())

    @property
    def simulated(self) -> int:
        """Simulated cases in use."""
        return sum(each.simulated for each in self.cases.values())

    @property
    def offered(self) -> tuple[str, ...]:
        """Labels whose cases can be simulated."""
        return tuple(label for label, why in self.obstacles.items() if why is None)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of its cases and those that can be simulated, good ones first."""
        known = {*self.cases, *self.obstacles}
        return tuple(sorted(known, key=lambda label: (label not in BASELINES, label)))

    @property
    def lacking(self) -> tuple[str, ...]:
        """Labels that can be simulated and have no case at all."""
        return tuple(label for label in self.offered if not _known(self.cases.get(label)))

    @property
    def is_simulated(self) -> bool:
        """Whether all is simulated that there is of it; of an axis without gears that is nothing."""
        return self.axis is not None and not self.lacking and not (self.obstacles and not self.offered)

    @property
    def is_simulating(self) -> bool:
        return self.job is not None and self.job.state in ("queued", "running")

    @property
    def is_asked(self) -> bool:
        """Whether it is being worked out how well the library does."""
        return self.evaluation is None and bool(self.measured or self.simulated)

    def answers(self, origin: str) -> tuple[Answers, ...]:
        """Return what became of the held-out cases of an origin, label by label; labels without any are left out."""
        outcomes = self.evaluation.outcomes if self.evaluation else ()
        found = (
            Answers(label, tuple(one for one in outcomes if one.origin == origin and one.truth == label))
            for label in self.labels
        )
        return tuple(each for each in found if each.outcomes)

    @property
    def steps(self) -> tuple[Step, ...]:
        """The four steps in their order."""
        return (
            Step("describe", "Describe the axis", self.axis is not None, described(self.axis)),
            Step("record", "Record its gearbox", self.measured > 0, recorded(self)),
            Step("simulate", "Simulate its cases", self.is_simulated, simulated(self)),
            Step("how-well", "How well does it do?", bool(self.measured and self.evaluation), how_well(self)),
        )

    @property
    def next(self) -> Advice | None:
        """The one next thing to do; None where nothing is left."""
        if self.axis is None:
            return Advice("Describe the axis.", "Its teeth and inertias say what its faults sound like.", "#describe")
        if not self.measured:
            return Advice("Record its gearbox.", "One good recording is enough to go on with.", "#record")
        if self.is_simulating:
            return Advice("Wait for the simulation.", "The page goes on by itself.")
        if self.obstacles and not self.offered:
            return completed(self.obstacles)[0]
        if self.lacking:
            return Advice("Simulate its cases.", "It has none of faults that you could not record yet.", "#simulate")
        if self.is_asked:
            return Advice("Wait for the fourth step.", "It is being worked out, and the page goes on by itself.")
        return next(iter(self.advice), None)

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What would make the library better on this axis, what helps most first."""
        return advice(self)


def _known(cases: LabelCases | None) -> bool:
    return cases is not None and bool(cases.measured or cases.simulated or cases.set_aside)


def obstacles(row: AxisRevision | None) -> Mapping[str, str | None]:
    """Return the usual labels, each with why the simulator can make no case of it for an axis; None where it can.

    Nothing is to be simulated of an axis that is not described, or has no gear stage.
    """
    axis = None if row is None else read_axis(row.document)
    return {label: obstacle(axis, label) for label in LABELS} if axis and axis.stages else {}


def axis_cases(service: Service, session: Session) -> Mapping[str, Mapping[str, LabelCases]]:
    """Return the cases of every axis by label, counted once for every version of the library."""
    return kept_count(service.library, session, "cases of axes", lambda: cases_of_axes(session))


def known_of_axis(cases: Mapping[str, LabelCases]) -> str:
    """Say what the library knows of an axis: of each label the measured cases, else the simulated ones.

    >>> measured = LabelCases(measured=8, gearboxes=frozenset({"g1", "g2"}))
    >>> known_of_axis({"normal": measured, "notch": LabelCases(simulated=20)})
    'Of this axis the library has: normal, 8 measured of 2 gearboxes; notch, 20 simulated.'
    >>> known_of_axis({})
    'The library has no case of this axis, at most of others.'
    """
    known = [
        f"{label}, {each.measured} measured of {_units(each.gearboxes)}"
        if each.measured
        else f"{label}, {each.simulated} simulated"
        for label, each in cases.items()
        if each.measured or each.simulated
    ]
    if not known:
        return "The library has no case of this axis, at most of others."
    return f"Of this axis the library has: {'; '.join(known)}."


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
    if not hour.measured:
        return "It was recorded, but no recording is a case of the library yet: nobody said what the gearbox has."
    kept = [f"{each.measured} {label}" for label, each in hour.cases.items() if each.measured]
    units = frozenset[str]().union(*(each.gearboxes for each in hour.cases.values()))
    return f"{counted(hour.measured, 'measured case')} of {_units(units)}: {listed(kept)}."


def simulated(hour: Hour) -> str:
    """Say which cases were simulated for the axis."""
    made = [f"{each.simulated} {label}" for label, each in hour.cases.items() if each.simulated]
    aside = sum(each.set_aside for each in hour.cases.values())
    if hour.axis is not None and not hour.obstacles:
        return "Nothing to do: an axis without a gear stage has no such faults."
    words = f"{counted(hour.simulated, 'simulated case')}: {listed(made)}." if made else "No simulated case yet."
    return f"{words} {aside} more lie far from your recordings and are not used." if aside else words


def completed(obstacles: Mapping[str, str | None]) -> list[Advice]:
    """Say what the description of an axis lacks for the simulation of its cases, if anything."""
    blocked = {label: why for label, why in obstacles.items() if why is not None}
    if not blocked:
        return []
    words = f"so that cases of {listed(list(blocked))} can be simulated."
    return [Advice(f"Complete the description, {words}", f"{sentence(next(iter(blocked.values())))}", "#describe")]


def how_well(hour: Hour) -> str:
    """Say how well the library does on the axis, no better than is known."""
    if not hour.measured and not hour.simulated:
        return "Nothing is known yet: the library has no case of this axis."
    if hour.evaluation is None:
        return "It is being worked out: each gearbox is left out once, and the library answers without it."
    real, made = hour.answers(MEASURED), hour.answers(SIMULATED)
    if not real:
        of_simulated = f"Of simulated gearboxes of this axis it names {_share(made)} rightly. " if made else ""
        why = (
            "without it the library has nothing to answer from, so it cannot be left out"
            if hour.measured
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
    return Proportion(sum(each.right for each in answers), sum(len(each.outcomes) for each in answers))


def _share(answers: Sequence[Answers]) -> str:
    total = _total(answers)
    return f"{total.right} of {total.of}"


def advice(hour: Hour) -> tuple[Advice, ...]:
    """Return what would make the library better on an axis, what helps most first; each for a reason that it says."""
    found = [
        *completed(hour.obstacles),
        *_missing_recordings(hour),
        *_wrong_answers(hour),
        *_unnamed(hour),
        *_set_aside(hour),
    ]
    faults = [
        label for label in hour.labels if label not in BASELINES and not hour.cases.get(label, LabelCases()).measured
    ]
    if faults:
        found.append(
            Advice(
                f"When a gearbox of this axis has {listed([name_of(label) for label in faults], 'or')}, record it "
                "before the repair and keep it with that label.",
                "No such fault was recorded here: what the library knows of it is simulated or of other axes.",
                "#record",
            )
        )
    return tuple(found)


def _missing_recordings(hour: Hour) -> list[Advice]:
    found = []
    good = sum(each.measured for label, each in hour.cases.items() if label in BASELINES)
    units = sorted(frozenset[str]().union(*(each.gearboxes for each in hour.cases.values())))
    if good < ENOUGH:
        rest = ENOUGH - good
        recordings = f"{'more ' if good else ''}normal recording{'' if rest == 1 else 's'}"
        found.append(
            Advice(
                f"Record {number_word(rest)} {recordings} of {f'gearbox {units[0]}' if units else 'a good gearbox'}.",
                f"{number_word(ENOUGH).capitalize()} right answers of {number_word(ENOUGH)} are hardly chance; of "
                "fewer they may be.",
                "#record",
            )
        )
    poor = sum(bool(one.label) and is_poor(one.recording) for one in hour.taken)
    if poor:
        found.append(
            Advice(
                f"Record again, as the check says, what is poor of the newest: {counted(poor, 'recording')}.",
                "A poor recording teaches the library the disturbance as well.",
                "#record",
            )
        )
    if hour.measured and len(units) < CALIBRATED_FROM:
        calibrated = ""
        if hour.gearboxes < CALIBRATED_FROM:
            calibrated = " Until the library knows two, it is not calibrated how sure an answer is."
        found.append(
            Advice(
                "Record a second gearbox of this axis, or of the same kind, if there is one.",
                f"One gearbox does not show in what gearboxes differ.{calibrated}",
                "#record",
            )
        )
    return found


def is_poor(recording: StoredRecording) -> bool:
    """Whether the check found something that forbids to rely on it."""
    return any(isinstance(flag, Mapping) and flag.get("severity") == "poor" for flag in recording.quality)


def _wrong_answers(hour: Hour) -> list[Advice]:
    found = []
    for each in hour.answers(MEASURED):
        if each.wrong:
            found.append(
                Advice(
                    f"Look at {counted(len(each.wrong), 'case')} of {each.label} that it names otherwise.",
                    "The label is wrong, the recording is poor, or the library knows too little of this sound.",
                    f"/cases/{each.wrong[0]}",
                    "The first of them" if len(each.wrong) > 1 else "The case",
                )
            )
        open_ = each.undecided + each.unlike
        if open_ and len(each.outcomes) >= ENOUGH:
            found.append(
                Advice(
                    f"Record {each.label} of another gearbox, in the same motion.",
                    f"With their gearbox left out, {open_} of {len(each.outcomes)} get no name.",
                    "#record",
                )
            )
    return found


def _unnamed(hour: Hour) -> list[Advice]:
    unnamed = sum(each.unnamed for each in hour.cases.values())
    if not unnamed:
        return []
    return [
        Advice(
            "Say with every recording which gearbox it is of.",
            f"{counted(unnamed, 'case')} name{'s' if unnamed == 1 else ''} none. Each counts as a gearbox of its own, "
            "so the figures look better than they are.",
        )
    ]


def _set_aside(hour: Hour) -> list[Advice]:
    aside = sum(each.set_aside for each in hour.cases.values())
    if not aside:
        return []
    return [
        Advice(
            "Fit the simulated sound to your place with gearcase fit, then simulate again.",
            f"{counted(aside, 'simulated case')} sound{'s' if aside == 1 else ''} unlike every recording of the label, "
            "so they are not used.",
        )
    ]


def number_word(number: int) -> str:
    """Write a small number as a word."""
    return {1: "one", 2: "two", 3: "three", 4: "four", 5: "five"}.get(number, str(number))


def counted(number: int, one: str, more: str = "") -> str:
    """Write a number of things.

    >>> counted(1, "case"), counted(2, "case"), counted(2, "gearbox", "gearboxes")
    ('1 case', '2 cases', '2 gearboxes')
    """
    return f"{number} {one if number == 1 else more or f'{one}s'}"


def listed(words: Sequence[str], joined: str = "and") -> str:
    """Write several things in a sentence.

    >>> listed(["a"]), listed(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    return f" {joined} ".join(part for part in (", ".join(words[:-1]), *words[-1:]) if part)
