"""The fleet: every gearbox in service with its state, worked out again only for those of which something changed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from threading import Lock

from sqlalchemy.orm import Session

from casebase.gearbox_state import Standing, State, standing
from casebase.gearboxes import History, Place, described, histories, signatures
from casebase.trend import Trend, trend_of

ORDER = tuple(State)


@dataclass(frozen=True)
class Gearbox:
    """A gearbox in service, or an axis of which no gearbox is known."""

    axis: str
    gearbox: str | None
    standing: Standing | None
    """None where nothing of the axis was ever heard or put in."""


@dataclass(frozen=True)
class Known:
    """What was worked out of a place, and of what."""

    signature: tuple[object, ...]
    histories: tuple[History, ...]
    trend: Trend | None


@dataclass
class Fleet:
    """All gearboxes of an installation, as one process knows them."""

    known: dict[Place, Known] = field(default_factory=dict)
    lock: Lock = field(default_factory=Lock)

    def gearboxes(self, session: Session, now: datetime, silent_after: timedelta) -> Sequence[Gearbox]:
        """Return every gearbox in service and every axis without one, the worst first."""
        rows = [
            Gearbox(place[0], place[1], standing(known.histories[-1], known.trend, now, silent_after))
            for place, known in self._current(session).items()
            if known.histories and known.histories[-1].until is None
        ]
        heard = {row.axis for row in rows}
        rows += [Gearbox(axis, None, None) for axis in described(session) if axis not in heard]
        return sorted(rows, key=_rank)

    def _current(self, session: Session) -> dict[Place, Known]:
        wanted = signatures(session)
        with self.lock:
            for place in self.known.keys() - wanted.keys():
                del self.known[place]
            for place, signature in wanted.items():
                known = self.known.get(place)
                if known is None or known.signature != signature:
                    self.known[place] = _worked_out(session, place, signature)
            return dict(self.known)


def _worked_out(session: Session, place: Place, signature: tuple[object, ...]) -> Known:
    found = tuple(histories(session, *place))
    current = found[-1] if found and found[-1].until is None else None
    return Known(signature, found, trend_of(session, current) if current else None)


def _rank(row: Gearbox) -> tuple[int, str, str]:
    state = State.CANNOT_SAY if row.standing is None else row.standing.state
    return ORDER.index(state), row.axis, row.gearbox or ""
