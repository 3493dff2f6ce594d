"""What goes on beside the requests: what the first ones would wait for is loaded.

Also what processes left that were killed: `gearcase doctor` counts it, and the service removes it when it starts.
"""

from pathlib import Path
from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.errors import LibraryError
from casebase.library import CaseLibrary
from casebase.store.erasing import discard_left
from casebase.store.stale_locks import count_abandoned
from signals.errors import SignalError

LOG = structlog.get_logger(__name__)


class Upkeep:
    """A thread that loads what diagnoses need."""

    def __init__(self, library: CaseLibrary) -> None:
        self._library = library
        self.loaded = Event()
        """Set once no first request waits any more."""
        self._thread = Thread(target=self._work, name="upkeep", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        try:
            diagnose_once(self._library)
        except (LibraryError, SQLAlchemyError, SignalError, OSError) as error:
            LOG.warning("not loaded beforehand", error=str(error))
        finally:
            self.loaded.set()


def diagnose_once(library: CaseLibrary) -> None:
    """Simulate a recording and diagnose it, keeping nothing: modules, compiled code and the cases are loaded by it."""
    import scipy.signal  # noqa: F401 - half a second, for the first plot and the first slider

    from app.recordings.intake import condition_on
    from casebase.labels import PARAMETERS
    from casebase.origins import SIMULATED
    from casebase.search.retrieval import search_once
    from signals.features import extract
    from signals.recording import Recording
    from sim.acoustics.microphone import SAMPLE_RATE_HZ
    from sim.experiment.paper_axis import PAPER_AXIS
    from sim.experiment.virtual_measurement import measure

    motion = PAPER_AXIS.motion
    sound = measure(PAPER_AXIS, 4 * motion.period_s, seed=0).sound
    condition = condition_on(PAPER_AXIS, speed_rad_s=motion.load_speed_rad_s)
    extraction = extract(Recording(sound, SAMPLE_RATE_HZ), condition)
    search_once()  # an empty library has nothing to search in
    with library.reading() as session:
        library.reuse.reasoner(session).diagnose(extraction, axis=PAPER_AXIS.name)
        for label in PARAMETERS:
            library.reuse.severity(session, extraction, PAPER_AXIS.name, label, SIMULATED)


def leftovers(library: CaseLibrary, incoming: Path, *, remove: bool) -> int:
    """Return how much was left: uploads in `incoming`, half written files, audio that was erased.

    What another process has in hand is not among it.
    """
    under_way = (*incoming.glob("*"), *library.audio.unfinished())
    return count_abandoned(under_way, remove=remove) + discard_left(library, remove=remove)
