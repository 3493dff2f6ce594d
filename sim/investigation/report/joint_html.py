"""One HTML file of several recordings: the combined result, then each recording's own report, folded."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from sim.investigation.pooling.joint_investigation import Together
from sim.investigation.report.cause_panels import cause_panel
from sim.investigation.report.formatting import likely, named, number, words_of
from sim.investigation.report.html import STYLE, box, described, estimate_cells, html_report, next_steps, table
from sim.investigation.report.panels import Panel
from sim.investigation.report.wording import headline
from sim.investigation.results import Finding

BODY = re.compile(r"<body[^>]*>(.*)</body>", re.DOTALL)
STYLES = re.compile(r"<style[^>]*>.*?</style>", re.DOTALL)
IDS = re.compile(r'(\sid="|\sfor="|\saria-labelledby="|href="#|url\(#)')
WIDTH = '<meta name="viewport" content="width=device-width, initial-scale=1">'
FOLD = "details{border-top:1px solid #c9d1d9;margin:1rem 0}summary{cursor:pointer;font-weight:600;padding:.5rem 0}"


def story_together(result: Together) -> dict[str, object]:
    """Headline, and the plots of what was found, as JSON."""
    shown = enumerate(cause_panels_together(result))
    return {
        "headline": headline(result.combined),
        "causes": [{"finding": place, **panel.document()} for place, panel in shown if panel],
    }


def cause_panels_together(result: Together) -> list[Panel | None]:
    """The plot of every finding, of the recording that shows it most surely."""
    return [_clearest(result, finding) for finding in result.combined.findings]


def _clearest(result: Together, finding: Finding) -> Panel | None:
    same = [
        (one.probability, part, one)
        for part in result.parts
        for one in part.result.findings
        if (one.mechanism, one.location) == (finding.mechanism, finding.location)
    ]
    if not same:
        return None
    _, part, one = max(same, key=lambda each: each[0])
    panel = cause_panel(part.result, one)
    return panel and replace(panel, title=f"{panel.title}, in {part.taken.name}")


def html_report_together(result: Together) -> str:
    """The combined result and every recording's report as one HTML page that loads nothing."""
    pages = [html_report(part.result) for part in result.parts]
    name = html.escape(result.combined.axis.name)
    head = "".join(dict.fromkeys(style for page in pages for style in STYLES.findall(page.split("<body")[0])))
    body = "\n".join([*_combined(result), *_recordings(result, pages)])
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">{WIDTH}<title>Investigation of {name}</title>'
        f"<style>{STYLE}</style>{head}<style>{FOLD}</style></head><body>{body}</body></html>"
    )


def _combined(result: Together) -> list[str]:
    one = result.combined
    count = len(result.parts)
    out = [
        box(one, [part.taken.name for part in result.parts], cause_panels_together(result)),
        *(f"<p>{html.escape(remark)}</p>" for remark in one.remarks),
        "<h2>Findings of all recordings</h2>",
    ]
    for finding, names in zip(one.findings, result.shown, strict=True):
        shown = (
            f"Shown by {len(names)} of {count}: {', '.join(names)}." if names else f"Shown clearly by none of {count}."
        )
        out.append(f"<p>{html.escape(named(finding.mechanism, finding.location))}: {html.escape(shown)}</p>")
    if not one.findings:
        out.append("<p>None.</p>")
    rows = [(words_of(e.name), described(e), *estimate_cells(e)) for e in one.parameters]
    gained = [
        (part.taken.name, words_of(g.channel), number(g.rms_before), number(g.rms_after), g.unit)
        for part in result.parts
        for g in part.gain
    ]
    return [
        *out,
        "<h2>Calibration by all recordings</h2>",
        table(("number", "described", "found", "90 % interval", "unit"), rows),
        "<h2>Gain on data not used for the fit</h2>",
        table(("recording", "channel", "error before, rms", "error after, rms", "unit"), gained),
        "<h2>Next measurement</h2>",
        *next_steps(one),
    ]


def _recordings(result: Together, pages: Sequence[str]) -> Iterable[str]:
    yield "<h2>Each recording by itself</h2>"
    for place, (part, page) in enumerate(zip(result.parts, pages, strict=True), start=1):
        sound = f" with {part.taken.sound_name}" if part.taken.sound_name else ""
        found = ", ".join(
            f"{named(f.mechanism, f.location)}, {likely(f.probability, calibrated=f.calibrated)}"
            for f in part.result.findings
        )
        title = f"{part.taken.name}{sound}: {found or headline(part.result)}"
        yield f'<details id="recording-{place}"><summary>{html.escape(title)}</summary>{body_of(page, place)}</details>'


def body_of(page: str, place: int) -> str:
    """What stands in the body of a page; its names within the file made its own."""
    match = BODY.search(page)
    return IDS.sub(rf"\g<1>r{place}-", match.group(1)) if match else ""
