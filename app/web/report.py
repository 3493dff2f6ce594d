"""A diagnosis as one file that needs no network: the words and plots of its page."""

import base64
import hashlib
from functools import cache

from markupsafe import Markup

from app.web.diagnosis_view import DiagnosisView
from app.web.templating import ENVIRONMENT, STATIC, instant


@cache
def style_sheet() -> Markup:
    """Return the style sheet of the pages, to stand inside a file."""
    return Markup((STATIC / "gearcase.css").read_text())  # noqa: S704  our own file


@cache
def report_policy() -> str:
    """Return the content security policy of a report: its own style sheet, known by its hash, and its own pictures."""
    digest = base64.b64encode(hashlib.sha256(style_sheet().encode()).digest()).decode()
    return f"default-src 'none'; img-src data:; style-src 'sha256-{digest}'; base-uri 'none'; frame-ancestors 'none'"


def diagnosis_html(view: DiagnosisView, zone: str) -> str:
    """Return the report as one HTML file: no script, no address, plots as SVG."""
    context = {
        **view.context(),
        "style": style_sheet(),
        "at": lambda value: instant(value, zone),
        "spectrogram": base64.b64encode(view.spectrogram() or b"").decode(),
    }
    return ENVIRONMENT.get_template("report.html").render(context)
