"""The state of a gearbox: what its recordings say together, since when, and why.

A fault that the library names is likely a fault: such a name is right nine times in ten. A gearbox that sounds
otherwise than it did is to be watched, also where the library names nothing. A worn gear does not heal, so a fault that
was named stays in mind until a person rejects it or the gearbox is repaired. Nothing is said of a gearbox that was not
heard.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum

from casebase.gearboxes import OPEN, REJECTED, Heard, History
from casebase.labels import BASELINES
from casebase.trend import Trend


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
    CHANGED = "changed"
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
        since: from when on it has been so; None where it was never heard.
        recording: that shows it.
        last: the newest recording.
    """

    state: State
    reason: Reason
    since: datetime | None
    recording: Heard | None = None
    last: Heard | None = None
    trend: Trend | None = None


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
    usable = [one for one in heard if one.verdict != "unusable"]
    newest = usable[-1] if usable else None
    if newest is not None and is_fault(newest):
        first = _since(usable, is_fault)
        reason = Reason.NAMED if newest.review == OPEN else Reason.FOUND
        return Standing(State.FAULT_LIKELY, reason, first.at, newest, last, trend)
    if trend is not None and trend.changed:
        return Standing(State.WATCH, Reason.CHANGED, trend.began.at, newest, last, trend)
    before = next((one for one in reversed(usable) if is_fault(one)), None)
    if before is not None:
        return Standing(State.WATCH, Reason.NAMED_BEFORE, before.at, before, last, trend)
    if now - last.at > silent_after:
        return Standing(State.NOT_HEARD, Reason.SILENT, last.at, last, last, trend)
    if newest is None or newest.label not in BASELINES:
        return _undecided(newest, usable, heard, last, trend)
    return Standing(State.GOOD, Reason.SOUNDS_GOOD, _since(usable, is_good).at, newest, last, trend)


def _undecided(
    newest: Heard | None, usable: Sequence[Heard], heard: Sequence[Heard], last: Heard, trend: Trend | None
) -> Standing:
    if newest is None:
        reason = Reason.UNUSABLE if heard else Reason.NOT_DIAGNOSED
        return Standing(State.CANNOT_SAY, reason, last.at, last, last, trend)
    reason = Reason.UNLIKE if newest.verdict == "not_in_library" else Reason.UNDECIDED
    return Standing(State.CANNOT_SAY, reason, _since(usable, _is_open).at, newest, last, trend)


def is_fault(heard: Heard) -> bool:
    """Whether a fault is named."""
    return heard.verdict == "diagnosed" and heard.label not in BASELINES


def is_good(heard: Heard) -> bool:
    """Whether it is named normal."""
    return heard.verdict == "diagnosed" and heard.label in BASELINES


def _is_open(heard: Heard) -> bool:
    return heard.verdict != "diagnosed"


def _since(heard: Sequence[Heard], holds: Callable[[Heard], bool]) -> Heard:
    """Return the first of the recordings at the end of which all are so."""
    first = heard[-1]
    for one in reversed(heard):
        if not holds(one):
            break
        first = one
    return first
