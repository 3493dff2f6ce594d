"""What a service does by itself every so often."""

from collections.abc import Callable
from threading import Event, Thread

import structlog
from sqlalchemy.exc import SQLAlchemyError

from casebase.errors import LibraryError

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
