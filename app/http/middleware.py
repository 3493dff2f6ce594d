"""What every request passes before the door and its route: record, headers, the end of its connection."""

import asyncio
import re
import secrets
import time
from dataclasses import dataclass

import structlog
from prometheus_client import CollectorRegistry, Counter, Histogram, PlatformCollector, ProcessCollector
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from casebase.store import audit

SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
OTHER = "other"
"""Label of methods and paths that clients made up: there is no end to those."""


class Metrics:
    """Requests by route and status, time of each, diagnoses by verdict, refused keys."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        PlatformCollector(registry=self.registry)
        self.requests = Counter(
            "gearcase_requests", "Requests answered", ["method", "route", "status"], registry=self.registry
        )
        self.seconds = Histogram(
            "gearcase_request_seconds",
            "Time from the request's first byte to the answer's last [s]",
            ["method", "route"],
            buckets=SECONDS,
            registry=self.registry,
        )
        self.diagnoses = Counter("gearcase_diagnoses", "Diagnoses given", ["verdict", "label"], registry=self.registry)
        self.refused_keys = Counter(
            "gearcase_refused_keys", "Requests with a wrong or revoked key", registry=self.registry
        )


log = structlog.get_logger("gearcase.request")

CLIENT_LEFT = 499
"""Status in log and metrics of a request whose client left before there was an answer; nobody gets it."""

DROPPED_S, DROPPED_BYTES = 1.0, 1024 * 1024
"""How much of a body is dropped, at most, so that its sender gets to read why it was refused."""

METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
CONTENT_SECURITY_POLICY = (
    "default-src 'self'; img-src 'self' data:; media-src 'self' blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
SECURITY_HEADERS = {
    "Content-Security-Policy": CONTENT_SECURITY_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


@dataclass(eq=False)
class RequestRecord:
    """Gives the request its id, and writes one log entry and the metrics when it has been answered."""

    app: ASGIApp
    metrics: Metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        given = Headers(scope=scope).get("x-request-id", "")
        request_id = given if REQUEST_ID.fullmatch(given) else secrets.token_hex(8)
        scope["request_id"] = request_id
        status: int | None = None
        left = False
        started = time.perf_counter()

        async def receive_or_leave() -> Message:
            nonlocal left
            message = await receive()
            left = left or (message["type"] == "http.disconnect" and status is None)
            return message

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)["X-Request-ID"] = request_id
            await send(message)

        audit.STORED.set([])
        with structlog.contextvars.bound_contextvars(request_id=request_id):
            try:
                await self.app(scope, receive_or_leave, send_with_id)
            except ClientDisconnect:
                left = True
            finally:
                self._write(scope, CLIENT_LEFT if left else status or 500, time.perf_counter() - started)

    def _write(self, scope: Scope, status: int, seconds: float) -> None:
        method = scope["method"] if scope["method"] in METHODS else OTHER
        route = getattr(scope.get("route"), "path", OTHER)
        self.metrics.requests.labels(method, route, status).inc()
        self.metrics.seconds.labels(method, route).observe(seconds)
        log.info(
            "request",
            method=scope["method"],
            path=scope["path"],
            status=status,
            ms=round(1000 * seconds, 1),
            actor=scope.get("state", {}).get("actor"),
            client=(scope.get("client") or ("",))[0],
        )


@dataclass(eq=False)
class SecurityHeaders:
    """Adds the headers that keep browsers strict; a route may set its own."""

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
                if scope["path"].startswith("/api/"):
                    headers.setdefault("Cache-Control", "no-store")
            await send(message)

        await self.app(scope, receive, send_with_headers)


@dataclass(eq=False)
class HeadIsGet:
    """Answers HEAD wherever GET is answered: the same checks, status and headers, and no body.

    An answer that would be streamed is broken off once its headers are known.
    """

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self.app(scope, receive, send)
            return
        scope.setdefault("state", {})
        # a copy, for the server must still know that no body follows; a range is of GET alone
        headers = [each for each in scope["headers"] if each[0] not in (b"range", b"if-range")]
        as_get = {**scope, "method": "GET", "headers": headers}
        answered = asyncio.Event()

        async def receive_until_answered() -> Message:
            if answered.is_set():
                return {"type": "http.disconnect"}
            arrives, ends = asyncio.ensure_future(receive()), asyncio.ensure_future(answered.wait())
            try:
                await asyncio.wait((arrives, ends), return_when=asyncio.FIRST_COMPLETED)
                return arrives.result() if arrives.done() else {"type": "http.disconnect"}
            finally:
                arrives.cancel()
                ends.cancel()

        async def send_without_body(message: Message) -> None:
            if message["type"] == "http.response.start":
                await send(message)
                await send({"type": "http.response.body", "body": b""})
                answered.set()

        try:
            await self.app(as_get, receive_until_answered, send_without_body)
        finally:
            scope["route"] = as_get.get("route")


@dataclass(eq=False)
class CloseUnread:
    """Closes the connection of a request that was answered before its body had been read whole.

    Whoever still sends is given a moment to read the answer, in which a little more is taken in and dropped: a
    connection that is closed at once may take the answer with it.
    """

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope) if scope["type"] == "http" else Headers()
        if "transfer-encoding" not in headers and headers.get("content-length", "0") == "0":
            await self.app(scope, receive, send)
            return
        unread, closing, answered = True, False, False

        async def receive_noted() -> Message:
            nonlocal unread
            message = await receive()
            unread = unread and bool(message.get("more_body", False))
            return message

        async def send_closing(message: Message) -> None:
            nonlocal closing, answered
            if message["type"] == "http.response.start" and unread:
                closing = True
                MutableHeaders(scope=message)["Connection"] = "close"
            elif closing and not message.get("more_body", False):
                answered = True
                message = {**message, "more_body": True}
            await send(message)

        await self.app(scope, receive_noted, send_closing)
        if answered:
            await _drop(receive)
            await send({"type": "http.response.body", "body": b""})


async def _drop(receive: Receive) -> None:
    dropped, more = 0, True
    try:
        async with asyncio.timeout(DROPPED_S):
            while more and dropped < DROPPED_BYTES:
                message = await receive()
                dropped += len(message.get("body", b""))
                more = bool(message.get("more_body", False))
    except TimeoutError:
        return
