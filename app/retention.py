"""How long audio is kept: where an installation sets `GEARCASE_RETAIN_AUDIO_DAYS`, older audio is erased every day."""

from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from app.intake import DEMO
from app.settings import Settings
from casebase.artifacts import active_artifact
from casebase.erasing import expire
from casebase.errors import LibraryError
from casebase.library import CaseLibrary

ACTOR = "retention"
DAY_S = 86_400.0
LOG = structlog.get_logger(__name__)


def erase_old(library: CaseLibrary, days: int, actor: str = ACTOR) -> list[str]:
    """Erase audio older than so many days, never that of a case or of the demonstration; return ids of recordings."""
    with library.reading() as session:
        demo = active_artifact(session, DEMO)
    return expire(library, actor, days, keep=() if demo is None else (str(demo.content["recording_id"]),))


class Retention:
    """A thread that erases what is too old, at `start` and every day until `close`; none where nothing is set."""

    def __init__(self, library: CaseLibrary, settings: Settings) -> None:
        self._library, self._days = library, settings.retain_audio_days
        self._closed = Event()
        self._thread = Thread(target=self._work, name="retention", daemon=True)

    def start(self) -> None:
        if self._days is not None:
            self._thread.start()

    def close(self) -> None:
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    def _work(self) -> None:
        assert self._days is not None
        while not self._closed.is_set():
            try:
                gone = erase_old(self._library, self._days)
                LOG.info("old audio erased", recordings=len(gone), days=self._days)
            except (LibraryError, SQLAlchemyError, OSError) as error:
                LOG.warning("old audio not erased", error=str(error))
            self._closed.wait(DAY_S)
