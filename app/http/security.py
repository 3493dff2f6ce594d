"""Who may do what: a role on every route, by key in a header or, for pages, by session in a cookie with a CSRF token.

Few of what costs much are let in at once, of one key and of all; the others wait where they cost nothing.

A role is a dependency of its route, and a `Guard`: the request limits (`app.http.request_limits`) find it there and
ask it before the body.
"""

import asyncio
import hashlib
import hmac
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Annotated

import structlog
from fastapi import Depends, Request, Security
from fastapi.security import HTTPBearer
from fastapi.security.http import HTTPAuthorizationCredentials
from fastapi.security.utils import get_authorization_scheme_param

from app.http.errors import BUSY, Forbidden, NotAuthenticated, TooManyFailures, Unavailable
from app.http.keys import PREFIX, Role, digest, find_key
from app.http.sessions import key_of_session
from app.service import Service, service_of
from casebase.store.models import ApiKey

__all__ = ["Admin", "Guard", "Operator", "Principal", "Role", "Viewer"]

log = structlog.get_logger(__name__)

COOKIE = "gearcase_session"
FORM_COOKIE = "gearcase_form"
"""Of a browser that has no key yet: its sign-in form carries the token of this cookie."""

CSRF_HEADER = "X-CSRF-Token"
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
NOBODY = "unknown"

bearer = HTTPBearer(
    auto_error=False,
    scheme_name="key",
    description=f"A key from `gearcase keys create`, as `Authorization: Bearer {PREFIX}...`",
)


@dataclass(frozen=True)
class Principal:
    """Who asks, and by what: `credential` is the id of the key, or the SHA-256 of the token of a session."""

    key_id: str
    name: str
    role: Role
    credential: str

    @property
    def actor(self) -> str:
        """How the audit log names it; the ending tells keys of the same name apart."""
        return f"{self.name[:190]}#{self.key_id[-6:]}"


def principal_of(service: Service, key: str, client: str) -> Principal:
    """Return whose key this is.

    Raises:
        NotAuthenticated: if the key is unknown or revoked.
        TooManyFailures: instead, if that happened too often from this address.
    """
    with service.library.reading() as session:
        row = find_key(session, key)
    if row is None:
        raise _refusal(service, key, client)
    return _principal(service, row, row.id)


def signed_in(service: Service, token: str) -> Principal:
    """Return whose session this is.

    Raises:
        NotAuthenticated: if there is none, or it is over.
    """
    with service.library.reading() as session:
        row = key_of_session(session, token)
    if row is None:
        raise NotAuthenticated("You are not signed in any more. Open /sign-in.")
    return _principal(service, row, digest(token))


def _principal(service: Service, row: ApiKey, credential: str) -> Principal:
    principal = Principal(row.id, row.name, Role(row.role), credential)
    service.key_notes.used(row, principal.actor)
    return principal


def _refusal(service: Service, key: str, client: str) -> Exception:
    service.metrics.refused_keys.inc()
    log.warning("key refused", client=client)
    if not service.limiter.hit(service.failed_keys, client):
        return TooManyFailures(
            f"More wrong keys than {service.settings.failed_keys} came from {client}. "
            "Wait a minute; a valid key still works.",
            headers={"Retry-After": "60"},
        )
    service.key_notes.refused(client, NOBODY)
    if not key.startswith(PREFIX):
        return NotAuthenticated(f"This is no Gearcase key: they begin with {PREFIX}. An admin can make one.")
    return NotAuthenticated("The key is unknown or has been revoked. An admin can make another one.")


def csrf_token(cookie: str) -> str:
    """Return the token that the forms of a page carry; it cannot be made without the cookie itself."""
    return hmac.new(cookie.encode(), b"gearcase form", hashlib.sha256).hexdigest()


def check_csrf(request: Request, given: str, cookie: str = COOKIE) -> None:
    """Compare the token of a form or header with the one that belongs to a cookie, by default to that of the session.

    Raises:
        Forbidden: if they differ.
    """
    expected = csrf_token(request.cookies.get(cookie, ""))
    if not hmac.compare_digest(expected.encode(), given.encode()):
        raise Forbidden(
            f"A request that is signed in by cookie must carry the page's token in {CSRF_HEADER}. "
            "Reload the page and try again."
        )


def client_of(request: Request) -> str:
    return request.client.host if request.client else NOBODY


def admitted(request: Request, principal: Principal) -> Principal:
    """Remember who asks, for the log and for whoever needs it later in the same request."""
    request.state.actor, request.state.principal = principal.actor, principal
    return principal


def known(request: Request) -> Principal | None:
    """Return who asks, where that has been found out already."""
    principal: Principal | None = getattr(request.state, "principal", None)
    return principal


def _identify(request: Request) -> Principal:
    service = service_of(request)
    scheme, key = get_authorization_scheme_param(request.headers.get("Authorization"))
    if scheme.lower() == "bearer" and key:
        return principal_of(service, key, client_of(request))
    cookie = request.cookies.get(COOKIE)
    if cookie is None:
        raise NotAuthenticated(f"Send a key: `Authorization: Bearer {PREFIX}...`. An admin can make one.")
    principal = signed_in(service, cookie)
    if request.method not in SAFE_METHODS:
        check_csrf(request, request.headers.get(CSRF_HEADER, ""))
    return principal


class Guard(ABC):
    """Dependency that lets a request in by its headers alone."""

    @abstractmethod
    def admit(self, request: Request) -> Principal:
        """Return who asks, if that one may; raises what the answer is to be otherwise."""


@dataclass(frozen=True)
class Requires(Guard):
    """Dependency: the key's role must be this one or a higher one."""

    role: Role

    def __call__(
        self, request: Request, _: Annotated[HTTPAuthorizationCredentials | None, Security(bearer)]
    ) -> Principal:
        return self.admit(request)

    def admit(self, request: Request) -> Principal:
        principal = known(request) or admitted(request, _identify(request))
        if not principal.role.may(self.role):
            raise Forbidden(
                f"This needs the role {self.role}; the key {principal.name!r} has the role {principal.role}."
            )
        return principal


Viewer = Annotated[Principal, Security(Requires(Role.VIEWER), scopes=[Role.VIEWER.value])]
Operator = Annotated[Principal, Security(Requires(Role.OPERATOR), scopes=[Role.OPERATOR.value])]
Admin = Annotated[Principal, Security(Requires(Role.ADMIN), scopes=[Role.ADMIN.value])]
"""The scope is for the OpenAPI document, where it names the role that an operation needs."""


class ConcurrencyLimiter:
    """Lets so many in at once, of all keys together and of each; first come first served.

    Who waits holds no thread and no session.

    Args:
        longest_wait_s: after which a request is answered 503 [s]; it comes again, instead of waiting unseen.
    """

    def __init__(self, at_once: int, per_key: int, longest_wait_s: float) -> None:
        self._longest_wait_s = longest_wait_s
        self._all = asyncio.Semaphore(at_once)
        self._each: defaultdict[str, asyncio.Semaphore] = defaultdict(lambda: asyncio.Semaphore(per_key))

    @asynccontextmanager
    async def enter(self, key_id: str) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            try:
                async with asyncio.timeout(self._longest_wait_s):
                    await stack.enter_async_context(self._each[key_id])
                    await stack.enter_async_context(self._all)
            except TimeoutError:
                raise Unavailable("The service is busy: send it again in a few seconds.", headers=BUSY) from None
            yield


async def looking(request: Request) -> AsyncIterator[None]:
    """Dependency of routes that draw or compute what somebody looks at: it comes first, before a session is opened."""
    gate: ConcurrencyLimiter = request.app.state.looking
    principal = known(request)
    async with gate.enter(NOBODY if principal is None else principal.key_id):
        yield


ReadingLimit = Depends(looking, scope="function")
