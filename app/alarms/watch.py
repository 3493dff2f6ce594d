"""Work that notices what no single recording tells: a gearbox that is silent, or sounds otherwise than it did.

It also brings the alarms of states to what the pages say after a repair, a case, or an undone step.
"""

from datetime import datetime, timedelta

from app.fleet import Fleet, Gearbox
from app.periodic import Periodic
from casebase.alarms.rules import asks_for_changes, newly_silent, review, review_changes, unsettled
from casebase.library import CaseLibrary
from casebase.store.models import now

ACTOR = "alarms"
EVERY_S = 600.0
"""Silence is counted in days, a trend in recordings: ten minutes are no delay."""


def tell_silent(library: CaseLibrary) -> None:
    """Put into the outbox what is to be told of gearboxes that have fallen silent."""
    with library.reading() as session:
        silent = newly_silent(session)
    for axis, gearbox in silent:
        with library.transaction(ACTOR) as session:
            review(session, axis, gearbox)


def tell_states(library: CaseLibrary, fleet: Fleet) -> None:
    """Bring the alarms of states to what is known of the gearboxes, and put into the outbox what is to be told."""
    with library.reading() as session:
        places = unsettled(session, fleet.in_service(session))
    for axis, gearbox in places:
        with library.transaction(ACTOR) as session:
            review(session, axis, gearbox)


def tell_changed(library: CaseLibrary, fleet: Fleet) -> None:
    """Put into the outbox what is to be told of gearboxes whose trend says that they have changed."""
    with library.reading() as session:
        if not asks_for_changes(session):
            return
        known = fleet.gearboxes(session, now(), timedelta.max)
    began = {(row.axis, row.gearbox): _began(row) for row in known if row.standing is not None}
    with library.transaction(ACTOR) as session:
        review_changes(session, began)


def _began(row: Gearbox) -> datetime | None:
    trend = None if row.standing is None else row.standing.trend
    if trend is None:
        return None
    return trend.at_once.at if trend.at_once is not None else trend.began.at if trend.changed else None


def alarm_watch(library: CaseLibrary, fleet: Fleet) -> Periodic:
    """Return what looks for all of this every ten minutes; several at once tell nobody twice."""

    def work() -> None:
        tell_states(library, fleet)
        tell_silent(library)
        tell_changed(library, fleet)

    return Periodic("alarm watch", EVERY_S, work)
