"""The job that sends one message of the outbox: an attempt, and the order of the next one where it fails.

It has no tasks, so that no message waits behind a simulation: other threads plan and finish jobs than do tasks.

E-mail by SMTP. Topics of an MQTT broker, at quality of service 2: exactly once within a connection. Webhooks, signed as
Standard Webhooks 1.0 says, to public addresses unless a network is allowed.
"""

import base64
import hashlib
import hmac
import ipaddress
import logging
import smtplib
import socket
import ssl
from contextlib import suppress
from datetime import UTC, datetime, time, timedelta
from email.message import EmailMessage
from email.utils import format_datetime
from urllib.parse import unquote, urlsplit
from zoneinfo import ZoneInfo

import httpx
import structlog
from paho.mqtt.client import Client, ConnectFlags
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from app.alarms.message import DeliveryError, Message, RefusedError, message_of
from app.jobs.job import JobKind, Json
from app.settings import Settings, settings_of
from casebase.alarms import outbox
from casebase.alarms.outbox import SECRET_PREFIX
from casebase.library import CaseLibrary
from casebase.store.models import AlarmReceiver, Delivery, now

MAIL_TIMEOUT_S = 20.0
MAIL_PORTS = {"smtp": 25, "smtp+starttls": 587, "smtps": 465}
MQTT_TIMEOUT_S = 15.0
EXACTLY_ONCE = 2
MQTT_PORTS = {"mqtt": 1883, "mqtts": 8883}
WEBHOOK_TIMEOUT_S = 10.0
GONE = 410
NAT64 = ipaddress.ip_network("64:ff9b::/96")
"""Behind these addresses of IPv6 are those of IPv4 (RFC 6052)."""
Address = ipaddress.IPv4Address | ipaddress.IPv6Address

logging.getLogger("httpx").setLevel(logging.WARNING)  # it would log addresses, which may hold what nobody is to see


def send_email(settings: Settings, address: str, message: Message) -> None:
    """Send a message to one address; the server knows it by its Message-ID where it comes twice.

    Raises:
        RefusedError: if the server refuses it for good (5xx; RFC 5321, 4.2.1).
        DeliveryError: if the server cannot be reached or does not take it now.
    """
    if settings.smtp_url is None:
        raise DeliveryError("no mail server is set: GEARCASE_SMTP_URL")
    parts = urlsplit(settings.smtp_url.get_secret_value())
    if parts.scheme not in MAIL_PORTS or not parts.hostname:
        raise DeliveryError("GEARCASE_SMTP_URL begins with smtp+starttls://, smtps:// or smtp:// and names a host")
    host, port = parts.hostname, parts.port or MAIL_PORTS[parts.scheme]
    try:
        with _connected(parts.scheme, host, port) as server:
            if parts.username:
                server.login(unquote(parts.username), unquote(parts.password or ""))
            server.send_message(email_of(settings.mail_from, address, message))
    except smtplib.SMTPRecipientsRefused as error:
        code, words = next(iter(error.recipients.values()))
        raise _refusal(code, words) from None
    except smtplib.SMTPResponseException as error:
        raise _refusal(error.smtp_code, error.smtp_error) from None
    except (smtplib.SMTPException, OSError, ValueError) as error:
        raise DeliveryError(f"the mail server {host}:{port} did not take it: {error}") from None


def _connected(scheme: str, host: str, port: int) -> smtplib.SMTP:
    context = ssl.create_default_context()
    if scheme == "smtps":
        return smtplib.SMTP_SSL(host, port, timeout=MAIL_TIMEOUT_S, context=context)
    server = smtplib.SMTP(host, port, timeout=MAIL_TIMEOUT_S)
    if scheme == "smtp+starttls":
        try:
            server.starttls(context=context)
        except BaseException:
            with suppress(smtplib.SMTPException, OSError):
                server.close()
            raise
    return server


def _refusal(code: int, words: bytes | str) -> DeliveryError:
    told = words.decode("utf-8", "replace") if isinstance(words, bytes) else words
    kind = RefusedError if code >= 500 else DeliveryError
    return kind(f"the mail server answered {code} {told}")


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
    if settings.mqtt_url is None:
        raise DeliveryError("no MQTT broker is set: GEARCASE_MQTT_URL")
    parts = urlsplit(settings.mqtt_url.get_secret_value())
    if parts.scheme not in MQTT_PORTS or not parts.hostname:
        raise DeliveryError("GEARCASE_MQTT_URL begins with mqtts:// or mqtt:// and names a host")
    client = Client(CallbackAPIVersion.VERSION2, client_id=f"gearcase-{message.id}")
    client.connect_timeout = MQTT_TIMEOUT_S
    if parts.username:
        client.username_pw_set(unquote(parts.username), unquote(parts.password or ""))
    if parts.scheme == "mqtts":
        client.tls_set_context(ssl.create_default_context())
    answers: list[str] = []

    def connected(
        _client: Client, _userdata: object, _flags: ConnectFlags, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        if reason.is_failure:
            answers.append(str(reason))

    client.on_connect = connected
    where = f"the MQTT broker {parts.hostname}:{parts.port or MQTT_PORTS[parts.scheme]}"
    try:
        client.connect(parts.hostname, parts.port or MQTT_PORTS[parts.scheme])
        client.loop_start()
        published = client.publish(topic, message.json, qos=EXACTLY_ONCE)
        published.wait_for_publish(MQTT_TIMEOUT_S)
        if not published.is_published():
            raise DeliveryError(f"{where} did not take it: {answers[0] if answers else 'no answer in time'}")
    except (OSError, ValueError, RuntimeError) as error:
        raise DeliveryError(f"{where} did not take it: {error}") from None
    finally:
        client.disconnect()
        client.loop_stop()


def post_webhook(url: str, secret: str, networks: str, message: Message) -> None:
    """Send a message to a webhook. It follows no redirect and connects to the address that was looked at.

    Args:
        networks: those that are not public and allowed, separated by commas.

    Raises:
        RefusedError: if the receiver answers 410: it wants no more.
        DeliveryError: if it cannot be reached, may not be reached, or does not answer 2xx.
    """
    target = httpx.URL(url)
    address = allowed_address(target.host, target.port or (443 if target.scheme == "https" else 80), networks)
    content = message.json
    headers = signed(secret, message.id, int(now().timestamp()), content)
    headers |= {"Content-Type": "application/json", "Host": target.netloc.decode("ascii"), "User-Agent": "gearcase"}
    try:
        with (
            httpx.Client(trust_env=False, follow_redirects=False, timeout=WEBHOOK_TIMEOUT_S) as client,
            client.stream(
                "POST",
                target.copy_with(host=address),
                content=content,
                headers=headers,
                extensions={"sni_hostname": target.host},
            ) as answer,
        ):
            status = answer.status_code
    except httpx.HTTPError as error:
        raise DeliveryError(f"the webhook did not answer: {error or type(error).__name__}") from None
    if status == GONE:
        raise RefusedError("the webhook answered 410: it wants no more messages")
    if not 200 <= status < 300:
        redirect = "; redirects are not followed, give the address that it leads to" if 300 <= status < 400 else ""
        raise DeliveryError(f"the webhook answered {status}{redirect}")


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


def allowed_address(host: str, port: int, networks: str) -> str:
    """Return the address to connect to: the first of a host all of whose addresses may be reached.

    Raises:
        DeliveryError: if the host has no address, or one that is neither public nor allowed.
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise DeliveryError(f"the host {host!r} has no address: {error}") from None
    addresses = [str(each[4][0]).partition("%")[0] for each in found]
    allowed = [ipaddress.ip_network(each.strip()) for each in networks.split(",") if each.strip()]
    for address in addresses:
        ip = ipaddress.ip_address(address)
        if not (is_public(ip) or any(ip in network for network in allowed)):
            raise DeliveryError(
                f"{host!r} is at {address}, which is not public; GEARCASE_WEBHOOK_NETWORKS can allow its network"
            )
    return addresses[0]


def is_public(ip: Address) -> bool:
    """Whether an address, and the one of IPv4 that it may stand for, is one of the public internet.

    >>> [is_public(ipaddress.ip_address(each)) for each in ("1.1.1.1", "10.0.0.1", "::ffff:127.0.0.1")]
    [True, False, False]
    """
    inner: list[Address | None] = [ip]
    if isinstance(ip, ipaddress.IPv6Address):
        inner += [ip.ipv4_mapped, ip.sixtofour, ip.teredo and ip.teredo[1]]
        inner += [ipaddress.IPv4Address(int(ip) & 0xFFFFFFFF) if ip in NAT64 else None]
    return all(each is None or (each.is_global and not each.is_multicast) for each in inner)


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
