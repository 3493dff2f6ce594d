"""What goes on beside the requests: what the first ones would wait for is loaded, and a large table is written."""

from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.errors import LibraryError
from casebase.library import CaseLibrary
from casebase.upkeep import keep_table
from signals.errors import SignalError

ACTOR = "upkeep"
APART_S = 2.0
"""Cases often come many at a time; upkeep waits so long for more of them [s]."""
LOG = structlog.get_logger(__name__)


class Upkeep:
    """A thread that loads what diagnoses need and keeps the table of a large library, from `start` to `close`."""

    def __init__(self, library: CaseLibrary) -> None:
        self._library = library
        self.loaded = Event()
        """Set once no first request waits any more."""
        self._closed = Event()
        self._thread = Thread(target=self._work, name="upkeep", daemon=True)

    def start(self) -> None:
        self._library.touched.set()
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._library.touched.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        try:
            diagnose_once(self._library)
        except (LibraryError, SQLAlchemyError, SignalError, OSError) as error:
            LOG.warning("not loaded beforehand", error=str(error))
        finally:
            self.loaded.set()
        while self._library.touched.wait() and not self._closed.wait(APART_S):
            self._library.touched.clear()
            try:
                if keep_table(self._library, ACTOR):
                    LOG.info("table of the cases written")
            except (LibraryError, SQLAlchemyError, OSError) as error:
                LOG.warning("table of the cases not written", error=str(error))


def diagnose_once(library: CaseLibrary) -> None:
    """Simulate a recording and diagnose it, keeping nothing: modules, compiled code and the cases are loaded by it."""
    import scipy.signal  # noqa: F401 - half a second, for the first plot and the first slider

    from app.recordings.intake import mesh_orders, shaft_orders
    from casebase.__main__ import search_once
    from casebase.labels import PARAMETERS
    from casebase.origins import SIMULATED
    from signals.condition import OperatingCondition
    from signals.features import extract
    from signals.recording import Recording
    from sim.acoustics.microphone import SAMPLE_RATE_HZ
    from sim.experiment.paper_axis import PAPER_AXIS
    from sim.experiment.virtual_measurement import measure

    motion = PAPER_AXIS.motion
    sound = measure(PAPER_AXIS, 4 * motion.period_s, seed=0).sound
    condition = OperatingCondition(
        speed_rad_s=motion.load_speed_rad_s, shaft_orders=shaft_orders(PAPER_AXIS), mesh_orders=mesh_orders(PAPER_AXIS)
    )
    extraction = extract(Recording(sound, SAMPLE_RATE_HZ), condition)
    search_once()  # an empty library has nothing to search in
    with library.reading() as session:
        library.reuse.reasoner(session).diagnose(extraction, axis=PAPER_AXIS.name)
        for label in PARAMETERS:
            library.reuse.severity(session, extraction, PAPER_AXIS.name, label, SIMULATED)
