"""A thread that notices what no single recording tells: a gearbox that is silent, or sounds otherwise than it did."""

from datetime import datetime, timedelta
from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from app.fleet import Fleet, Gearbox
from casebase.alarms.rules import asks_for_changes, newly_silent, review, review_changes
from casebase.errors import LibraryError
from casebase.library import CaseLibrary
from casebase.models import now

ACTOR = "alarms"
EVERY_S = 600.0
"""Silence is counted in days, a trend in recordings: ten minutes are no delay."""
LOG = structlog.get_logger(__name__)


def tell_silent(library: CaseLibrary) -> None:
    """Put into the outbox what is to be told of gearboxes that have fallen silent."""
    with library.reading() as session:
        silent = newly_silent(session)
    for axis, gearbox in silent:
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
    return trend.began.at if trend is not None and trend.changed else None


class AlarmWatch:
    """Looks at `start` and every ten minutes until `close`; several at once tell nobody twice."""

    def __init__(self, library: CaseLibrary, fleet: Fleet) -> None:
        self._library, self._fleet = library, fleet
        self._closed = Event()
        self._thread = Thread(target=self._work, name="alarm watch", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        while not self._closed.is_set():
            try:
                tell_silent(self._library)
                tell_changed(self._library, self._fleet)
            except (LibraryError, SQLAlchemyError) as error:
                LOG.warning("silence and changes were not looked for", error=str(error))
            self._closed.wait(EVERY_S)
