"""A panel as inline SVG: readable on a phone, in the colours of the page it stands in, told apart by style as well."""

from __future__ import annotations

import html
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.investigation.report.panels import FLOOR, Panel, style_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN, HEIGHT_IN = 6.2, 3.3
LONGEST = 26  # characters of a label that stands beside a plot
TEXT = 12.0  # points: 9 pixels on a phone of 390
FEW, FEWEST = 24, 3  # values that are drawn as dots besides; bins that are dots alone
CLOSE = 0.22  # of the width: words nearer than that stand in rows
INKS = {  # what is drawn, and the colour of the page that takes its place
    "#010101": "currentColor", "#020202": "var(--first)", "#030303": "var(--second)",
    "#040404": "var(--third)", "#050505": "var(--band)", "#060606": "var(--quiet)", "#070707": "var(--fourth)",
}  # fmt: skip
INK, FIRST, SECOND, THIRD, BAND, QUIET, FOURTH = INKS
STYLES: Mapping[int, tuple[str, Any, str]] = {
    1: (FIRST, "-", "o"),
    2: (SECOND, (0, (5, 2.5)), "s"),
    3: (THIRD, (0, (2, 2.5)), "^"),
    4: (FOURTH, (0, (7, 2.5, 2, 2.5)), "v"),
    5: (INK, (0, (9, 3)), ""),
    6: (QUIET, ":", ""),
    7: (FOURTH, "-", "D"),
}
"""Colour, stroke and dot of each number of `style_of`, as in the style sheet of the pages."""
RC: Any = {
    "svg.hashsalt": "gearcase", "svg.fonttype": "none", "text.parse_math": False, "font.size": TEXT,
    "text.color": INK, "axes.edgecolor": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.facecolor": "none", "figure.facecolor": "none", "axes.spines.top": False, "axes.spines.right": False,
}  # fmt: skip


def svg(panel: Panel) -> str:
    """The panel under its title."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(RC):
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        plot = figure.add_subplot()
        _lines(plot, panel)
        if panel.noise is not None:
            plot.axhspan(*panel.noise, color=BAND, lw=0, label=panel.band)
        _markers(plot, panel)
        plot.set_xlabel(panel.x_label)
        plot.set_ylabel(panel.y_label if len(panel.y_label) <= LONGEST else panel.y_label.replace(" [", "\n["))
        figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=TEXT - 1.0, handlelength=2.5)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    title = html.escape(panel.title)
    return f"<figure><figcaption>{title}</figcaption>{_inline(buffer.getvalue(), title)}</figure>"


def _inline(text: str, title: str) -> str:
    text = text[text.index("<svg") :].replace("<svg", f'<svg role="img" aria-label="{title}"', 1)
    for drawn, shown in INKS.items():
        text = text.replace(drawn, shown)
    return text


def _lines(plot: Axes, panel: Panel) -> None:
    for place, (name, values) in enumerate(panel.lines):
        ink, style, dot = STYLES[style_of(name, place)]
        way = "none" if panel.x.size <= FEWEST else style
        marker = dot if np.isfinite(values).sum() <= FEW else ""
        plot.plot(panel.x, values, ls=way, color=ink, lw=1.8 if name == FLOOR else 1.2, label=name, marker=marker, ms=5)
    if panel.x.size <= FEWEST:
        plot.set_xticks(panel.x)
        plot.margins(x=0.3)
    elif panel.x.size:
        edge = 0.01 * float(panel.x[-1] - panel.x[0])
        plot.set_xlim(float(panel.x[0]) - edge, float(panel.x[-1]) + edge)


def _markers(plot: Axes, panel: Panel) -> None:
    """Lines across; what several mean alike is said once, above the frame, in rows where words would meet."""
    said: set[str] = set()
    span = float(np.ptp(panel.x)) or 1.0
    ends: list[float] = []
    for x, text in sorted(panel.markers):
        plot.axvline(x, color=QUIET, lw=0.8, ls=(0, (2, 2)))
        if text in said:
            continue
        said.add(text)
        row = next((k for k, end in enumerate(ends) if x - end > CLOSE * span), len(ends))
        ends[row : row + 1] = [x]
        right = x - float(panel.x[0]) > 0.8 * span
        plot.annotate(
            text, (x, 1.0), (0, 2 + 13 * row), ("data", "axes fraction"), "offset points",
            fontsize=TEXT - 1.0, ha="right" if right else "left", va="bottom",
        )  # fmt: skip
