"""The job that sends one message of the outbox: an attempt, and the order of the next one where it fails.

It has no tasks, so that no message waits behind a simulation: other threads plan and finish jobs than do tasks.

E-mail by SMTP. Topics of an MQTT broker, at quality of service 2: exactly once within a connection. Webhooks, signed as
Standard Webhooks 1.0 says, to public addresses unless a network is allowed.
"""

import asyncio
import base64
import hashlib
import hmac
import logging
import smtplib
import socket
import ssl
from contextlib import closing, suppress
from datetime import UTC, datetime, time, timedelta
from email.message import EmailMessage
from email.utils import format_datetime
from threading import Timer
from zoneinfo import ZoneInfo

import httpx
import structlog
from paho.mqtt.client import Client, ConnectFlags
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from app.alarms.addresses import allowed_address, broker, mail_server, webhook_url
from app.alarms.message import DeliveryError, Message, RefusedError, message_of
from app.jobs.job import JobKind, Json
from app.settings import Settings, settings_of
from casebase.alarms import outbox
from casebase.alarms.outbox import SECRET_PREFIX
from casebase.library import CaseLibrary
from casebase.store.models import AlarmReceiver, Delivery, StoredJob, now

MAIL_TIMEOUT_S = 20.0
MQTT_TIMEOUT_S = 15.0
EXACTLY_ONCE = 2
WEBHOOK_TIMEOUT_S = 10.0
GONE = 410

logging.getLogger("httpx").setLevel(logging.WARNING)  # it would log addresses, which may hold what nobody is to see


class Mail(smtplib.SMTP):
    """A connection to a mail server; each answer has a time in all, however slowly it comes."""

    def getreply(self) -> tuple[int, bytes]:
        """Read an answer; one that does not come at all fails before."""
        assert self.sock is not None
        end = Timer(2 * MAIL_TIMEOUT_S, self.sock.shutdown, (socket.SHUT_RDWR,))
        end.start()
        try:
            return super().getreply()
        finally:
            end.cancel()


class EncryptedMail(Mail, smtplib.SMTP_SSL):
    """One that is encrypted from the start."""


def send_email(settings: Settings, address: str, message: Message) -> None:
    """Send a message to one address; the server knows it by its Message-ID where it comes twice.

    Raises:
        RefusedError: if the server refuses recipient or message for good (5xx; RFC 5321, 4.2.1).
        DeliveryError: if the server cannot be reached, does not let us in or does not take it now.
    """
    scheme, host, port, user, password = mail_server(settings)
    email = email_of(settings.mail_from, address, message)
    context = ssl.create_default_context()
    try:
        with closing(
            EncryptedMail(host, port, timeout=MAIL_TIMEOUT_S, context=context)
            if scheme == "smtps"
            else Mail(host, port, timeout=MAIL_TIMEOUT_S)
        ) as smtp:
            if scheme == "smtp+starttls":
                smtp.starttls(context=context)
            if user:
                smtp.login(user, password)
            smtp.send_message(email)
            with suppress(OSError):
                smtp.quit()  # it has the message, whatever it answers now
    except smtplib.SMTPRecipientsRefused as error:
        raise _refusal(*next(iter(error.recipients.values())), RefusedError) from None
    except smtplib.SMTPResponseException as error:
        kind = RefusedError if isinstance(error, smtplib.SMTPDataError) else DeliveryError
        raise _refusal(error.smtp_code, error.smtp_error, kind) from None
    except (OSError, ValueError) as error:  # one of Unicode would show a letter of the password
        why = "user and password may have letters of ASCII alone" if isinstance(error, UnicodeError) else error
        raise DeliveryError(f"the mail server {host}:{port} of GEARCASE_SMTP_URL did not take it: {why}") from None


def _refusal(code: int, words: bytes | str, kind: type[DeliveryError]) -> DeliveryError:
    told = words.decode("utf-8", "replace") if isinstance(words, bytes) else words
    return (kind if code >= 500 else DeliveryError)(f"the mail server answered {code} {told}")


def email_of(sender: str, address: str, message: Message) -> EmailMessage:
    """Return the message as e-mail: the same bytes at every attempt."""
    email = EmailMessage()
    email["From"], email["To"] = sender, address
    email["Subject"] = " ".join(f"[Gearcase] {message.subject}".split())
    email["Date"] = format_datetime(message.at)
    email["Message-ID"] = f"<{message.id}@{sender.rpartition('@')[2].strip('> ') or 'gearcase'}>"
    email["Auto-Submitted"] = "auto-generated"  # RFC 3834: nobody's absence is answered to it
    email.set_content(message.text)
    return email


def publish(settings: Settings, topic: str, message: Message) -> None:
    """Publish a message and wait until the broker has it.

    Raises:
        DeliveryError: if the broker cannot be reached or does not take it in time.
    """
    scheme, host, port, user, password = broker(settings)
    client = Client(CallbackAPIVersion.VERSION2, client_id=f"gearcase-{message.id}")
    client.connect_timeout = MQTT_TIMEOUT_S
    if user:
        client.username_pw_set(user, password)
    if scheme == "mqtts":
        client.tls_set_context(ssl.create_default_context())
    answers: list[str] = []

    def connected(
        _client: Client, _userdata: object, _flags: ConnectFlags, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        if reason.is_failure:
            answers.append(str(reason))

    client.on_connect = connected
    try:
        client.connect(host, port)
        client.loop_start()
        published = client.publish(topic, message.json, qos=EXACTLY_ONCE)
        published.wait_for_publish(MQTT_TIMEOUT_S)
        failure = None if published.is_published() else "no answer in time"
    except (OSError, ValueError, RuntimeError) as error:
        failure = str(error)
    finally:
        client.disconnect()
        client.loop_stop()
    if failure is not None:
        why = answers[0] if answers else failure
        raise DeliveryError(f"the MQTT broker {host}:{port} did not take it: {why}")


def post_webhook(url: str, secret: str, networks: str, message: Message) -> None:
    """Send a message to a webhook. It follows no redirect and connects to the address that was looked at.

    Args:
        networks: those that are not public and allowed, separated by commas.

    Raises:
        RefusedError: if the receiver answers 410: it wants no more.
        DeliveryError: if it cannot be reached, may not be reached, or does not answer 2xx.
    """
    target = webhook_url(url)
    address = allowed_address(target, networks)
    content = message.json
    headers = signed(secret, message.id, int(now().timestamp()), content)
    headers |= {"Content-Type": "application/json", "Host": target.netloc.decode("ascii"), "User-Agent": "gearcase"}
    try:
        status = asyncio.run(_status_of(target, address, content, headers))
    except TimeoutError:
        raise DeliveryError("the webhook did not answer in time") from None
    except httpx.HTTPError as error:
        cause: BaseException = error
        while earlier := cause.__cause__ or cause.__context__:  # the first one has the words
            cause = earlier
        raise DeliveryError(f"the webhook did not answer: {str(cause) or type(cause).__name__}") from None
    if status == GONE:
        raise RefusedError("the webhook answered 410: it wants no more messages")
    if not 200 <= status < 300:
        redirect = "; redirects are not followed, give the address that it leads to" if 300 <= status < 400 else ""
        raise DeliveryError(f"the webhook answered {status}{redirect}")


async def _status_of(target: httpx.URL, address: str, content: bytes, headers: dict[str, str]) -> int:
    """Return the status of the answer; in all it has a time, however slowly its head comes."""
    async with (
        asyncio.timeout(WEBHOOK_TIMEOUT_S),
        httpx.AsyncClient(trust_env=False, follow_redirects=False, timeout=None) as client,  # noqa: S113
        client.stream(
            "POST",
            target.copy_with(host=address),
            content=content,
            headers=headers,
            extensions={"sni_hostname": target.raw_host.decode("ascii")},
        ) as answer,
    ):
        return answer.status_code


def signed(secret: str, message_id: str, timestamp_s: int, content: bytes) -> dict[str, str]:
    """Return the headers of a message.

    Source: Standard Webhooks 1.0: `v1,` and base64 of HMAC-SHA-256 over "id.timestamp.content".
    """
    key = base64.b64decode(secret.removeprefix(SECRET_PREFIX))
    digest = hmac.new(key, f"{message_id}.{timestamp_s}.".encode() + content, hashlib.sha256).digest()
    return {
        "webhook-id": message_id,
        "webhook-timestamp": str(timestamp_s),
        "webhook-signature": f"v1,{base64.b64encode(digest).decode()}",
    }


LOG = structlog.get_logger(__name__)


def deliveries(library: CaseLibrary) -> JobKind:
    """The kind of job that sends."""
    settings = settings_of(library.data_dir)

    def finish(parameters: dict[str, Json], _results: list[Json]) -> Json:
        return {"state": attempt(library, settings, str(parameters["delivery"]), str(parameters["job"]))}

    return JobKind(outbox.KIND, "sending", plan=lambda _: [], run=lambda *_: None, finish=finish)


def attempt(library: CaseLibrary, settings: Settings, delivery_id: str, job_id: str) -> str:
    """Make one attempt at a message, unless another job is to; return the state of the delivery."""
    # a worker whose lease has ended cannot close the first transaction: it sends nothing
    with library.transaction(outbox.ACTOR) as session:
        delivery = session.get(Delivery, delivery_id)
        if delivery is None or delivery.state != "waiting" or delivery.job_id != job_id:
            return "not ours" if delivery is None else delivery.state
        receiver = session.get(AlarmReceiver, delivery.receiver_id)
        if receiver is None:
            outbox.failed(session, delivery, "the receiver was removed", final=True)
            return delivery.state
        until = quiet_until(receiver, now(), settings.time_zone)
        asked_for = session.get_one(StoredJob, job_id).submitted_by != outbox.ACTOR
        if until is not None and not asked_for and delivery.message.get("kind") != "test":
            outbox.order(session, delivery, until)
            return delivery.state
        secret = receiver.secret or ""
    failure: DeliveryError | None = None
    try:
        _send(settings, receiver, secret, message_of(delivery, settings.time_zone, settings.public_url))
    except Exception as error:  # whatever it is: a message that failed is not to wait without a word
        unforeseen = f"Gearcase failed: {type(error).__name__}; the trace is in the log of the worker"
        failure = error if isinstance(error, DeliveryError) else DeliveryError(unforeseen)
        about = {"delivery": delivery_id, "receiver": receiver.name, "error": str(failure)}
        LOG.warning("a message was not delivered", **about, exc_info=failure is not error)
    with library.transaction(outbox.ACTOR) as session:
        delivery = session.get_one(Delivery, delivery_id, with_for_update=True)
        if failure is None:
            outbox.sent(delivery)
        elif delivery.job_id == job_id:
            outbox.failed(session, delivery, str(failure), final=isinstance(failure, RefusedError))
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
