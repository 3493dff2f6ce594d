"""The one table: what can go wrong -> an RFC 9457 problem that says what was wrong and what would be right."""

import json
import re
from collections.abc import Sequence
from functools import cache
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi_problem.error import Problem, StatusProblem
from fastapi_problem.handler import ExceptionHandler, new_exception_handler
from sqlalchemy.exc import DatabaseError, OperationalError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import compile_path

from app.background_cache import NotReadyError
from app.http.finite import finite
from app.jobs import job as jobs
from app.storage_faults import is_contended, is_full, is_unwritable
from casebase import errors as library
from casebase.store import audit
from casebase.store.integrity import RESTORE, is_damaged
from signals import errors as signals
from sim import errors as sim

log = structlog.get_logger(__name__)


def _problem(status: int, type_: str, title: str) -> type[StatusProblem]:
    return type(type_, (StatusProblem,), {"status": status, "type_": type_, "title": title})


BadRequest = _problem(400, "bad-request", "The request cannot be read")


class NotAuthenticated(StatusProblem):
    status, type_, title = 401, "not-authenticated", "A valid key is needed"

    def __init__(self, detail: str) -> None:
        super().__init__(detail, headers={"WWW-Authenticate": 'Bearer realm="gearcase"'})


Forbidden = _problem(403, "role-too-low", "This key may not do that")
NotFound = _problem(404, "not-found", "There is no such thing")
MethodNotAllowed = _problem(405, "method-not-allowed", "This method is not offered here")
NotAcceptable = _problem(406, "not-acceptable", "None of the accepted media types is offered")
TooSlow = _problem(408, "request-too-slow", "The request's body did not arrive in time")
Conflict = _problem(409, "conflict", "The request does not fit the present state")
Gone = _problem(410, "erased", "It was erased")
Stale = _problem(412, "stale", "It was changed by someone else in the meantime")
TooLarge = _problem(413, "too-large", "The request is too large")
UnsupportedMedia = _problem(415, "unsupported-media", "This kind of content is not taken here")
RangeNotSatisfiable = _problem(416, "range-not-satisfiable", "The range lies outside the content")
Unprocessable = _problem(422, "unprocessable", "The content is not valid")
IfMatchRequired = _problem(428, "if-match-required", "Say which version is to be changed")
TooManyFailures = _problem(429, "too-many-failures", "Too many wrong keys from this address")


class InternalFault(StatusProblem):
    """Says nothing of the fault itself: that is in the log, under the request's id."""

    status, type_, title = 500, "internal-fault", "The service failed; this is not your fault"

    def __init__(self, _detail: str | None = None) -> None:
        super().__init__("The fault is in the service's log under request_id.")


Damaged = _problem(500, "damaged", "What is stored is damaged; this is not your fault")
Unavailable = _problem(503, "unavailable", "The service cannot do this at the moment")
InsufficientStorage = _problem(507, "insufficient-storage", "There is no room left to store this")

DOMAIN: dict[type[Exception], type[StatusProblem]] = {
    library.NotFoundError: NotFound,
    library.StaleVersionError: Stale,
    library.ConflictError: Conflict,
    library.InvalidRequestError: Unprocessable,
    library.ArtifactError: Conflict,
    library.ErasedError: Gone,
    library.DamagedError: Damaged,
    library.BusyError: Unavailable,
    library.LibraryError: Unprocessable,
    signals.NotAudioError: UnsupportedMedia,
    signals.RecordingTooLargeError: TooLarge,
    signals.DecoderUnavailableError: Unavailable,
    signals.SignalError: Unprocessable,
    sim.SimulationError: Unprocessable,
    jobs.JobNotFoundError: NotFound,
    jobs.JobStateError: Conflict,
    jobs.JobError: Unprocessable,
    NotReadyError: Unavailable,
}
"""Domain errors and what they are over HTTP; of several that fit an error, the most special counts."""

BY_STATUS: dict[int, type[StatusProblem]] = {
    kind.status: kind for kind in StatusProblem.__subclasses__() if kind.__module__ == __name__
}


SYNTAX = "json_invalid"
LISTED = 20
"""Errors of one request that are told, at most: who is wrong in more places reads these first."""

BUSY = {"Retry-After": "3"}
"""Of what is refused because of too many others."""
SAFE = ("GET", "HEAD", "OPTIONS")
"""Methods that store nothing."""


def validation_problem(errors: Sequence[Any], what: str = "The request") -> Problem:
    """422 from pydantic's list of errors: one sentence each, and the list for programs."""
    listed: list[dict[str, Any]] = [
        {
            "location": ".".join(map(str, error["loc"][:1] if error["type"] == SYNTAX else error["loc"])),
            "message": _message(error),
            "kind": error["type"],
            "given": finite(error["input"]) if isinstance(error["input"], str | int | float | None) else None,
        }
        for error in errors[:LISTED]
    ]
    words = "; ".join(f"{entry['location'] or 'body'}: {entry['message']}" for entry in listed)
    if len(errors) > LISTED:
        words += f"; and {len(errors) - LISTED} more"
    return Unprocessable(f"{what} is not valid: {words}", errors=listed)


def _message(error: Any) -> str:
    """What pydantic says; of text that is no JSON where it breaks and what JSON looks like."""
    if error["type"] != SYNTAX:
        return str(error["msg"])
    place = "".join(f" at character {part}" for part in error["loc"][1:])
    reason = str(error.get("ctx", {}).get("error", "it cannot be read"))
    return (
        f"this is no JSON: {reason[:1].lower()}{reason[1:]}{place}. JSON looks like "
        '{"name": "bench 3", "limit": 5}: names and texts in double quotes, a comma between two entries'
    )


def _from_validation(_: ExceptionHandler, request: Request, error: RequestValidationError) -> Problem:
    for each in error.errors():
        if each["loc"][0] == "path":
            return NotFound(
                f"There is nothing at {request.url.path}: {str(each['input'])[:100]!r} is no id. "
                "Ids are as the call that made the thing answers them, 32 digits from 0 to f."
            )
    return validation_problem(error.errors())


def _words(request: Request, error: HTTPException) -> str:
    path = request.url.path
    if error.status_code == HTTPStatus.NOT_FOUND and error.detail == HTTPStatus.NOT_FOUND.phrase:
        return f"There is nothing at {path}. The API is under /api/v1 and described at /docs."
    return error.detail


def path_of(request: Request) -> str:
    """The path under which a route is known here, without what a proxy put before it."""
    return str(request.scope["path"].removeprefix(request.scope.get("root_path", "")))


@cache
def _offers(app: FastAPI) -> tuple[tuple[re.Pattern[str], dict[str, frozenset[str]]], ...]:
    found = []
    for path, methods in app.openapi()["paths"].items():
        queries = {
            method.upper(): frozenset(each["name"] for each in operation.get("parameters", ()) if each["in"] == "query")
            for method, operation in methods.items()
        }
        found.append((compile_path(path)[0], queries))
    return tuple(found)


def offered(app: FastAPI, path: str) -> dict[str, frozenset[str]]:
    """Return the methods that the API offers at a path, each with the names of its query parameters."""
    return {
        method: names for pattern, queries in _offers(app) if pattern.match(path) for method, names in queries.items()
    }


def _not_offered(request: Request, headers: dict[str, str]) -> Problem:
    methods = offered(request.app, path_of(request))
    allow = ", ".join(sorted(methods)) or headers.get("Allow", "")
    return MethodNotAllowed(
        f"{request.method} is not offered at {request.url.path}. Offered: {allow}.", headers={"Allow": allow}
    )


def _from_http(_: ExceptionHandler, request: Request, error: HTTPException) -> Problem:
    headers = dict(error.headers or {})
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        return _not_offered(request, headers)
    kind = BY_STATUS.get(error.status_code)
    if kind is not None:
        return kind(_words(request, error), headers=headers)
    phrase = HTTPStatus(error.status_code).phrase
    return Problem(phrase, phrase.lower().replace(" ", "-"), error.detail, error.status_code, headers)


def _from_domain(_: ExceptionHandler, __: Request, error: Exception) -> Problem:
    kind = next(DOMAIN[cls] for cls in type(error).__mro__ if cls in DOMAIN)
    if isinstance(error, library.DuplicateError):
        there = {"id": error.case_id, "label": error.label, "gearbox": error.gearbox}
        return kind(str(error), case=there)
    if isinstance(error, signals.TelemetryError):
        return kind(str(error), errors=[{"location": "telemetry", "message": str(error), "kind": "telemetry"}])
    if isinstance(error, library.BusyError):
        return kind(str(error), headers=BUSY)
    return kind(str(error), headers={"Retry-After": "60"} if isinstance(error, NotReadyError) else None)


def _from_storage(_: ExceptionHandler, __: Request, error: Exception) -> Problem:
    if is_full(error):
        return InsufficientStorage(
            "The disk of the service is full; nothing that was there is lost. "
            "Whoever runs the service has to make room; then send it again.",
            headers={"Retry-After": "600"},
        )
    if isinstance(error, NoConnectionError) or is_contended(error):
        return Unavailable("More is being stored than the database can take.", headers=BUSY)
    if is_damaged(error):
        return Damaged(f"The database of the service is damaged. Whoever runs the service has to act. {RESTORE}")
    if is_unwritable(error):
        return Unavailable(
            "The service cannot reach or write its data at the moment; nothing that was there is lost. Whoever runs "
            "the service finds the reason in its log under request_id.",
            headers={"Retry-After": "60"},
        )
    return InternalFault()


def _what_was_stored() -> str:
    """Say of a request that was to store something and failed what became of that."""
    done = audit.STORED.get()
    if done is None:
        return "Look whether what was asked for is there before you send it again."
    if not done:
        return "So far nothing of this request was stored."
    return f"Stored before it failed: {', '.join(sorted(set(done)))}. Look what is there before you send it again."


def _identify(content: dict[str, Any], request: Request, response: JSONResponse) -> tuple[dict[str, Any], JSONResponse]:
    if content["status"] >= HTTPStatus.INTERNAL_SERVER_ERROR and request.method not in SAFE:
        content["detail"] = f"{content.get('detail', '')} {_what_was_stored()}".strip()
    content = finite({**content, "instance": request.url.path, "request_id": request.scope.get("request_id")})
    response.body = json.dumps(content, ensure_ascii=False, allow_nan=False).encode()
    return content, response


def _note(request: Request, error: Exception) -> None:
    if is_full(error) or is_unwritable(error) or is_damaged(error) or isinstance(error, library.DamagedError):
        log.error("storage failed", path=request.url.path, error=str(error))
    elif not isinstance(error, EXPECTED):
        log.exception("request failed", path=request.url.path, exc_info=error)


STORAGE = (OSError, OperationalError, DatabaseError, NoConnectionError)
EXPECTED = (Problem, HTTPException, RequestValidationError, *DOMAIN)

problem_handler = new_exception_handler(
    unhandled_wrappers={"default": InternalFault},
    handlers={**dict.fromkeys(DOMAIN, _from_domain), **dict.fromkeys(STORAGE, _from_storage)},
    http_exception_handler=_from_http,
    request_validation_handler=_from_validation,
    pre_hooks=[_note],
    post_hooks=[_identify],
)


def add_problem_handlers(app: FastAPI) -> None:
    for error in (Exception, *STORAGE, *EXPECTED):
        app.add_exception_handler(error, problem_handler)
