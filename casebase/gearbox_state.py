"""The state of a gearbox: what its recordings say together, since when, and why.

A fault that the library names is likely a fault: such a name is right nine times in ten, and so is that there is one
where it leaves open which. A gearbox that sounds
otherwise than it did is to be watched, also where the library names nothing; where all of its sound changed at once, it
is asked what happened then, for another gearbox or another place of the microphone sounds so. Nothing is said of a
gearbox that was not heard.

A worn gear does not heal. A fault that was named stands until a person rejects it, the gearbox is repaired, or
recordings named normal outweigh it. Each answer is right nine times in ten, so were they independent, one normal would
cancel one fault and the next make good nine times as likely. Recordings of one gearbox err together, so one more is
asked for. What was heard before the fault speaks neither way: faults begin. Nothing outweighs what a person found.

Labelled recordings teach the library. Where nobody knows when they were made, or those of one day contradict each
other, they do not tell what the gearbox is like today.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from enum import StrEnum
from itertools import takewhile

from casebase.gearboxes import OPEN, REJECTED, GearboxRecording, History
from casebase.labels import BASELINES
from casebase.reasoning.trend import Trend

AT_ONE_TIME = timedelta(days=1)
"""Between labelled recordings so near to each other a gearbox is the same."""
OUTWEIGHED_BY = 2
"""By so many more recordings named normal a named fault is outweighed [1]."""


class State(StrEnum):
    """What is said of a gearbox, the worst first."""

    FAULT_LIKELY = "fault likely"
    WATCH = "watch"
    NOT_HEARD = "not heard"
    CANNOT_SAY = "cannot say"
    GOOD = "good"


class Reason(StrEnum):
    """Why a gearbox is in its state."""

    NAMED = "named"
    FOUND = "found"
    LABELLED = "labelled"
    CHANGED = "changed"
    AT_ONCE = "at once"
    NAMED_BEFORE = "named before"
    SILENT = "silent"
    NEVER_HEARD = "never heard"
    UNDECIDED = "undecided"
    UNUSABLE = "unusable"
    NOT_DIAGNOSED = "not diagnosed"
    UNLIKE = "unlike"
    SOUNDS_GOOD = "sounds good"


@dataclass(frozen=True)
class Standing:
    """State of a gearbox.

    Args:
        since: from when on it has been so; None where it was never heard, or nobody knows when.
        recording: that shows it.
        last: the newest recording.
        fault: the fault that was named and stands, or was outweighed; None where none was named.
        labels: of labelled recordings that do not tell its state of today.
    """

    state: State
    reason: Reason
    since: datetime | None
    recording: GearboxRecording | None = None
    last: GearboxRecording | None = None
    trend: Trend | None = None
    fault: "NamedFault | None" = None
    labels: tuple[str, ...] = ()


@dataclass(frozen=True)
class NamedFault:
    """A fault that was named of a gearbox, and what was heard since.

    Args:
        named: the recordings that name it, oldest first.
        good: how many recordings since the first of them are named normal.
    """

    named: tuple[GearboxRecording, ...]
    good: int = 0

    @property
    def found(self) -> bool:
        """Whether a person said so."""
        return any(one.review != OPEN for one in self.named)

    @property
    def still_asked_for(self) -> int:
        """How many more recordings named normal would outweigh it; those of a person's finding are never enough."""
        return len(self.named) + OUTWEIGHED_BY - self.good

    @property
    def stands(self) -> bool:
        """Whether it is not outweighed."""
        return self.found or self.still_asked_for > 0


def named_fault(heard: Sequence[GearboxRecording]) -> NamedFault | None:
    """Return the newest fault that recordings, oldest first, name; None where they name none."""
    fault: NamedFault | None = None
    for one in heard:
        if is_fault(one):
            before = fault if fault is not None and fault.stands else NamedFault(())
            fault = NamedFault((*before.named, one), before.good)
        elif is_good(one) and fault is not None:
            fault = NamedFault(fault.named, fault.good + 1)
    return fault


def standing_fault(history: History) -> NamedFault | None:
    """Return the fault that stands: named since it was put in or repaired, and not outweighed. None where none does.

    The one criterion of the page of a gearbox, of the queue of what needs a person, and of the alarms.
    """
    fault = named_fault(said_of(history.since_renewed))
    return fault if fault is not None and fault.stands else None


def fault_before(history: History, recording: GearboxRecording) -> NamedFault | None:
    """Return the fault that stood when a recording was taken, by what was heard before it; None where none did."""
    then = replace(
        history,
        heard=history.heard[: history.heard.index(recording)],
        done=tuple(each for each in history.done if each.at <= recording.at),
    )
    return standing_fault(then)


def said_of(recordings: Sequence[GearboxRecording]) -> list[GearboxRecording]:
    """Return the recordings that say something: diagnosed, usable, and not rejected."""
    return [one for one in recordings if one.verdict not in (None, "unusable") and one.review != REJECTED]


def standing(history: History, trend: Trend | None, now: datetime, silent_after: timedelta) -> Standing:
    """Return the state of a gearbox in service.

    Args:
        trend: of its recordings since it was put in or repaired; None where there are too few.
        silent_after: how long the last recording may be ago.
    """
    heard = [one for one in history.since_renewed if one.verdict is not None and one.review != REJECTED]
    all_heard = history.since_renewed
    last = all_heard[-1] if all_heard else None
    if last is None:
        return Standing(State.CANNOT_SAY, Reason.NEVER_HEARD, history.renewed)
    usable = said_of(all_heard)
    newest = usable[-1] if usable else None
    fault, at_once = named_fault(usable), None if trend is None else trend.at_once
    changed = trend is not None and trend.changed and at_once is None
    taught = _taught_at_the_end(usable)
    labels = tuple(dict.fromkeys(one.label or "" for one in taught))
    if len(labels) > 1 or any(not one.timed for one in taught):
        state = State.WATCH if len(labels) > 1 and all(one.timed for one in taught) else State.CANNOT_SAY
        return Standing(state, Reason.LABELLED, _from(taught), newest, last, trend, fault, labels)
    if newest is not None and fault is not None and is_fault(newest):
        reason = Reason.NAMED if newest.review == OPEN else Reason.FOUND
        return Standing(State.FAULT_LIKELY, reason, _from(fault.named), newest, last, trend, fault)
    if fault is not None and fault.stands:
        state, shows = State.FAULT_LIKELY if changed else State.WATCH, fault.named[-1]
        return Standing(state, Reason.NAMED_BEFORE, _from(fault.named), shows, last, trend, fault)
    if at_once is not None:
        return Standing(State.WATCH, Reason.AT_ONCE, at_once.at, newest, last, trend, fault)
    if trend is not None and changed:
        return Standing(State.WATCH, Reason.CHANGED, trend.began.at, newest, last, trend, fault)
    if now - last.at > silent_after:
        return Standing(State.NOT_HEARD, Reason.SILENT, last.at, last, last, trend)
    if newest is None or not is_good(newest):
        return _undecided(newest, usable, heard, last, trend)
    return Standing(State.GOOD, Reason.SOUNDS_GOOD, _since(usable, is_good).at, newest, last, trend, fault)


def _taught_at_the_end(usable: Sequence[GearboxRecording]) -> list[GearboxRecording]:
    """Return the newest labelled recordings that were never diagnosed, of one time; none where one was diagnosed."""
    end = list(takewhile(lambda one: one.taught, reversed(usable)))
    return [one for one in reversed(end) if not one.timed or end[0].at - one.at < AT_ONE_TIME]


def _from(recordings: Sequence[GearboxRecording]) -> datetime | None:
    """Return when the first of them was recorded of which that is known."""
    return next((one.at for one in recordings if one.timed), None)


def _undecided(
    newest: GearboxRecording | None,
    usable: Sequence[GearboxRecording],
    heard: Sequence[GearboxRecording],
    last: GearboxRecording,
    trend: Trend | None,
) -> Standing:
    if newest is None:
        reason = Reason.UNUSABLE if heard else Reason.NOT_DIAGNOSED
        return Standing(State.CANNOT_SAY, reason, last.at, last, last, trend)
    reason = Reason.UNLIKE if newest.verdict == "not_in_library" else Reason.UNDECIDED
    return Standing(State.CANNOT_SAY, reason, _since(usable, _is_open).at, newest, last, trend)


def is_fault(heard: GearboxRecording) -> bool:
    """Whether a fault is named, or there is one of which only the name is open."""
    return heard.fault is True or (heard.verdict == "diagnosed" and heard.label not in BASELINES)


def is_good(heard: GearboxRecording) -> bool:
    """Whether it is named normal, or there is no fault."""
    return heard.fault is False or (heard.verdict == "diagnosed" and heard.label in BASELINES)


def _is_open(heard: GearboxRecording) -> bool:
    return not is_fault(heard) and not is_good(heard)


def _since(heard: Sequence[GearboxRecording], holds: Callable[[GearboxRecording], bool]) -> GearboxRecording:
    """Return the first of the recordings at the end of which all are so."""
    first = heard[-1]
    for one in reversed(heard):
        if not holds(one):
            break
        first = one
    return first
