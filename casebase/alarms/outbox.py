"""Receivers, and the outbox: messages that are to be sent, each written in the transaction of what it tells.

A message and the job that is to send it are there exactly if what it tells is there. Workers and the network
are the matter of `app.jobs` and `app.alarms`.
"""

import base64
import re
import secrets
from collections.abc import Mapping, Sequence
from datetime import datetime
from urllib.parse import urlsplit

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.description import check_choice
from casebase.errors import ConflictError, InvalidRequestError, NotFoundError
from casebase.store import audit
from casebase.store.models import RECEIVER_KINDS, AlarmReceiver, AlarmRule, Delivery, JobStep, StoredJob, new_id, now
from casebase.store.pagination import Page, page

KIND = "deliveries"
"""Of the jobs that send."""
SECRET_PREFIX = "whsec_"  # noqa: S105 - how secrets of Standard Webhooks begin
CLOCK = re.compile(r"(?:[01]\d|2[0-3]):[0-5]\d")
EMAIL = re.compile(r"[^@\s<>,;:\"()\[\]]{1,64}@[A-Za-z0-9.-]{1,185}")


def add_receiver(
    session: Session, name: str, kind: str, address: str, quiet: tuple[str, str] | None = None
) -> AlarmReceiver:
    """Make a receiver; a webhook gets a secret, which is in the row's `secret` and shown to nobody later.

    Args:
        address: an e-mail address, the URL of a webhook, or an MQTT topic.
        quiet: from and to, HH:MM in the time of the site.

    Raises:
        InvalidRequestError: if the address is not one of its kind, or the hours are none.
    """
    check_choice("kind", kind, RECEIVER_KINDS)
    _check_address(kind, address)
    if quiet is not None and (not all(CLOCK.fullmatch(each) for each in quiet) or quiet[0] == quiet[1]):
        raise InvalidRequestError("quiet hours are two different times such as 22:00 and 06:00")
    secret = SECRET_PREFIX + base64.b64encode(secrets.token_bytes(32)).decode() if kind == "webhook" else None
    begins, ends = quiet or (None, None)
    row = AlarmReceiver(
        name=name,
        kind=kind,
        address=address,
        secret=secret,
        quiet_from=begins,
        quiet_to=ends,
        created_by=audit.actor_of(session),
    )
    session.add(row)
    session.flush()
    shown = {"name": name, "kind": kind, "address": shown_address(row)}
    audit.record(session, "receiver.created", ("receiver", row.id), after=shown)
    return row


def _check_address(kind: str, address: str) -> None:
    if kind == "email" and not EMAIL.fullmatch(address):
        raise InvalidRequestError(f"an e-mail address is one such as team@example.com, got {address[:60]!r}")
    if kind == "mqtt" and (re.search(r"[+#\x00-\x1f]", address) or not 0 < len(address.encode()) <= 1000):
        raise InvalidRequestError("an MQTT topic to publish to has no '+', '#' and control characters")
    if kind == "webhook":
        try:
            parts = urlsplit(address)
            fits = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:
            fits = False
        if not fits or parts.username is not None or not re.fullmatch(r"[\x21-\x7e]{1,2000}", address):
            raise InvalidRequestError("a webhook is an address such as https://example.com/alarms, without a password")


def shown_address(receiver: AlarmReceiver) -> str:
    """Return the address as it is shown: of a webhook without its path, by which some services know their sender."""
    if receiver.kind != "webhook":
        return receiver.address
    parts = urlsplit(receiver.address)
    return f"{parts.scheme}://{parts.netloc}" + ("/…" if parts.path.strip("/") or parts.query else "")


def get_receiver(session: Session, receiver_id: str) -> AlarmReceiver:
    """Return a receiver; raises NotFoundError."""
    row = session.get(AlarmReceiver, receiver_id)
    if row is None:
        raise NotFoundError(f"no receiver has the id {receiver_id!r}")
    return row


def list_receivers(session: Session) -> Sequence[AlarmReceiver]:
    """Return all receivers, oldest first."""
    return session.scalars(select(AlarmReceiver).order_by(AlarmReceiver.id)).all()


def remove_receiver(session: Session, receiver_id: str) -> None:
    """Remove a receiver that no rule names.

    Raises:
        NotFoundError: if there is none.
        ConflictError: if a rule names it.
    """
    row = get_receiver(session, receiver_id)
    naming = [rule.name for rule in session.scalars(select(AlarmRule)) if receiver_id in rule.receivers]
    if naming:
        raise ConflictError(f"rules still name this receiver: {', '.join(naming[:5])}; remove them first")
    shown = {"name": row.name, "kind": row.kind, "address": shown_address(row)}
    audit.record(session, "receiver.removed", ("receiver", row.id), before=shown)
    session.delete(row)


def post(session: Session, receivers: Sequence[str], message: Mapping[str, object]) -> list[Delivery]:
    """Put a message for each of the receivers into the outbox, and order the jobs that send them."""
    rows = session.scalars(select(AlarmReceiver).where(AlarmReceiver.id.in_(receivers))).all()
    posted = [Delivery(id=new_id(), receiver_id=row.id, receiver_name=row.name, message=dict(message)) for row in rows]
    session.add_all(posted)
    for delivery in posted:
        order(session, delivery)
    session.flush()
    return posted


def post_test(session: Session, receiver_id: str) -> Delivery:
    """Put a message that says that it is a test into the outbox; quiet hours do not hold it. Raises NotFoundError."""
    receiver = get_receiver(session, receiver_id)
    return post(session, [receiver.id], {"kind": "test", "asked_by": audit.actor_of(session)})[0]


def order(session: Session, delivery: Delivery, not_before: datetime | None = None) -> None:
    """Order the job that makes the next attempt; a job that was ordered before may not any more."""
    job = StoredJob(id=new_id(), kind=KIND, submitted_by="alarms", not_before=not_before, steps=[JobStep()])
    job.parameters = {"delivery": delivery.id, "job": job.id}
    session.add(job)
    delivery.state, delivery.job_id, delivery.next_at = "waiting", job.id, not_before


def send_again(session: Session, delivery_id: str) -> Delivery:
    """Order another attempt of what was given up, or whose job somebody cancelled.

    Raises:
        NotFoundError: if there is no such delivery.
        ConflictError: if it was sent, or is still to be sent.
    """
    row = session.get(Delivery, delivery_id, with_for_update=True)
    if row is None:
        raise NotFoundError(f"no delivery has the id {delivery_id!r}")
    job = None if row.job_id is None else session.get(StoredJob, row.job_id)
    waits = row.state == "waiting" and job is not None and job.finished_at is None
    if row.state == "sent" or waits:
        raise ConflictError("this message was sent" if row.state == "sent" else "this message is waiting to be sent")
    order(session, row)
    session.flush()
    return row


def list_deliveries(
    session: Session, *, state: str | None = None, limit: int = 50, cursor: str | None = None
) -> Page[Delivery]:
    """Return a page of the outbox, newest first."""
    statement = select(Delivery)
    if state is not None:
        statement = statement.where(Delivery.state == state)
    return page(session, statement, Delivery.id, limit=limit, cursor=cursor)


def sent(delivery: Delivery) -> None:
    """Note that a message has been taken."""
    delivery.state, delivery.sent_at = "sent", now()
    delivery.attempts += 1
    delivery.error = delivery.next_at = None


def failed(session: Session, delivery: Delivery, reason: str, again_at: datetime | None) -> None:
    """Note that an attempt failed, and order the next one; given up where there is none."""
    delivery.attempts += 1
    delivery.error = reason[:500]
    delivery.state, delivery.next_at = "failed", None
    if again_at is not None:
        order(session, delivery, again_at)
