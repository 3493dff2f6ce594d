"""The job that sends one message of the outbox: an attempt, and the order of the next one where it fails.

It has no tasks, so that no message waits behind a simulation: other threads plan and finish jobs than do tasks.
"""

from datetime import UTC, datetime, time, timedelta
from zoneinfo import ZoneInfo

import structlog

from app.alarms.message import DeliveryError, Message, RefusedError, message_of
from app.alarms.senders import post_webhook, publish, send_email
from app.jobs.job import JobKind, Json
from app.settings import Settings, settings_of
from casebase.alarms import outbox
from casebase.library import CaseLibrary
from casebase.store.models import AlarmReceiver, Delivery, now

ACTOR = "alarms"
RETRIES = tuple(
    timedelta(seconds=each) for each in (5, 300, 1800, 2 * 3600, 5 * 3600, 10 * 3600, 14 * 3600, 20 * 3600, 24 * 3600)
)
"""How long after each failed attempt the next one is made. Source: Standard Webhooks 1.0, which recommends these."""
LOG = structlog.get_logger(__name__)


def deliveries(library: CaseLibrary) -> JobKind:
    """The kind of job that sends."""
    settings = settings_of(library.data_dir)

    def finish(parameters: dict[str, Json], _results: list[Json]) -> Json:
        return {"state": attempt(library, settings, str(parameters["delivery"]), str(parameters["job"]))}

    return JobKind(outbox.KIND, "sending", plan=lambda _: [], run=lambda *_: None, finish=finish)


def attempt(library: CaseLibrary, settings: Settings, delivery_id: str, job_id: str) -> str:
    """Make one attempt at a message, unless another job is to; return the state of the delivery."""
    with library.transaction(ACTOR) as session:  # which a worker whose lease has ended cannot close: it sends nothing
        delivery = session.get(Delivery, delivery_id)
        if delivery is None or delivery.state != "waiting" or delivery.job_id != job_id:
            return "not ours" if delivery is None else delivery.state
        receiver = session.get(AlarmReceiver, delivery.receiver_id)
        if receiver is None:
            outbox.failed(session, delivery, "the receiver was removed", None)
            return delivery.state
        until = quiet_until(receiver, now(), settings.time_zone)
        if until is not None and delivery.message.get("kind") != "test":
            outbox.order(session, delivery, until)
            return delivery.state
        message = message_of(delivery, settings.time_zone, settings.public_url)
        secret = receiver.secret or ""
    failure: DeliveryError | None = None
    try:
        _send(settings, receiver, secret, message)
    except DeliveryError as error:
        failure = error
        LOG.warning("a message was not delivered", delivery=delivery_id, receiver=receiver.name, error=str(error))
    with library.transaction(ACTOR) as session:
        delivery = session.get_one(Delivery, delivery_id, with_for_update=True)
        if failure is None:
            outbox.sent(delivery)
        elif delivery.job_id == job_id:
            left = RETRIES[delivery.attempts : delivery.attempts + 1]
            again_at = now() + left[0] if left and not isinstance(failure, RefusedError) else None
            outbox.failed(session, delivery, str(failure), again_at)
        return delivery.state


def _send(settings: Settings, receiver: AlarmReceiver, secret: str, message: Message) -> None:
    if receiver.kind == "email":
        send_email(settings, receiver.address, message)
    elif receiver.kind == "mqtt":
        publish(settings, receiver.address, message)
    else:
        post_webhook(receiver.address, secret, settings.webhook_networks, message)


def quiet_until(receiver: AlarmReceiver, at: datetime, zone: str) -> datetime | None:
    """Return when the quiet hours of a receiver end; None where it is not in them."""
    if receiver.quiet_from is None or receiver.quiet_to is None:
        return None
    begin, end = time.fromisoformat(receiver.quiet_from), time.fromisoformat(receiver.quiet_to)
    local = at.astimezone(ZoneInfo(zone))
    clock = local.time()
    inside = begin <= clock < end if begin < end else clock >= begin or clock < end
    if not inside:
        return None
    day = local.date() + timedelta(days=1 if clock >= end else 0)
    return datetime.combine(day, end, local.tzinfo).astimezone(UTC)
