"""Signing in with a key, and out."""

from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.errors import NotAuthenticated
from app.security import COOKIE, client_of, principal_of
from app.service import service_of
from app.web.session import FromOurPage, PageViewer, Visitor
from app.web.templating import Message, render
from casebase import audit

router = APIRouter()
KEPT_S = 14 * 24 * 3600


def _local(path: str) -> str:
    """A path on this site, whatever was asked for."""
    return path if path.startswith("/") and not path.startswith(("//", "/\\")) else "/"


@router.get("/sign-in")
def sign_in_page(request: Request, principal: Visitor, next: str = "/") -> Response:
    """Ask for a key."""
    return render(request, "sign_in.html", {"next": _local(next)}, principal=principal)


@router.post("/sign-in")
def sign_in(request: Request, key: Annotated[str, Form()], next: Annotated[str, Form()] = "/") -> Response:
    """Put the key into a cookie that no script can read."""
    service = service_of(request)
    root = service.settings.root_path.rstrip("/")
    try:
        principal = principal_of(service, key.strip(), client_of(request))
    except NotAuthenticated as error:
        notice = Message(str(error.detail), "bad")
        return render(request, "sign_in.html", {"next": _local(next)}, principal=None, messages=(notice,), status=401)
    with service.library.transaction(principal.actor) as session:
        audit.record(session, "session.opened", ("key", principal.key_id))
    answer = RedirectResponse(f"{root}{_local(next)}", status_code=303)
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


@router.post("/sign-out", dependencies=[FromOurPage])
def sign_out(request: Request, _principal: PageViewer) -> Response:
    """Forget the key."""
    root = service_of(request).settings.root_path.rstrip("/")
    answer = RedirectResponse(f"{root}/", status_code=303)
    answer.delete_cookie(COOKIE, path=f"{root}/")
    return answer
