"""What every request passes before a route sees it: record, headers, body limit."""

import asyncio
import re
import secrets
import time

import structlog
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import TooLarge, problem_answer
from app.metrics import Metrics
from app.settings import Settings
from casebase import audit

log = structlog.get_logger("gearcase.request")

CLIENT_LEFT = 499
"""Status in log and metrics of a request whose client left before there was an answer; nobody gets it."""

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


class RequestRecord:
    """Gives the request its id, and writes one log entry and the metrics when it has been answered."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

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
        route = getattr(scope.get("route"), "path", "(none)")
        self.metrics.requests.labels(scope["method"], route, status).inc()
        self.metrics.seconds.labels(scope["method"], route).observe(seconds)
        log.info(
            "request",
            method=scope["method"],
            path=scope["path"],
            status=status,
            ms=round(1000 * seconds, 1),
            actor=scope.get("state", {}).get("actor"),
            client=(scope.get("client") or ("",))[0],
        )


class SecurityHeaders:
    """Adds the headers that keep browsers strict; a route may set its own."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

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


class HeadIsGet:
    """Answers HEAD wherever GET is answered: the same checks, status and headers, and no body.

    An answer that would be streamed is broken off once its headers are known.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

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


class Faults:
    """Answers what nobody foresaw, so that the answer passes what every answer passes: a page stays a page.

    Starlette's own answer comes from outside of everything else. An answer that has begun can only be broken off.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        begun = False

        async def send_noted(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            await self.app(scope, receive, send_noted)
        except ClientDisconnect:
            raise
        except Exception as error:
            if begun or scope["type"] != "http":
                raise
            await problem_answer(Request(scope), error)(scope, receive, send)


class BodyLimit:
    """Refuses a request that is too large before it has been read whole.

    A declared length is refused at once, an undeclared one as soon as the bytes counted pass the limit. Starlette's
    own limit answers in plain text and replaces answers such as 401, hence this one.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self.app = app
        self.settings = settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        upload = headers.get("content-type", "").lower().startswith("multipart/form-data")
        limit = self.settings.upload_bytes if upload else self.settings.document_bytes
        declared = headers.get("content-length", "")
        if declared.isascii() and declared.isdigit() and int(declared) > limit:
            answer = problem_answer(Request(scope), _too_large(int(declared), limit, upload))
            answer.headers["Connection"] = "close"
            await answer(scope, receive, send)
            return
        counted = 0

        async def receive_counted() -> Message:
            nonlocal counted
            message = await receive()
            if message["type"] == "http.request":
                counted += len(message.get("body", b""))
                if counted > limit:
                    # an HTTPException, because FastAPI turns any other error while it reads a body into 400
                    raise HTTPException(413, _too_large(counted, limit, upload).detail or "")
            return message

        await self.app(scope, receive_counted, send)


def _too_large(size: int, limit: int, upload: bool) -> TooLarge:
    kind = "an upload" if upload else "a request that is no upload (multipart/form-data)"
    return TooLarge(f"The request has {size} bytes or more; {kind} may have {limit}. See /api/v1/limits.")
