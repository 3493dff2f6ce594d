"""A report that is one file, under a policy that names its style sheets by their hashes: no other style, no script."""

import base64
import hashlib
import re

from fastapi.responses import HTMLResponse

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
