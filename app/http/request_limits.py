"""Limits of a request: who may send, how much may be carried in and for how long, before one byte of a body is read.

All of it is known from the route alone, by the dependencies that it declares: its guards (`Viewer`, `PageAdmin` and
the like) and whether it takes uploads. What the client calls its body raises no limit.
"""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from fastapi import FastAPI, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.dependencies.models import Dependant
from fastapi.routing import RouteContext, iter_route_contexts
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.http.errors import TooLarge
from app.http.security import Guard
from app.http.uploads import is_form, upload_of
from app.settings import Settings


@dataclass(frozen=True)
class RouteLimits:
    """What a route asks of a request: its guards, and whether it takes an upload."""

    guards: tuple[Guard, ...] = ()
    takes_upload: bool = False


@dataclass(frozen=True)
class BodyLimits:
    """How much of a body is read, and how long it may take.

    Args:
        size: of the whole body [byte].
        seconds: from when somebody begins to read it until it has all arrived [s].
        kind: what such a request is called.
    """

    size: int
    seconds: float
    kind: str


@dataclass(eq=False)
class RequestLimits:
    """Asks a route's guards, and gives the route a body that ends in 413 where it is too large and in 408 where it is
    too slow."""

    app: ASGIApp
    settings: Settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        terms, headers = limits_for(scope), Headers(scope=scope)
        for guard in terms.guards:
            await run_in_threadpool(guard.admit, Request(scope))
        allowance = self._allowance(terms, headers)
        declared = headers.get("content-length", "")
        if declared.isascii() and declared.isdigit() and int(declared) > allowance.size:
            raise TooLarge(_too_large(int(declared), allowance))
        await self.app(scope, within(receive, allowance), send)

    def _allowance(self, terms: RouteLimits, headers: Headers) -> BodyLimits:
        settings = self.settings
        if not terms.guards:
            return BodyLimits(settings.anonymous_bytes, settings.body_timeout_s, "a request that needs no key")
        if terms.takes_upload and is_form(headers):
            return BodyLimits(settings.upload_bytes, settings.upload_timeout_s, "an upload")
        return BodyLimits(settings.document_bytes, settings.body_timeout_s, "a request that is no upload")


def limits_for(scope: Scope) -> RouteLimits:
    """Return the terms of the route that a request is for; the strictest where there is none."""
    for route, terms in limits_of_all(scope["app"]):
        if route.matches(scope)[0] is Match.FULL:
            return terms
    return RouteLimits()


@cache
def limits_of_all(app: FastAPI) -> tuple[tuple[RouteContext, RouteLimits], ...]:
    """Return the terms of every route; half a second, once."""
    return tuple((route, limits_of(route)) for route in iter_route_contexts(app.routes))


def limits_of(route: RouteContext) -> RouteLimits:
    """Read a route's terms off its dependencies, however deep they stand."""
    dependant: Dependant | None = getattr(route, "dependant", None)
    calls = [] if dependant is None else list(_calls(dependant))
    return RouteLimits(tuple(call for call in calls if isinstance(call, Guard)), upload_of in calls)


def _calls(dependant: Dependant) -> Iterator[object]:
    yield dependant.call
    for each in dependant.dependencies:
        yield from _calls(each)


def within(receive: Receive, allowance: BodyLimits) -> Receive:
    """Return a body that is counted and timed.

    It raises HTTPExceptions, because FastAPI turns any other error while it reads a body into 400.
    """
    loop = asyncio.get_running_loop()
    counted, deadline, whole = 0, 0.0, False

    async def receive_within() -> Message:
        nonlocal counted, deadline, whole
        if whole:
            return await receive()
        deadline = deadline or loop.time() + allowance.seconds
        try:
            async with asyncio.timeout_at(deadline):
                message = await receive()
        except TimeoutError:
            raise HTTPException(408, f"The request did not arrive within {allowance.seconds:g} s.") from None
        counted += len(message.get("body", b""))
        whole = not message.get("more_body", False)
        if counted > allowance.size:
            raise HTTPException(413, _too_large(counted, allowance))
        return message

    return receive_within


def _too_large(size: int, allowance: BodyLimits) -> str:
    return f"The request has {size} bytes or more; {allowance.kind} may have {allowance.size} here. See /api/v1/limits."
