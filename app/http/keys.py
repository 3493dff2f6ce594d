"""Keys of the service: 256 random bits each, shown once, kept as SHA-256; each has a role."""

import hashlib
import secrets
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from enum import StrEnum
from threading import BoundedSemaphore, Event

import structlog
from sqlalchemy import delete, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from casebase.errors import ConflictError, InvalidRequestError, LibraryError, NotFoundError
from casebase.library import CaseLibrary
from casebase.store import audit
from casebase.store.models import ROLES, ApiKey, BrowserSession, now
from casebase.store.pagination import Page, check_cursor, page_upwards

PREFIX = "gearcase_"
SEEN_EVERY = timedelta(minutes=1)
"""So old may the time be at which a key is said to have been used last."""


class Role(StrEnum):
    """What a key may do; each role may do what those before it may."""

    VIEWER = "viewer"
    OPERATOR = "operator"
    ADMIN = "admin"

    def may(self, needed: "Role") -> bool:
        return ROLES.index(self) >= ROLES.index(needed)


def create_key(session: Session, *, name: str, role: Role) -> tuple[ApiKey, str]:
    """Return the new row and the key itself, which is in no way to be had again.

    Raises:
        InvalidRequestError: if the name is empty, too long or has control characters.
    """
    if not name.strip() or len(name) > 200 or any(character < " " for character in name):
        raise InvalidRequestError(
            "a key needs a name of 1 to 200 characters, none of them a control character: whose key is it?"
        )
    key = PREFIX + secrets.token_urlsafe(32)
    row = ApiKey(name=name, role=role.value, key_sha256=digest(key), created_by=audit.actor_of(session))
    session.add(row)
    session.flush()
    audit.record(session, "key.created", ("key", row.id), after={"name": name, "role": role.value})
    return row, key


def find_key(session: Session, key: str) -> ApiKey | None:
    """Return the row of a key that is in force, or None if it is unknown or revoked."""
    return session.scalar(select(ApiKey).where(ApiKey.key_sha256 == digest(key), ApiKey.revoked_at.is_(None)))


def note_use(session: Session, key_id: str) -> None:
    """Remember that a key was used."""
    session.get_one(ApiKey, key_id).last_used_at = now()


def list_keys(session: Session) -> Sequence[ApiKey]:
    """Return all keys, revoked ones too, oldest first."""
    return session.scalars(select(ApiKey).order_by(ApiKey.id)).all()


def keys_page(session: Session, *, limit: int = 50, cursor: str | None = None) -> Page[ApiKey]:
    """Return a page of the keys, revoked ones too, oldest first."""
    after = None if cursor is None else check_cursor(cursor)
    return page_upwards(session, select(ApiKey), ApiKey.id, limit=limit, after=after)


def revoke_key(session: Session, key_id: str) -> ApiKey:
    """End a key and its sessions for good; again is no error.

    Raises:
        NotFoundError: if no key has this id.
        ConflictError: if it is the last admin key in force, after which nobody could make another.
    """
    row = session.get(ApiKey, key_id)
    if row is None:
        raise NotFoundError(f"no key has the id {key_id!r}; `gearcase keys list` shows them")
    if row.revoked_at is not None:
        return row
    admins = select(ApiKey.id).where(ApiKey.role == Role.ADMIN.value, ApiKey.revoked_at.is_(None))
    if session.scalars(admins).all() == [key_id]:
        raise ConflictError("this is the last admin key in force; create another one before you revoke it")
    row.revoked_at = now()
    session.execute(delete(BrowserSession).where(BrowserSession.key_id == key_id))
    audit.record(session, "key.revoked", ("key", row.id), before={"name": row.name, "role": row.role})
    return row


def digest(key: str) -> str:
    """Return what is kept of a key or of the token of a session."""
    return hashlib.sha256(key.encode()).hexdigest()


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
