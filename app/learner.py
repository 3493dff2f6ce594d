"""Learning beside the requests: when cases changed, weights are learned again if the library outgrew them."""

from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.errors import LibraryError
from casebase.library import CaseLibrary

ACTOR = "learning"
APART_S = 2.0
"""Cases often come many at a time; learning waits so long for more of them."""
LOG = structlog.get_logger(__name__)


class Learner:
    """A thread that keeps what was learned in step with the library, from `start` to `close`."""

    def __init__(self, library: CaseLibrary) -> None:
        self._library = library
        self._closed = Event()
        self._thread = Thread(target=self._work, name="learner", daemon=True)

    def start(self) -> None:
        self._library.touched.set()
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._library.touched.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        while self._library.touched.wait() and not self._closed.wait(APART_S):
            self._library.touched.clear()
            try:
                if self._library.keep_learned(ACTOR):
                    LOG.info("weights learned again")
            except (LibraryError, SQLAlchemyError) as error:
                LOG.warning("weights not learned", error=str(error))
