"""An error as a page, where a browser asked for one: the same words as the problem document, and the way out.

So are two questions that end a request: who is there, and which label is meant.
"""

import json
from urllib.parse import quote

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.http.security import known
from app.report.formatting import sentence
from app.service import service_of
from app.web.page import below_root, lead, render


class PageErrors:
    """Turns problem+json into a page for requests of a browser outside /api."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not _wants_page(scope):
            await self.app(scope, receive, send)
            return
        started: Message | None = None
        body = b""

        async def send_page(message: Message) -> None:
            nonlocal started, body
            if message["type"] == "http.response.start" and _is_problem(message):
                started = message
                return
            if started is None:
                await send(message)
                return
            body += message.get("body", b"")
            if not message.get("more_body", False):
                await _error_page(scope, receive, send, body, int(started["status"]))

        await self.app(scope, receive, send_page)


def _wants_page(scope: Scope) -> bool:
    accepted = Headers(scope=scope).get("accept", "")
    return "text/html" in accepted and not scope["path"].startswith("/api/")


def _is_problem(message: Message) -> bool:
    return Headers(raw=message["headers"]).get("content-type", "").startswith("application/problem+json")


async def _error_page(scope: Scope, receive: Receive, send: Send, body: bytes, status: int) -> None:
    request = Request(scope)
    problem = json.loads(body)
    principal = getattr(request.state, "principal", None)
    came_from = request.headers.get("referer", "")
    context = {
        "title": problem.get("title", ""),
        "detail": sentence(problem.get("detail", "")),
        "status": status,
        "back": came_from if came_from.startswith(str(request.base_url)) else "",
    }
    page = render(request, "error.html", context, principal=principal, status=status)
    await page(scope, receive, send)


async def sign_in_first(request: Request, error: Exception) -> RedirectResponse:
    """Answer SignInNeeded with the way to the sign-in page."""
    return lead(service_of(request), f"/sign-in?next={quote(str(error), safe='')}")


async def ask_which_label(request: Request, error: Exception) -> HTMLResponse:
    """Answer LabelQuestion with the question; the answer goes where the form went, with all that it said."""
    form = (await request.form()).multi_items()
    given = [(name, value) for name, value in form if name not in ("csrf", "label", "another", "sure")]
    context = {"question": error, "path": below_root(request), "given": given}
    return render(request, "label.html", context, principal=known(request), section="/diagnoses")
