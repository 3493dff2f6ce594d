"""A diagnosis on paper and as one file that needs no network: the words and plots of its page."""

import base64
import hashlib
import io
import textwrap
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup

from app.views import mark_stretches
from app.web.charts import Chart
from app.web.diagnosis_view import DiagnosisView
from app.web.disturbed import left_out_words
from app.web.evidence import Compared
from app.web.templating import ENVIRONMENT, STATIC, instant

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # slow to import

A4_INCHES = (8.27, 11.69)
COLOURS = ("#0a6480", "#b45309")
STYLES = ("-", "--")


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


def diagnosis_pdf(view: DiagnosisView, zone: str) -> bytes:
    """Return the report as PDF, A4: verdict and neighbours on the first page, plots on the second."""
    from matplotlib.backends.backend_pdf import PdfPages  # costs a start of the service nothing

    target = io.BytesIO()
    with PdfPages(target, metadata={"Title": view.verdict.headline, "Creator": "Gearcase"}) as pages:
        pages.savefig(_first_page(view, zone))
        if view.sound is not None:
            pages.savefig(_plots(view))
    return target.getvalue()


def _first_page(view: DiagnosisView, zone: str) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=A4_INCHES)
    when = instant(view.recording.recorded_at or view.diagnosis.created_at, zone).striptags()
    lines: list[tuple[str, float, str]] = [
        (f"{view.recording.file_name}   {when}", 9, "normal"),
        (view.verdict.headline, 20, "bold"),
        (view.verdict.summary, 11, "normal"),
    ]
    lines += [(view.earlier, 11, "bold")] if view.earlier else []
    lines += [(f"{name}: {_plain(value)}   {_plain(note)}", 10, "normal") for name, value, note in view.facts]
    left_out = left_out_words(view.quality)
    lines += [(left_out, 10, "normal")] if left_out else []
    lines += [
        (f"{flag.severity.capitalize()}, {flag.name}: {flag.reason}. {flag.remedy}".strip(), 10, "normal")
        for flag in view.quality
        if flag.severity != "note"
    ]
    lines.append(("Next checks", 13, "bold"))
    lines += [(f"•  {check}", 10, "normal") for check in view.verdict.checks]
    lines.append(("Nearest cases", 13, "bold"))
    lines += [
        (f"{near.label}   {near.origin}   gearbox {near.gearbox or '-'}   distance {near.distance:.3g}", 10, "normal")
        for near in view.neighbours
    ]
    lines.append(("Evidence", 13, "bold"))
    lines += [(f"•  {_told(row)}", 9, "normal") for row in view.evidence.compared[:4]]
    lines += [(f"•  {item.sentence}", 9, "normal") for item in view.evidence.seen[:3]]
    lines.append(
        ("An aid for people who maintain gearboxes; no safety function, no claim of remaining life.", 8, "normal")
    )
    height = 0.95
    for text, size, weight in lines:
        for piece in textwrap.wrap(text, int(900 / size)) or [""]:
            figure.text(0.08, height, piece, fontsize=size, fontweight=weight, va="top", parse_math=False)
            height -= size * 1.45 / 72 / A4_INCHES[1]
        height -= 0.006 + (0.01 if weight == "bold" else 0.0)
    return figure


def _told(row: Compared) -> str:
    sides = "; ".join(f"{_plain(value)} {words}" for words, value in row.sides)
    return f"{row.name[:1].upper()}{row.name[1:]}: {_plain(row.here)} here; {sides}."


def _plain(value: object) -> str:
    return value.striptags() if isinstance(value, Markup) else str(value)


def _plots(view: DiagnosisView) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=A4_INCHES, layout="constrained")
    named: list[Chart] = [chart for chart in vars(view.charts).values() if chart is not None]
    for axes, chart in zip(figure.subplots(len(named), 1), named, strict=True):
        for series, colour, style in zip(chart.series, COLOURS, STYLES, strict=False):
            axes.plot(series.x, series.y, style, color=colour, linewidth=0.8, label=series.name)
        mark_stretches(axes, [(each.start_s, each.end_s, each.text) for each in chart.stretches], "#000000")
        axes.set_title(chart.title, fontsize=10, loc="left")
        axes.set_xlabel(chart.x_label, fontsize=8)
        axes.set_ylabel(chart.y_label, fontsize=8)
        axes.tick_params(labelsize=7)
        axes.legend(fontsize=7, loc="upper right")
    return figure
