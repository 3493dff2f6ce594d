"""Keys of the service: 256 random bits, kept as their SHA-256."""

import hashlib
import hmac
import secrets
from collections.abc import Sequence
from datetime import timedelta

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase import audit
from casebase.description import check_choice
from casebase.errors import InvalidRequestError, NotFoundError
from casebase.models import ROLES, ApiKey, now

PREFIX = "gck_"
SEEN_EVERY = timedelta(minutes=1)


def create_key(session: Session, *, name: str, role: str) -> tuple[ApiKey, str]:
    """Return the new row and the key itself, which is shown this once."""
    check_choice("role", role, ROLES)
    if not name.strip() or len(name) > 200 or not name.isprintable():
        raise InvalidRequestError("a key needs a name of 1 to 200 printable characters: whose key is it?")
    key = PREFIX + secrets.token_urlsafe(32)
    row = ApiKey(name=name, role=role, key_sha256=_digest(key), created_by=audit.actor_of(session))
    session.add(row)
    session.flush()
    audit.record(session, "key.created", ("key", row.id), after={"name": name, "role": role})
    return row, key


def find_key(session: Session, key: str) -> ApiKey | None:
    """Return the row of a key that is valid now, or None."""
    digest = _digest(key)
    row = session.scalar(select(ApiKey).where(ApiKey.key_sha256 == digest))
    if row is None or row.revoked_at is not None or not hmac.compare_digest(row.key_sha256, digest):
        return None
    return row


def note_use(session: Session, key_id: str) -> None:
    """Remember that a key was used, at most once a minute."""
    row = session.get_one(ApiKey, key_id)
    if row.last_used_at is None or now() - row.last_used_at > SEEN_EVERY:
        row.last_used_at = now()


def revoke_key(session: Session, key_id: str) -> ApiKey:
    """End a key; raises NotFoundError."""
    row = session.get(ApiKey, key_id)
    if row is None:
        raise NotFoundError(f"no key has the id {key_id!r}; list them with `keys list`")
    if row.revoked_at is None:
        row.revoked_at = now()
        audit.record(session, "key.revoked", ("key", row.id), before={"name": row.name, "role": row.role})
    return row


def list_keys(session: Session) -> Sequence[ApiKey]:
    """Return all keys, oldest first."""
    return session.scalars(select(ApiKey).order_by(ApiKey.id)).all()


def _digest(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()
