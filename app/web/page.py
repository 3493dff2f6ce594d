"""What every page is made with: who looks at it, what it is filled with, where its forms lead.

A session stands in an HttpOnly cookie; forms carry a token that only a page of ours could know.
"""

import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar
from urllib.parse import quote, urlencode

from fastapi import Depends, Form, Request
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import BaseModel, ValidationError
from sqlalchemy import ColumnElement, Select, select
from sqlalchemy.orm import Session, defer
from starlette import types
from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from app.axes import units_of
from app.background_cache import Pending
from app.fleet import natural
from app.http.errors import Forbidden, NotAuthenticated, validation_problem
from app.http.security import COOKIE, Guard, Principal, Role, admitted, check_csrf, csrf_token, known, signed_in
from app.http.uploads import check_whole
from app.report.formatting import ENVIRONMENT, WORDS, instant, sentence
from app.service import Service, service_of
from app.web.forms import number_of
from casebase.origins import DEMO
from casebase.store.artifacts import active_artifact
from casebase.store.models import StoredInvestigation, StoredRecording
from casebase.store.pagination import searched

Asked = TypeVar("Asked", bound=BaseModel)
ROWS = 50
"""Of a list on a page."""
RECORDED = {"recording": StoredRecording.file_name, "axis": StoredRecording.axis, "gearbox": StoredRecording.gearbox}
"""By what lists of what was recorded are searched and sorted."""
NAVIGATION = (
    ("/fleet", "Fleet", "1", "viewer"),
    ("/diagnoses", "Diagnoses", "2", "viewer"),
    ("/library", "Library", "3", "viewer"),
    ("/axes", "Axes", "4", "viewer"),
    ("/investigations", "Investigations", "5", "viewer"),
    ("/simulate", "Simulate", "0", "viewer"),
    ("/jobs", "Jobs", "6", "operator"),
    ("/alarms", "Alarms", "7", "admin"),
    ("/keys", "Keys", "8", "admin"),
    ("/audit", "Audit", "9", "admin"),
)
SHOWN = [one for of in ("labels", "verdicts", "jobs", "actions") for one in WORDS[of].items()]
"""What a column of text has, and what a list shows for it."""
Headlined = tuple[StoredInvestigation, str | None]
_DOCUMENT = StoredInvestigation.document


def demo_ids(session: Session) -> tuple[str, str] | None:
    """Return diagnosis and recording of the demonstration that came with the starter library, if there is one."""
    row = active_artifact(session, DEMO)
    return None if row is None else (str(row.content["diagnosis_id"]), str(row.content["recording_id"]))


class SignInNeeded(Exception):
    """Nobody is signed in; its text is the path of the page to come back to afterwards."""


def below_root(request: Request) -> str:
    """Return the path of a request below the path under which a proxy serves us."""
    return str(request.scope["path"].removeprefix(request.scope.get("root_path", "")))


def visitor(request: Request) -> Principal | None:
    """Return who is signed in by cookie, or None."""
    token = request.cookies.get(COOKIE)
    if known(request) or not token:
        return known(request)
    try:
        return admitted(request, signed_in(service_of(request), token))
    except NotAuthenticated:
        return None


Visitor = Annotated[Principal | None, Depends(visitor)]


@dataclass(frozen=True)
class PageRequires(Guard):
    """Dependency of a page: somebody with at least this role, or the sign-in page."""

    role: Role

    def __call__(self, request: Request) -> Principal:
        return self.admit(request)

    def admit(self, request: Request) -> Principal:
        principal = visitor(request)
        if principal is None:
            path = below_root(request) if request.method == "GET" else "/"
            raise SignInNeeded(path)
        if not principal.role.may(self.role):
            raise Forbidden(f"This page needs the role {self.role}; you are signed in with the role {principal.role}.")
        return principal


PageViewer = Annotated[Principal, Depends(PageRequires(Role.VIEWER))]
PageOperator = Annotated[Principal, Depends(PageRequires(Role.OPERATOR))]
PageAdmin = Annotated[Principal, Depends(PageRequires(Role.ADMIN))]


async def form_token(request: Request, csrf: Annotated[str, Form()] = "") -> None:
    """Dependency of every form: its token must belong to the cookie, its texts be whole."""
    check_csrf(request, csrf)
    for name, value in (await request.form()).multi_items():
        check_whole(name, value if isinstance(value, str) else "")


FromOurPage = Depends(form_token)


@dataclass(frozen=True)
class Message:
    """One notice above the content: kind is empty, 'warn' or 'bad'."""

    text: str
    kind: str = ""


def content_security_policy(nonce: str) -> str:
    """Scripts and styles of our own only; the nonce is for the style of the waveform player's shadow root."""
    return (
        "default-src 'none'; script-src 'self'; frame-src 'self'; connect-src 'self'; "
        "img-src 'self' data:; media-src 'self' blob:; "
        f"style-src 'self' 'nonce-{nonce}'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )


def render(
    request: Request,
    template: str,
    context: Mapping[str, object],
    *,
    section: str = "",
    messages: tuple[Message, ...] = (),
    status: int = 200,
) -> HTMLResponse:
    """Fill a page's template; everything a value holds is escaped."""
    service, principal = service_of(request), known(request)
    root, zone = root_of(service), service.settings.time_zone
    nonce = secrets.token_urlsafe(12)

    if request.query_params.get("undone"):
        messages = (*messages, Message("Taken back: all is as it was before."))

    def may(role: str) -> bool:
        return principal is not None and principal.role.may(Role(role))

    given: dict[str, object] = {
        "root": root,
        "request_path": request.url.path,
        "static": lambda name: f"{root}/static/{name}",
        "nonce": nonce,
        "theme": request.cookies.get("gearcase-theme", ""),
        "csrf": csrf_token(request.cookies.get(COOKIE, "")) if principal else "",
        "principal": principal,
        "may_operate": may("operator"),
        "may_admin": may("admin"),
        "navigation": [(href, words, key) for href, words, key, role in NAVIGATION if may(role)],
        "section": section,
        "messages": messages,
        "zone": zone,
        "units_of": units_of,
        "verdicts": WORDS["verdicts"],
        "ways": WORDS["verifications"],
        "at": lambda value: instant(value, zone),
    }
    page = ENVIRONMENT.get_template(template).render({**given, **context})
    headers = {"Content-Security-Policy": content_security_policy(nonce), "Cache-Control": "no-store"}
    return HTMLResponse(page, status_code=status, headers=headers)


def root_of(service: Service) -> str:
    """Return the path under which a proxy serves us, without a slash at its end."""
    return service.settings.root_path.rstrip("/")


def checked_form(model: type[Asked], given: Mapping[str, object]) -> Asked:
    """Return what a form asks for, as the interface for programs would take it; what was left empty is not given."""
    asked = {name: given[name] for name in model.model_fields if given.get(name) not in ("", None)}
    try:
        return model.model_validate(asked)
    except ValidationError as error:
        raise validation_problem(error.errors(include_url=False), "The form") from None


def lead(service: Service, path: str) -> RedirectResponse:
    """Lead from a form that was taken to a page, given by its path below the root."""
    return RedirectResponse(f"{root_of(service)}{path}", status_code=303)


@dataclass(frozen=True)
class Listing:
    """A page of a list that its address searches and sorts.

    Args:
        found: the rows, and one of the next page if there is one.
        sorts: by what it can be sorted.
        asked: what the address says besides `first`, the number of rows before.
        count: of the rows of all pages, where they were counted.
    """

    found: Sequence[Any]
    first: int
    sorts: Sequence[str]
    asked: Mapping[str, str]
    count: int | None = None

    @property
    def rows(self) -> Sequence[Any]:
        return self.found[:ROWS]

    def at(self, pages: int) -> str:
        """Return the address of the page that stands so many pages further on."""
        return f"?{urlencode({**self.asked, 'first': max(0, self.first + pages * ROWS)})}"


def listing(request: Request, session: Session, known: Select[Any] | Sequence[Any], **columns: Any) -> Listing:
    """Return the page of a list that the address asks for; every word that is searched stands in a column of text.

    Args:
        known: a statement, whose usual order is the newest first; or all rows in theirs.
        columns: by what it can be sorted, of the statement, or as functions of a row.
    """
    given = {name: value.replace("\0", "") for name, value in request.query_params.items()}
    asked = {name: value for name, value in given.items() if value and name not in ("first", "step", "undone")}
    words = asked.get("search", "")[:200].lower().split()
    first, sort = number_of(request, "first") or 0, asked.get("sort", "")
    if isinstance(known, Select):
        sorts = {"oldest_first": known.column_descriptions[0]["entity"].id, **columns}
        meant = [[word, *(name for name, shown in SHOWN if f" {word}" in f" {shown}".lower())] for word in words]
        texts = [*columns.values()]
        rows = searched(session, known, texts, meant, by=sorts.get(sort), first=first, most=ROWS + 1)
        return Listing(rows, first, [*sorts], asked)

    def key(row: Any) -> Any:
        value = columns[sort](row)
        return natural(value) if isinstance(value, str) else value

    texts = [of for of in columns.values() if known and isinstance(of(known[0]), str)]
    rows = [row for row in known if all(any(word in of(row).lower() for of in texts) for word in words)]
    rows = sorted(rows, key=key) if sort in columns else rows
    return Listing(rows[first : first + ROWS + 1], first, [*columns], asked, len(rows))


def waiting_page(request: Request, begun: Pending, *, section: str = "/library", **about: object) -> HTMLResponse:
    """Say what is being worked out, how far it is, and ask again.

    Args:
        about: `title` and `words` of the page that will stand here; `basis`, what it is worked out from, and how often;
            `tab` of the library, if it is one; `crumb`, path and words of the page above it, if there is one.
    """
    again = f"{below_root(request)}{f'?{request.url.query}' if request.url.query else ''}"
    context = {"tab": "", "crumb": None, "begun": begun, "again": again, **about}
    return render(request, "waiting.html", context, section=section)


def of_library(service: Service, session: Session) -> str:
    """Say that something is worked out from all cases, and how often."""
    return f"the {sum(service.counts(session).values()):,} cases of the library, once until a case changes"


def light() -> Select[StoredInvestigation]:
    """Select investigations without their documents."""
    return select(StoredInvestigation).options(defer(_DOCUMENT))


def headlined(session: Session, rows: Sequence[StoredInvestigation]) -> list[Headlined]:
    """Return each of them with what it found; None with those that found nothing yet."""
    ids = [row.id for row in rows]
    asked = select(StoredInvestigation.id, _DOCUMENT["story", "headline"].as_string())
    asked = asked.where(StoredInvestigation.id.in_(ids))
    told = {identity: headline.removesuffix(".") for identity, headline in session.execute(asked) if headline}
    return [(row, told.get(row.id)) for row in rows]


def newest(session: Session, most: int, *where: ColumnElement[bool]) -> list[Headlined]:
    """Return the newest investigations of which all this holds, with what each found."""
    statement = light().where(*where).order_by(StoredInvestigation.id.desc()).limit(most)
    return headlined(session, session.scalars(statement).all())


@dataclass(eq=False)
class PageErrors:
    """Turns problem+json into a page for requests of a browser outside /api."""

    app: ASGIApp

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        accepted = Headers(scope=scope).get("accept", "") if scope["type"] == "http" else ""
        if "text/html" not in accepted or scope["path"].startswith("/api/"):
            await self.app(scope, receive, send)
            return
        started: types.Message | None = None
        body = b""

        async def send_page(message: types.Message) -> None:
            nonlocal started, body
            if message["type"] == "http.response.start":
                kind = Headers(raw=message["headers"]).get("content-type", "")
                started = message if kind.startswith("application/problem+json") else None
            if started is None:
                await send(message)
            elif message is not started:
                body += message.get("body", b"")
                if not message.get("more_body", False):
                    await _error_page(scope, receive, send, body, started)

        await self.app(scope, receive, send_page)


async def _error_page(scope: Scope, receive: Receive, send: Send, body: bytes, started: types.Message) -> None:
    request, status = Request(scope), int(started["status"])
    problem = json.loads(body)
    came_from = request.headers.get("referer", "")
    context = {
        "title": problem.get("title", ""),
        "detail": sentence(problem.get("detail", "")),
        "status": status,
        "back": came_from if came_from.startswith(str(request.base_url)) else "",
    }
    page = render(request, "error.html", context, status=status)
    if again := Headers(raw=started["headers"]).get("retry-after"):
        page.headers["Retry-After"] = again
    await page(scope, receive, send)


async def sign_in_first(request: Request, error: Exception) -> RedirectResponse:
    """Answer SignInNeeded with the way to the sign-in page."""
    return lead(service_of(request), f"/sign-in?next={quote(str(error), safe='')}")


async def ask_which_label(request: Request, error: Exception) -> HTMLResponse:
    """Answer LabelQuestion with the question; the answer goes where the form went, with all that it said."""
    form = (await request.form()).multi_items()
    given = [(name, value) for name, value in form if name not in ("csrf", "label", "another", "sure")]
    context = {"question": error, "path": below_root(request), "given": given}
    return render(request, "label.html", context, section="/diagnoses")
