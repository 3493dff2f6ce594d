"""The page that stands while what was asked of the whole library is being worked out; it goes on by itself."""

from fastapi import Request
from fastapi.responses import Response
from sqlalchemy.orm import Session

from app.background_cache import Pending
from app.http.security import Principal
from app.service import Service
from app.web.counted import counts_of
from app.web.session import below_root
from app.web.templating import render


def of_library(session: Session, service: Service) -> str:
    """Say that something is worked out from all cases, and how often."""
    cases = sum(counts_of(service.library, session).values())
    return f"the {cases:,} cases of the library, once until a case changes"


def waiting_page(
    request: Request,
    principal: Principal,
    begun: Pending,
    title: str,
    words: str,
    basis: str,
    *,
    section: str = "/library",
    tab: str = "",
    crumb: tuple[str, str] | None = None,
) -> Response:
    """Say what is being worked out, how far it is, and ask again.

    Args:
        title: of the page that will stand here.
        words: what it will say.
        basis: what it is worked out from, and how often.
        tab: of the library, if it is one.
        crumb: path and words of the page above it, if there is one.
    """
    query = request.url.query
    context = {
        "begun": begun,
        "title": title,
        "words": words,
        "tab": tab,
        "crumb": crumb,
        "basis": basis,
        "again": f"{below_root(request)}{f'?{query}' if query else ''}",
    }
    return render(request, "waiting.html", context, principal=principal, section=section)
