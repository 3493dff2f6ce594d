"""What is written down of keys, when they were used and that wrong ones came: behind the requests, when it can be."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import BoundedSemaphore, Event

import structlog
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from app.http.keys import SEEN_EVERY, note_use
from casebase.errors import LibraryError
from casebase.library import CaseLibrary
from casebase.store import audit
from casebase.store.models import ApiKey, now

log = structlog.get_logger(__name__)

WAITING = 1_000
"""Notes that wait to be written, at most; further ones are in log and metrics alone."""


class KeyNotes:
    """Writes in a thread of its own: no request waits for it, and none fails where nothing can be written."""

    def __init__(self, library: CaseLibrary) -> None:
        self._library = library
        self._tried: dict[str, float] = {}
        self._room = BoundedSemaphore(WAITING)
        self._closing = Event()
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="key notes")

    def used(self, key: ApiKey, actor: str) -> None:
        """Note that a key was used; once in a while is enough, whether or not it can be written."""
        due, key_id = (now() - SEEN_EVERY), key.id
        if self._tried.get(key_id, 0.0) > due.timestamp() or (key.last_used_at is not None and key.last_used_at > due):
            return
        self._tried[key_id] = now().timestamp()
        self._write_later(actor, lambda session: note_use(session, key_id))

    def refused(self, client: str, actor: str) -> None:
        """Note in the audit log that a wrong key came from this address."""
        self._write_later(actor, lambda session: audit.record(session, "key.refused", ("client", client)))

    def close(self) -> None:
        """Write what is waiting, unless it cannot be written."""
        self._closing.set()
        self._writer.shutdown()

    def _write_later(self, actor: str, note: Callable[[Session], None]) -> None:
        if self._room.acquire(blocking=False):
            self._writer.submit(self._write, actor, note)

    def _write(self, actor: str, note: Callable[[Session], None]) -> None:
        try:
            with self._library.transaction(actor) as session:
                note(session)
        except (LibraryError, SQLAlchemyError, OSError) as error:
            log.warning("note of a key not written", error=str(error))
            if self._closing.is_set():
                self._writer.shutdown(wait=False, cancel_futures=True)
        finally:
            self._room.release()
