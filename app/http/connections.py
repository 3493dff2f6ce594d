"""Connections: few enough for the process, none that waits for its client for ever, and a log that stays small."""

import asyncio
import errno
import json
import resource
from typing import Any, cast

import structlog
from uvicorn.protocols.http.h11_impl import H11Protocol

from app.settings import Settings

log = structlog.get_logger(__name__)

BACKLOG = 128
"""Connections that wait to be accepted; asyncio tries so often at once, also where it cannot accept any."""

NO_RESOURCE = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
QUIET_S = 60.0
"""Between two entries in the log of the same want [s]."""

PROBLEM = json.dumps(
    {
        "type": "unavailable",
        "title": "The service cannot do this at the moment",
        "status": 503,
        "detail": "All connections of the service are at work. Send it again in a few seconds.",
    }
).encode()
BUSY = b"\r\n".join(
    (
        b"HTTP/1.1 503 Service Unavailable",
        b"Content-Type: application/problem+json",
        b"Content-Length: %d" % len(PROBLEM),
        b"Retry-After: 5",
        b"Connection: close",
        b"",
        PROBLEM,
    )
)


class Bounded(H11Protocol):
    """A connection that is closed when the head of a request takes too long, and makes room when others need it.

    The time runs from when the connection could take a request, whatever trickles in meanwhile.
    """

    header_timeout_s: float
    most: int
    waits_since = 0.0
    _timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._watch()
        if not self._has_room():
            transport.write(BUSY)
            transport.close()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._unwatch()

    @property
    def waits_for_request(self) -> bool:
        return self.cycle is None or self.cycle.response_complete

    @property
    def is_expendable(self) -> bool:
        """Whether it waits for its client, who has shown no key for what is under way."""
        if self.waits_for_request:
            return True
        return self.cycle.more_body and "principal" not in self.cycle.scope["state"]

    def _watch(self) -> None:
        if not self.waits_for_request or self.transport.is_closing():
            self._unwatch()
        elif self._timer is None:
            self.waits_since = self.loop.time()
            self._timer = self.loop.call_later(self.header_timeout_s, self.timeout_keep_alive_handler)

    def _unwatch(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _has_room(self) -> bool:
        """Whether this connection may stay, perhaps in the place of the one that has waited longest for its client."""
        there = [cast(Bounded, each) for each in self.connections if not each.transport.is_closing()]
        if len(there) <= self.most:
            return True
        waiting = [each for each in there if each is not self and each.is_expendable]
        if waiting:
            min(waiting, key=lambda each: each.waits_since).transport.abort()
        return bool(waiting)


def protocol_of(settings: Settings) -> type[Bounded]:
    """Return the protocol with the limits of an installation."""
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)

    class Limited(Bounded):
        header_timeout_s = settings.header_timeout_s
        most = settings.connections if descriptors < 0 else max(1, min(settings.connections, descriptors // 2))

    return Limited


class Wants:
    """The event loop's exception handler that says once in a while that connections cannot be accepted."""

    def __init__(self) -> None:
        self._times = 0
        self._quiet_until = 0.0

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if not isinstance(error, OSError) or error.errno not in NO_RESOURCE:
            loop.default_exception_handler(context)
            return
        self._times += 1
        if loop.time() >= self._quiet_until:
            self._quiet_until = loop.time() + QUIET_S
            log.error("connections cannot be accepted", reason=error.strerror, attempts_so_far=self._times)
