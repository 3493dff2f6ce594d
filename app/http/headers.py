"""Headers: Accept, If-None-Match and Location.

And the policy of a report that is one file: it names its style sheets by their hashes; no other style, no script.
"""

import base64
import hashlib
import re
from collections.abc import Sequence
from typing import Annotated
from urllib.parse import quote

from fastapi import Header, Request, Response, status
from fastapi.responses import HTMLResponse

from app.http.errors import NotAcceptable

IfNoneMatch = Annotated[
    str | None, Header(max_length=1000, description="ETags that the client has; of the current one the answer is 304")
]


def _preference(entry: str) -> tuple[str, float]:
    kind, *parameters = (part.strip().lower() for part in entry.split(";"))
    weights = (parameter[2:] for parameter in parameters if parameter.startswith("q="))
    try:
        return kind, float(next(weights, "1"))
    except ValueError:
        return kind, 0.0


def _fits(wanted: str, offered: str) -> int:
    """How exactly a wanted type fits an offered one; 0 is not at all."""
    if wanted == offered:
        return 3
    if wanted.endswith("/*") and wanted != "*/*" and offered.startswith(wanted[:-1]):
        return 2
    return 1 if wanted == "*/*" else 0


def chosen(header: str | None, offered: Sequence[str]) -> str:
    """Return the offered type that the client prefers; of equals the first offered.

    >>> chosen("text/html;q=0.5, application/json", ("text/html", "application/json"))
    'application/json'
    >>> chosen(None, ("text/html", "application/json"))
    'text/html'

    Raises:
        NotAcceptable: if it wants none of them.
    """
    wanted = [_preference(entry) for entry in (header or "*/*").split(",")]

    def weight(kind: str) -> float:
        return max(((_fits(name, kind), q) for name, q in wanted if _fits(name, kind)), default=(0, 0.0))[1]

    best = max(offered, key=weight)
    if weight(best) <= 0:
        raise NotAcceptable(f"Accept asks for {header}; offered are {', '.join(offered)}.")
    return best


def has_already(if_none_match: str | None, etag: str) -> bool:
    """Return whether one of the tags is the current one; weak ones count like strong ones (RFC 9110, 13.1.2).

    >>> has_already('"1", W/"2"', '"2"'), has_already("*", '"2"'), has_already('"1"', '"2"'), has_already(None, '"2"')
    (True, True, False, False)
    """
    tags = [tag.strip().removeprefix("W/") for tag in (if_none_match or "").split(",")]
    return etag in tags or tags == ["*"]


def not_modified(headers: dict[str, str]) -> Response:
    """Return the answer to a client that has it already."""
    return Response(status_code=status.HTTP_304_NOT_MODIFIED, headers=headers)


def location(request: Request, route: str, **path: str) -> str:
    """Return the path of a route, below the path under which a proxy serves us."""
    quoted = {name: quote(value, safe="") for name, value in path.items()}
    return str(request.url_for(route, **quoted).path)


SHEET = re.compile(r"<style[^>]*>(.*?)</style>", re.DOTALL)
INLINE = re.compile(r'\sstyle="([^"]*)"')


def self_contained(report: str, frame_ancestors: str = "'none'", **headers: str) -> HTMLResponse:
    """Answer a report; what stands in `style` attributes, as plots have it, goes into a sheet of its own."""
    page = with_sheets(report)
    policy = f"default-src 'none'; img-src data:; {style_source(page)}; base-uri 'none'; form-action 'none'"
    policy += f"; frame-ancestors {frame_ancestors}"
    return HTMLResponse(page, headers={**headers, "Content-Security-Policy": policy})


def style_source(page: str) -> str:
    """Return the directive that allows the style sheets of a page, each by its hash."""
    sheets = dict.fromkeys(SHEET.findall(page))
    hashes = (base64.b64encode(hashlib.sha256(sheet.encode()).digest()).decode() for sheet in sheets)
    return " ".join(("style-src", *(f"'sha256-{digest}'" for digest in hashes))) if sheets else "style-src 'none'"


def with_sheets(report: str) -> str:
    """Return a page without `style` attributes: equal ones become one rule of a sheet.

    >>> with_sheets('<head></head><p style="color:red">a</p><p style="color:red">b</p>')
    '<head><style>[data-s="0"]{color:red}</style></head><p data-s="0">a</p><p data-s="0">b</p>'
    """
    rules: dict[str, int] = {}
    page = INLINE.sub(lambda found: f' data-s="{rules.setdefault(found[1], len(rules))}"', report)
    sheet = "".join(f'[data-s="{number}"]{{{rule}}}' for rule, number in rules.items())
    return page.replace("</head>", f"<style>{sheet}</style></head>", 1) if rules else page
