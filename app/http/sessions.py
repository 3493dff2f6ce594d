"""Sessions of browsers: 256 random bits in a cookie, kept as SHA-256; ended by sign-out, by age and with their key."""

import asyncio
import secrets
from datetime import timedelta

from sqlalchemy import delete, or_, select
from sqlalchemy.orm import Session

from app.http.keys import PREFIX, digest
from casebase.library import CaseLibrary
from casebase.store import audit
from casebase.store.models import ApiKey, BrowserSession, now

LASTS = timedelta(days=14)
READ_EVERY_S = 2.0


def open_session(session: Session, key_id: str, before: str = "") -> str:
    """Return the token of a new session. The one `before` in that browser ends, and so do all that are too old."""
    token = PREFIX + secrets.token_urlsafe(32)
    over = or_(BrowserSession.expires_at <= now(), BrowserSession.token_sha256 == digest(before))
    session.execute(delete(BrowserSession).where(over))
    session.add(BrowserSession(token_sha256=digest(token), key_id=key_id, expires_at=now() + LASTS))
    audit.record(session, "session.opened", ("key", key_id))
    return token


def end_session(session: Session, token: str, key_id: str) -> None:
    """End one session of a key."""
    session.execute(delete(BrowserSession).where(BrowserSession.token_sha256 == digest(token)))
    audit.record(session, "session.closed", ("key", key_id))


def key_of_session(session: Session, token: str) -> ApiKey | None:
    """Return the key with which somebody signed in, or None if the session is unknown or over."""
    lasting = BrowserSession.expires_at > now(), ApiKey.revoked_at.is_(None)
    return session.scalar(
        select(ApiKey).join(BrowserSession).where(BrowserSession.token_sha256 == digest(token), *lasting)
    )


class InForce:
    """Which keys and sessions are in force: read once every few seconds, however many live streams ask."""

    def __init__(self, library: CaseLibrary) -> None:
        self._library = library
        self._known: frozenset[str] = frozenset()
        self._read_at = float("-inf")
        self._reading = asyncio.Lock()

    async def has(self, credential: str) -> bool:
        """Whether this is the id of a key, or the SHA-256 of a session's token, that still counts."""
        loop = asyncio.get_running_loop()
        async with self._reading:
            if credential not in self._known or loop.time() - self._read_at >= READ_EVERY_S:
                self._known, self._read_at = await loop.run_in_executor(None, self._read), loop.time()
        return credential in self._known

    def _read(self) -> frozenset[str]:
        keys = select(ApiKey.id).where(ApiKey.revoked_at.is_(None))
        sessions = select(BrowserSession.token_sha256).where(
            BrowserSession.expires_at > now(), BrowserSession.key_id.in_(keys)
        )
        with self._library.reading() as session:
            return frozenset([*session.scalars(keys), *session.scalars(sessions)])
