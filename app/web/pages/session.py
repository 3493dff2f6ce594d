"""Signing in with a key, and out."""

import secrets
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.http.errors import Forbidden, NotAuthenticated
from app.http.security import COOKIE, FORM_COOKIE, Principal, check_csrf, client_of, csrf_token, principal_of
from app.service import service_of
from app.web.page import FromOurPage, Message, PageViewer, Visitor, lead, render, root_of
from casebase.store import audit

router = APIRouter()
KEPT_S = 14 * 24 * 3600


def _local(path: str) -> str:
    """A path on this site, whatever was asked for."""
    return path if path.startswith("/") and not path.startswith(("//", "/\\")) else "/"


@router.get("/sign-in")
def sign_in_page(request: Request, principal: Visitor, next: str = "/") -> Response:
    """Ask for a key."""
    return _form(request, next, principal)


@router.post("/sign-in")
def sign_in(
    request: Request,
    key: Annotated[str, Form()],
    next: Annotated[str, Form()] = "/",
    csrf: Annotated[str, Form()] = "",
) -> Response:
    """Put the key into a cookie that no script can read.

    The form's token keeps another site from signing somebody in with a key of its own, to see what is then sent.
    """
    if not request.cookies.get(FORM_COOKIE):
        raise Forbidden("The sign-in form comes with a cookie, which is missing. Open /sign-in and send its form.")
    check_csrf(request, csrf, FORM_COOKIE)
    service = service_of(request)
    root = root_of(service)
    try:
        principal = principal_of(service, key.strip(), client_of(request))
    except NotAuthenticated as error:
        notice = Message(str(error.detail), "bad")
        return _form(request, next, None, (notice,), status=401)
    with service.library.transaction(principal.actor) as session:
        audit.record(session, "session.opened", ("key", principal.key_id))
    answer = lead(service, _local(next))
    answer.set_cookie(
        COOKIE,
        key.strip(),
        max_age=KEPT_S,
        path=f"{root}/",
        httponly=True,
        samesite="strict",
        secure=service.settings.cookie_secure,
    )
    return answer


def _form(
    request: Request, next: str, principal: Principal | None, messages: tuple[Message, ...] = (), status: int = 200
) -> Response:
    """Return the form, whose token belongs to a cookie that is made here where there is none."""
    token = request.cookies.get(FORM_COOKIE) or secrets.token_urlsafe(32)
    context = {"next": _local(next), "csrf": csrf_token(token)}
    answer = render(request, "sign_in.html", context, principal=principal, messages=messages, status=status)
    settings = service_of(request).settings
    answer.set_cookie(
        FORM_COOKIE,
        token,
        path=f"{root_of(service_of(request))}/",
        httponly=True,
        samesite="strict",
        secure=settings.cookie_secure,
    )
    return answer


@router.post("/sign-out", dependencies=[FromOurPage])
def sign_out(request: Request, _principal: PageViewer) -> Response:
    """Forget the key."""
    answer = lead(service_of(request), "/")
    answer.delete_cookie(COOKIE, path=f"{root_of(service_of(request))}/")
    return answer
