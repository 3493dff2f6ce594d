"""What goes on beside the requests: what the first ones would wait for is loaded, and some work is done every so often.

Where an installation sets `GEARCASE_RETAIN_AUDIO_DAYS`, older audio is erased every day. What processes left that were
killed: `gearcase doctor` counts it, and the service removes it when it starts.
"""

from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.errors import LibraryError
from casebase.library import CaseLibrary
from casebase.origins import DEMO
from casebase.recordings import bundles_left
from casebase.store.artifacts import active_artifact
from casebase.store.erasing import discard_left, expire
from casebase.store.stale_locks import count_abandoned
from signals.errors import SignalError

LOG = structlog.get_logger(__name__)


class Periodic:
    """A thread that does some work at `start` and every so often until `close`, which waits for what has begun.

    Args:
        name: of the work; stands in the warning when it fails. It is done again the next time.
        every_s: from the end of one time to the next [s].
    """

    def __init__(self, name: str, every_s: float, work: Callable[[], None]) -> None:
        self._name, self._every_s, self._work = name, every_s, work
        self._closed = Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                self._work()
            except (LibraryError, SQLAlchemyError, OSError) as error:
                LOG.warning("failed, and is tried again later", work=self._name, error=str(error))
            self._closed.wait(self._every_s)


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
    """Return how much was left: uploads in `incoming`, half written files, audio that was erased or never got a row.

    What another process has in hand is not among it.
    """
    under_way = (*incoming.glob("*"), *library.audio.unfinished())
    named = library.audio.marks()
    count = count_abandoned(under_way, remove=remove) + count_abandoned(named.values(), remove=False)
    if remove:
        with library.reading() as session:
            bundles = bundles_left(session, library.audio)
        library.sweep([*named, *bundles])
    return count + discard_left(library, remove=remove)


RETENTION = "retention"
DAY_S = 86_400.0


def erase_old(library: CaseLibrary, days: int, actor: str = RETENTION) -> list[str]:
    """Erase audio older than so many days, never that of a case or of the demonstration; return ids of recordings."""
    with library.reading() as session:
        demo = active_artifact(session, DEMO)
    return expire(library, actor, days, keep=() if demo is None else (str(demo.content["recording_id"]),))


def retention(library: CaseLibrary, days: int | None) -> Periodic | None:
    """Return what erases every day what is older than so many days; none where nothing is set."""
    if days is None:
        return None

    def work() -> None:
        LOG.info("old audio erased", recordings=len(erase_old(library, days)), days=days)

    return Periodic("retention", DAY_S, work)
