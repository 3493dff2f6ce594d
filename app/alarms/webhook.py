"""Webhooks, signed as Standard Webhooks 1.0 says; to public addresses unless a network is allowed."""

import base64
import hashlib
import hmac
import ipaddress
import logging
import socket
import time

import httpx

from app.alarms.failure import DeliveryError, RefusedError
from app.alarms.message import Message
from casebase.alarms.outbox import SECRET_PREFIX

TIMEOUT_S = 10.0
GONE = 410
NAT64 = ipaddress.ip_network("64:ff9b::/96")
"""Behind these addresses of IPv6 are those of IPv4 (RFC 6052)."""
Address = ipaddress.IPv4Address | ipaddress.IPv6Address

logging.getLogger("httpx").setLevel(logging.WARNING)  # it would log addresses, which may hold what nobody is to see


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
    headers = signed(secret, message.id, int(time.time()), content)
    headers |= {"Content-Type": "application/json", "Host": target.netloc.decode("ascii"), "User-Agent": "gearcase"}
    try:
        with (
            httpx.Client(trust_env=False, follow_redirects=False, timeout=TIMEOUT_S) as client,
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
