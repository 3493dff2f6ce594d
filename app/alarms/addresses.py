"""Where messages may go: looked at when a receiver is made, and again at every attempt.

Mail server and broker are those of the settings. Webhooks are at public addresses unless a network is allowed.
"""

import ipaddress
import re
import socket
from collections.abc import Mapping
from contextlib import suppress
from urllib.parse import unquote, urlsplit

import httpx
from pydantic import SecretStr

from app.alarms.message import DeliveryError
from app.settings import Settings

MAIL_PORTS = {"smtp+starttls": 587, "smtps": 465, "smtp": 25}
MQTT_PORTS = {"mqtts": 8883, "mqtt": 1883}
EMAIL = re.compile(r"[^@\s<>,;:\"()\[\]\x00-\x1f\x7f]{1,64}@(?:[a-z0-9-]+\.)*[a-z][a-z0-9-]*", re.IGNORECASE)
ASCII = re.compile(r"[\x21-\x7e]{1,2000}")
LABEL = re.compile(r"(?!-)[a-z0-9_-]{1,63}(?<!-)")
NUMBER = re.compile(r"\d+|0x[0-9a-f]*")  # such a last label makes a host a number, which has to be four plain ones
NAT64 = ipaddress.ip_network("64:ff9b::/96")  # behind these are addresses of IPv4 (RFC 6052)
ROUTED = (NAT64, ipaddress.ip_network("::ffff:0:0/96"), ipaddress.ip_network("2000::/3"))
# no other address of IPv6 is given to anybody of the public internet (RFC 4291)
Address = ipaddress.IPv4Address | ipaddress.IPv6Address


Server = tuple[str, str, int, str, str]  # scheme, host, port, user and password


class NoAddressError(DeliveryError):
    """No address is known of a host, at the moment."""


def mail_server(settings: Settings) -> Server:
    """Return the mail server; raises DeliveryError where none is set."""
    return _server("mail server", settings.smtp_url, "GEARCASE_SMTP_URL", MAIL_PORTS)


def broker(settings: Settings) -> Server:
    """Return the MQTT broker; raises DeliveryError where none is set."""
    return _server("MQTT broker", settings.mqtt_url, "GEARCASE_MQTT_URL", MQTT_PORTS)


def _server(what: str, url: SecretStr | None, name: str, ports: Mapping[str, int]) -> Server:
    if url is None:
        scheme, port = next(iter(ports.items()))
        raise DeliveryError(f"no {what} is set: {name} has to name it, as {scheme}://user:password@host:{port}")
    try:
        parts = urlsplit(url.get_secret_value())
        host, usual = check_host(parts.hostname or ""), ports[parts.scheme]
        user, password = (unquote(each or "", errors="strict") for each in (parts.username, parts.password))
        server = parts.scheme, host, parts.port or usual, user, password
    except (ValueError, KeyError):
        schemes = " or ".join(f"{each}://" for each in ports)
        raise DeliveryError(f"{name} begins with {schemes}, then user:password@host:port") from None
    return server


def check_receiver(settings: Settings, kind: str, address: str) -> None:
    """Refuse a receiver that no message could reach; a host that has no address now may get one.

    Args:
        address: an e-mail address, the URL of a webhook, or an MQTT topic.

    Raises:
        DeliveryError: if the address is not one of its kind or not to be reached, or the server of its kind is not set.
    """
    if kind == "email":
        mail_server(settings)
        if not EMAIL.fullmatch(address):
            raise DeliveryError(f"an e-mail address is one such as team@example.com, got {address[:60]!r}")
        check_host(address.rpartition("@")[2].lower())
    elif kind == "mqtt":
        broker(settings)
        if re.search(r"[+#\x00-\x1f]", address) or not 0 < len(address.encode()) <= 1000:
            raise DeliveryError("an MQTT topic to publish to has no '+', '#' and control characters")
    else:
        with suppress(NoAddressError):
            allowed_address(webhook_url(address), settings.webhook_networks)


def check_host(host: str) -> str:
    """Return a host, in lower case, that may be one; raises DeliveryError."""
    labels = host.removesuffix(".").split(".")
    with suppress(ValueError):
        if NUMBER.fullmatch(labels[-1]) or ":" in host:
            if ipaddress.ip_address(host) and "%" not in host:
                return host
        # `host` of a URL decodes a label that begins with xn--, if it can
        elif len(host) < 254 and all(LABEL.fullmatch(each) and httpx.URL(f"http://{each}").host for each in labels):
            return host
    raise DeliveryError(f"{host[:60]!r} is neither the name of a host nor an address such as 192.0.2.1")


def webhook_url(address: str) -> httpx.URL:
    """Return the URL of a webhook; raises DeliveryError if it cannot be one."""
    with suppress(ValueError, httpx.InvalidURL):
        url = httpx.URL(address)
        check_host(url.raw_host.decode("ascii"))
        fits = ASCII.fullmatch(address) and not url.userinfo and (url.port is None or 0 < url.port < 65536)
        if fits and url.scheme in ("http", "https"):
            return url
    raise DeliveryError("a webhook is an address such as https://example.com/alarms, without a password")


def allowed_address(url: httpx.URL, networks: str) -> str:
    """Return the address to connect to: the first of a host all of whose addresses may be reached.

    Args:
        networks: those that are not public and allowed, separated by commas.

    Raises:
        NoAddressError: if the host has no address.
        DeliveryError: if it has one that is neither public nor allowed.
    """
    host = url.raw_host.decode("ascii")  # as it was given: `url.host` decodes it, and a resolver may encode otherwise
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except OSError as error:
        raise NoAddressError(f"the host {host!r} has no address: {error}") from None
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
        if not any(ip in network for network in ROUTED):
            return False
        inner += [ip.ipv4_mapped, ip.sixtofour, ip.teredo and ip.teredo[1]]
        inner += [ipaddress.IPv4Address(int(ip) & 0xFFFFFFFF) if ip in NAT64 else None]
    return all(each is None or (each.is_global and not each.is_multicast) for each in inner)
