"""The fleet: every gearbox in service with its state, worked out again only for those of which something changed.

Every ten minutes the alarms are held against it: no single recording tells that a gearbox is silent, or sounds
otherwise than it did; and a repair, a case or an undone step change a state.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import cached_property
from threading import Lock

from sqlalchemy.orm import Session

from app.upkeep import Periodic
from casebase.alarms.outbox import count_lost
from casebase.alarms.rules import review, unsettled
from casebase.gearbox_state import NamedFault, Standing, State, standing, standing_fault
from casebase.gearboxes import History, Place, described, histories_of, signatures
from casebase.library import CaseLibrary
from casebase.reasoning.trend import Trend, trends_of

ACTOR = "alarms"
EVERY_S = 600.0
"""Silence is counted in days, a trend in recordings: ten minutes are no delay."""
ORDER = tuple(State)
DIGITS = "0123456789"
LARGE = 200
"""From so many gearboxes on nobody is kept waiting, after a start, until all are worked out."""
TOGETHER = 50
"""Gearboxes that are read from the database at once."""


@dataclass(frozen=True)
class Gearbox:
    """A gearbox in service, or an axis of which no gearbox is known."""

    axis: str
    gearbox: str | None
    standing: Standing | None
    """None where nothing of the axis was ever heard or put in."""

    @property
    def name(self) -> str:
        """Of the axis and of the gearbox."""
        return f"{self.axis}, {self.gearbox or ''}"

    @property
    def unchanged(self) -> float:
        """Grows with the time since its state changed."""
        return -self.standing.since.timestamp() if self.standing and self.standing.since else 0.0

    @property
    def unheard(self) -> float:
        """Grows with the time since its last recording."""
        return -self.standing.last.at.timestamp() if self.standing and self.standing.last else 0.0

    @property
    def state(self) -> State:
        """What is said of it."""
        return State.CANNOT_SAY if self.standing is None else self.standing.state


@dataclass(frozen=True)
class Known:
    """What was worked out of a place, and of what."""

    signature: tuple[object, ...]
    histories: tuple[History, ...]
    trend: Trend | None
    _standings: dict[bool, Standing] = field(default_factory=dict, compare=False)

    @property
    def in_service(self) -> History | None:
        """The gearbox that is in the place now."""
        return self.histories[-1] if self.histories and self.histories[-1].until is None else None

    @cached_property
    def fault(self) -> NamedFault | None:
        """The fault of it that stands; None where none does."""
        return None if self.in_service is None else standing_fault(self.in_service)

    def standing(self, history: History, now: datetime, silent_after: timedelta) -> Standing:
        """Return the state of the gearbox in service; time changes it only where it was not recorded for long."""
        is_silent = bool(history.heard) and now - history.heard[-1].at > silent_after
        if is_silent not in self._standings:
            self._standings[is_silent] = standing(history, self.trend, now, silent_after)
        return self._standings[is_silent]


@dataclass
class Fleet:
    """All gearboxes of an installation, as one process knows them."""

    known: dict[Place, Known] = field(default_factory=dict)
    whole: bool = False
    """Whether all of them were worked out once, which takes seconds where they are thousands."""
    lock: Lock = field(default_factory=Lock)

    def is_begun(self, session: Session) -> bool:
        """Whether it is large, and was not worked out yet."""
        return not self.whole and len(signatures(session)) >= LARGE

    def gearboxes(
        self, session: Session, now: datetime, silent_after: timedelta, axis: str | None = None
    ) -> Sequence[Gearbox]:
        """Return every gearbox in service and every axis without one, the worst first; of one axis, or of all."""
        rows = [
            Gearbox(here, gearbox, known.standing(serving, now, silent_after))
            for (here, gearbox), known in self._current(session, axis).items()
            if here is not None and (serving := known.in_service) is not None
        ]
        heard = {row.axis for row in rows}
        rows += [Gearbox(name, None, None) for name in described(session, axis) if name not in heard]
        return sorted(rows, key=lambda row: (ORDER.index(row.state), natural(row.axis), natural(row.gearbox or "")))

    def place(self, session: Session, axis: str, gearbox: str | None) -> Known | None:
        """Return what is known of one place; None where nothing was recorded there or put in."""
        return self._current(session, axis, gearbox).get((axis, gearbox))

    def in_service(self, session: Session) -> Sequence[History]:
        """Return every gearbox in service, those of which the axis is not known too."""
        return [each for known in self._current(session).values() if (each := known.in_service) is not None]

    def changed(self, session: Session) -> dict[Place, datetime]:
        """Return since when gearboxes sound otherwise than they did, those that do."""
        trends = {place: known.trend for place, known in self._current(session).items() if known.trend is not None}
        began = {place: trend.at_once or (trend.began if trend.changed else None) for place, trend in trends.items()}
        return {place: change.at for place, change in began.items() if change is not None}

    def naming(self, session: Session) -> dict[str, NamedFault]:
        """Return the faults that stand, by the id of each recording that names them."""
        faults = (known.fault for known in self._current(session).values())
        return {one.recording_id: fault for fault in faults if fault is not None for one in fault.named}

    def _current(self, session: Session, axis: str | None = None, gearbox: str | None = None) -> dict[Place, Known]:
        """Return what is known of all gearboxes, of those of an axis, or of one, worked out anew where it changed."""
        wanted = signatures(session, axis, gearbox)
        with self.lock:
            if axis is None:
                for place in self.known.keys() - wanted.keys():
                    del self.known[place]
            changed = [
                place
                for place, signature in wanted.items()
                if place not in self.known or self.known[place].signature != signature
            ]
            for first in range(0, len(changed), TOGETHER):
                some = changed[first : first + TOGETHER]
                self.known |= _worked_out(session, {place: wanted[place] for place in some})
            self.whole = self.whole or axis is None
            return {place: self.known[place] for place in wanted}


def _worked_out(session: Session, wanted: Mapping[Place, tuple[object, ...]]) -> dict[Place, Known]:
    found = histories_of(session, list(wanted))
    serving = [known[-1] for known in found.values() if known and known[-1].until is None]
    places = [(each.axis, each.gearbox) for each in serving]
    trends = dict(zip(places, trends_of(session, serving), strict=True))
    return {place: Known(wanted[place], tuple(found[place]), trends.get(place)) for place in wanted}


def natural(name: str) -> list[tuple[int, str]]:
    """Return by what a name is sorted as people do: numbers in it by their size.

    >>> sorted(["g10", "g9", "a 2"], key=natural)
    ['a 2', 'g9', 'g10']
    """
    parts = re.findall(r"[0-9]{1,18}|[^0-9]+", name)
    return [(int(part), "") if part[0] in DIGITS else (-1, part) for part in parts]


def settle(library: CaseLibrary, fleet: Fleet, *, at_once: bool = False) -> None:
    """Bring the alarms to what is known of the gearboxes, and put into the outbox what is to be told.

    Args:
        at_once: somebody waits, so a large fleet that was not worked out yet is left to `alarm_watch`.
    """
    with library.transaction(ACTOR) as session:
        count_lost(session)
    with library.reading() as session:
        if at_once and fleet.is_begun(session):
            return
        changed = fleet.changed(session)
        places = unsettled(session, fleet.in_service(session), changed)
    for axis, gearbox in places:
        with library.transaction(ACTOR) as session:
            review(session, axis, gearbox, changed)


def alarm_watch(library: CaseLibrary, fleet: Fleet) -> Periodic:
    """Return what does that every ten minutes; several at once tell nobody twice."""
    return Periodic("alarm watch", EVERY_S, lambda: settle(library, fleet))
