"""Gates: few of what costs much are let in at once, of one key and of all; the others wait where they cost nothing."""

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import Depends, Request

from app.http.security import NOBODY, known


class ConcurrencyLimiter:
    """Lets so many in at once, of all keys together and of each.

    Who waits holds no thread, no session and nothing of its request's body.
    """

    def __init__(self, at_once: int, per_key: int) -> None:
        self._all = asyncio.Semaphore(at_once)
        self._each: defaultdict[str, asyncio.Semaphore] = defaultdict(lambda: asyncio.Semaphore(per_key))

    @asynccontextmanager
    async def enter(self, key_id: str) -> AsyncIterator[None]:
        async with self._each[key_id], self._all:
            yield


async def looking(request: Request) -> AsyncIterator[None]:
    """Dependency of routes that draw or compute what somebody looks at: it comes first, before a session is opened."""
    gate: ConcurrencyLimiter = request.app.state.looking
    principal = known(request)
    async with gate.enter(NOBODY if principal is None else principal.key_id):
        yield


ReadingLimit = Depends(looking, scope="function")
