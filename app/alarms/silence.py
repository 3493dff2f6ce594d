"""A thread that notices what nobody sends: gearboxes that have not been heard for as long as a rule says."""

from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.alarms.rules import newly_silent, review
from casebase.errors import LibraryError
from casebase.library import CaseLibrary

ACTOR = "alarms"
EVERY_S = 600.0
"""Silence is counted in days: ten minutes are no delay."""
LOG = structlog.get_logger(__name__)


def tell_silent(library: CaseLibrary) -> None:
    """Put into the outbox what is to be told of gearboxes that have fallen silent."""
    with library.reading() as session:
        silent = newly_silent(session)
    for axis, gearbox in silent:
        with library.transaction(ACTOR) as session:
            review(session, axis, gearbox)


class SilenceWatch:
    """Looks at `start` and every ten minutes until `close`; several at once tell nobody twice."""

    def __init__(self, library: CaseLibrary) -> None:
        self._library = library
        self._closed = Event()
        self._thread = Thread(target=self._work, name="silence watch", daemon=True)

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
            except (LibraryError, SQLAlchemyError) as error:
                LOG.warning("silence was not looked for", error=str(error))
            self._closed.wait(EVERY_S)
