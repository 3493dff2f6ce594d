"""Receivers, and the outbox: messages that are to be sent, each written in the transaction of what it tells.

A message and the job that is to send it are there exactly if what it tells is there. Workers and the network
are the matter of `app.jobs` and `app.alarms`.
"""

import base64
import re
import secrets
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
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
ACTOR = "alarms"
CLOCK = re.compile(r"(?:[01]\d|2[0-3]):[0-5]\d")
RETRIES = tuple(
    timedelta(seconds=each) for each in (5, 300, 1800, 2 * 3600, 5 * 3600, 10 * 3600, 14 * 3600, 20 * 3600, 24 * 3600)
)
"""How long after each failed attempt the next one is made. Source: Standard Webhooks 1.0, which recommends these."""


def add_receiver(
    session: Session, name: str, kind: str, address: str, quiet: tuple[str, str] | None = None
) -> AlarmReceiver:
    """Make a receiver; a webhook gets a secret, which is in the row's `secret` and shown to nobody later.

    Args:
        address: an e-mail address, the URL of a webhook, or an MQTT topic, as `app.alarms.addresses` allows it.
        quiet: from and to, HH:MM in the time of the site.

    Raises:
        InvalidRequestError: if there is no such kind, or the hours are none.
    """
    check_choice("kind", kind, RECEIVER_KINDS)
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


def order(session: Session, delivery: Delivery, not_before: datetime | None = None, by: str = ACTOR) -> None:
    """Order the job that makes the next attempt; a job that was ordered before may not any more."""
    job = StoredJob(id=new_id(), kind=KIND, submitted_by=by, not_before=not_before, steps=[JobStep()])
    job.parameters = {"delivery": delivery.id, "job": job.id}
    session.add(job)
    delivery.state, delivery.job_id, delivery.next_at = "waiting", job.id, not_before


def send_now(session: Session, delivery_id: str) -> Delivery:
    """Begin anew with what was given up or waits for a later attempt, quiet hours or not.

    Raises:
        NotFoundError: if there is no such delivery.
        ConflictError: if it was sent, or is being sent.
    """
    row = session.get(Delivery, delivery_id, with_for_update=True)
    if row is None:
        raise NotFoundError(f"no delivery has the id {delivery_id!r}")
    job = None if row.job_id is None else session.get(StoredJob, row.job_id)
    due = row.state == "waiting" and (row.next_at is None or row.next_at <= now())
    if row.state == "sent" or (due and job is not None and job.finished_at is None):
        raise ConflictError("this message was sent" if row.state == "sent" else "this message is being sent")
    row.attempts = 0
    order(session, row, by=audit.actor_of(session))
    session.flush()
    return row


def count_lost(session: Session) -> None:
    """Count an attempt where a job ended without one; given up if somebody cancelled it."""
    jobs = select(Delivery, StoredJob.state).join(StoredJob, StoredJob.id == Delivery.job_id)
    ended = jobs.where(Delivery.state == "waiting", StoredJob.finished_at.is_not(None))
    for row, state in session.execute(ended.with_for_update(of=Delivery)):
        failed(session, row, f"the job that was to send it is {state}", final=state == "cancelled")


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


def failed(session: Session, delivery: Delivery, reason: str, *, final: bool = False) -> None:
    """Note that an attempt failed, and order the next one; given up where there is none, or this is to be the last."""
    left = () if final else RETRIES[delivery.attempts : delivery.attempts + 1]
    delivery.attempts += 1
    delivery.error = "".join(each if each.isprintable() else " " for each in reason)[:500]  # not all can be stored
    delivery.state, delivery.next_at = "failed", None
    if left:
        order(session, delivery, now() + left[0])
