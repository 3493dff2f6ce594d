"""Who looks at a page: a key in an HttpOnly cookie; forms carry a token that only this page could know."""

from typing import Annotated
from urllib.parse import quote

from fastapi import Depends, Form, Request

from app.http.errors import Forbidden, NotAuthenticated
from app.http.security import COOKIE, Guard, Principal, Role, admitted, check_csrf, client_of, known, principal_of
from app.http.uploads import check_whole
from app.service import service_of


class SignInNeeded(Exception):
    """Nobody is signed in; the page to come back to afterwards."""

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self.path = path

    @property
    def query(self) -> str:
        return f"next={quote(self.path, safe='')}"


def below_root(request: Request) -> str:
    """Return the path of a request below the path under which a proxy serves us."""
    return str(request.scope["path"].removeprefix(request.scope.get("root_path", "")))


def visitor(request: Request) -> Principal | None:
    """Return who is signed in by cookie, or None."""
    key = request.cookies.get(COOKIE)
    if known(request) or not key:
        return known(request)
    try:
        return admitted(request, principal_of(service_of(request), key, client_of(request)))
    except NotAuthenticated:
        return None


Visitor = Annotated[Principal | None, Depends(visitor)]


class PageRequires(Guard):
    """Dependency of a page: somebody with at least this role, or the sign-in page."""

    def __init__(self, role: Role) -> None:
        self.role = role

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
