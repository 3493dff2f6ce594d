"""E-mail by SMTP."""

import smtplib
import ssl
from contextlib import suppress
from email.message import EmailMessage
from email.utils import format_datetime
from urllib.parse import unquote, urlsplit

from app.alarms.failure import DeliveryError, RefusedError
from app.alarms.message import Message
from app.settings import Settings

TIMEOUT_S = 20.0
PORTS = {"smtp": 25, "smtp+starttls": 587, "smtps": 465}


def send_email(settings: Settings, address: str, message: Message) -> None:
    """Send a message to one address; the server knows it by its Message-ID where it comes twice.

    Raises:
        RefusedError: if the server refuses it for good (5xx; RFC 5321, 4.2.1).
        DeliveryError: if the server cannot be reached or does not take it now.
    """
    if settings.smtp_url is None:
        raise DeliveryError("no mail server is set: GEARCASE_SMTP_URL")
    parts = urlsplit(settings.smtp_url.get_secret_value())
    if parts.scheme not in PORTS or not parts.hostname:
        raise DeliveryError("GEARCASE_SMTP_URL begins with smtp+starttls://, smtps:// or smtp:// and names a host")
    host, port = parts.hostname, parts.port or PORTS[parts.scheme]
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
        return smtplib.SMTP_SSL(host, port, timeout=TIMEOUT_S, context=context)
    server = smtplib.SMTP(host, port, timeout=TIMEOUT_S)
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
