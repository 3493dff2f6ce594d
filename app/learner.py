"""What goes on beside the requests: what the first ones would wait for is loaded, and weights are learned again."""

from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.errors import LibraryError
from casebase.library import CaseLibrary
from casebase.upkeep import keep_learned, keep_table

ACTOR = "learning"
APART_S = 2.0
"""Cases often come many at a time; learning waits so long for more of them."""
LOG = structlog.get_logger(__name__)


class Learner:
    """A thread that keeps what was learned in step with the library, from `start` to `close`.

    Learning that is under way at `close` is given up: whoever opens the library next begins it again.
    """

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
        load_what_is_compiled()
        while self._library.touched.wait() and not self._closed.wait(APART_S):
            self._library.touched.clear()
            try:
                if keep_learned(self._library, ACTOR, stop=self._closed):
                    LOG.info("weights learned again")
                if keep_table(self._library, ACTOR):
                    LOG.info("table of the cases written")
            except (LibraryError, SQLAlchemyError, OSError) as error:
                LOG.warning("weights not learned", error=str(error))


def load_what_is_compiled() -> None:
    """Simulate for a moment and search once, so that no first request waits for compiled code to be loaded."""
    import scipy.signal  # noqa: F401 - half a second, for the first plot and the first slider

    from casebase.__main__ import search_once
    from sim.experiment.paper_axis import PAPER_AXIS
    from sim.experiment.virtual_measurement import measure

    search_once()
    measure(PAPER_AXIS, 0.2, seed=0)
