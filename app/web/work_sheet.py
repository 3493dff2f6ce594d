"""An investigation on one page of paper: the box, the plot that shows it, what to check, and who signs for it."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from app.report.charts import Chart
from app.web.story import Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # slow to import

A4_INCHES = (8.27, 11.69)
POINTS = 72.0
WIDTH, HEIGHT = (POINTS * side for side in A4_INCHES)
MARGIN, INDENT, CHECK = 42.0, 78.0, 16.0  # points
LINE = 1.32  # of the size of its letters
SIZES = (10.0, 9.5, 9.0, 8.5, 8.0, 7.5, 7.0)  # of letters, the largest with which all stands on one page
PLOT, SIGNED_HEIGHT = 165.0, 140.0  # points
STYLES = {1: ("#0a6480", "-"), 2: ("#b45309", "--"), 5: ("#000000", (0, (9, 3))), 6: ("#4c585e", ":")}
AFTERWARDS = "Afterwards measure the same motion again, and compare it with this investigation."
OUTCOMES = ("in order", "repaired", "to be repaired", "to be measured again")
SIGNED = ("Checked by", "Date", "Signature", "Released by", "Date", "Signature")
NOTE = "An aid for people who maintain gearboxes; no safety function, no claim of remaining life."


@dataclass(frozen=True)
class Sheet:
    """What stands on the page, as text."""

    measured: str
    headline: str
    box: Sequence[Shown]
    next_measurement: str
    address: str

    @property
    def chart(self) -> Chart | None:
        """The plot of what is said first, where there is one."""
        return next((one.chart for one in self.box if one.chart is not None), None)

    @property
    def checks(self) -> list[str]:
        """What is to be ticked off, each once."""
        steps = [one.entry.do_first for one in self.box]
        steps += [f"Measure next: {self.next_measurement}"] if self.next_measurement else []
        return list(dict.fromkeys([*steps, AFTERWARDS]))


@dataclass(frozen=True)
class Piece:
    """Lines of text at one place: how far from the left [pt], size [pt], and what stands before them."""

    lines: tuple[str, ...]
    left: float
    size: float
    bold: bool = False
    label: str = ""
    box: bool = False
    gap: float = 3.0

    @property
    def height(self) -> float:
        """With the gap below [pt]."""
        return len(self.lines) * self.size * LINE + self.gap


def investigation_pdf(sheet: Sheet) -> bytes:
    """Return one page, A4."""
    from matplotlib.backends.backend_pdf import PdfPages

    target = io.BytesIO()
    with PdfPages(target, metadata={"Title": sheet.headline, "Creator": "Gearcase"}) as pages:
        pages.savefig(drawn(sheet))
    return target.getvalue()


def drawn(sheet: Sheet) -> Figure:
    """Return the page in the largest letters with which everything stands on it, or as much of it as has room."""
    room = HEIGHT - 2 * MARGIN - (PLOT if sheet.chart else 0.0) - SIGNED_HEIGHT
    for size in SIZES:
        pieces = list(_pieces(sheet, size))
        if sum(piece.height for piece in pieces) <= room:
            return _drawn(sheet, pieces)
    return _drawn(sheet, _cut(pieces, room))


def _cut(pieces: list[Piece], room: float) -> list[Piece]:
    """As many as there is room for, and where the rest is."""
    rest = Piece(("More than fits here: the page of this investigation has the rest.",), MARGIN, SIZES[-1], bold=True)
    kept: list[Piece] = []
    left = room - rest.height
    for piece in pieces:
        left -= piece.height
        if left < 0.0:
            return [*kept, rest]
        kept.append(piece)
    return kept


def _pieces(sheet: Sheet, size: float) -> Iterator[Piece]:
    wide = WIDTH - 2 * MARGIN
    yield Piece(_wrapped(sheet.measured, wide, size - 1.0), MARGIN, size - 1.0, gap=4.0)
    yield Piece(_wrapped(sheet.headline, wide, 1.7 * size, bold=True), MARGIN, 1.7 * size, bold=True, gap=6.0)
    for one in sheet.box:
        for label, text in one.entry.facts[:-1]:  # what to do is ticked off below
            yield Piece(_wrapped(text, wide - INDENT, size), MARGIN + INDENT, size, label=label)
        yield Piece((), MARGIN, size, gap=5.0)
    yield Piece(("Do now, in this order",), MARGIN, 1.2 * size, bold=True)
    for text in sheet.checks:
        yield Piece(_wrapped(text, wide - CHECK, size), MARGIN + CHECK, size, box=True)


def _drawn(sheet: Sheet, pieces: Sequence[Piece]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=A4_INCHES)
    y = HEIGHT - MARGIN
    for piece in pieces:
        if piece.label:
            _text(figure, MARGIN, y, piece.label, piece.size, bold=True)
        if piece.box:
            _box(figure, MARGIN, y, piece.size)
        for number, line in enumerate(piece.lines):
            _text(figure, piece.left, y - number * piece.size * LINE, line, piece.size, bold=piece.bold)
        y -= piece.height
    if sheet.chart is not None:
        _plot(figure, sheet.chart, y)
        y -= PLOT
    _signed(figure, y - 6.0)
    _text(figure, MARGIN, MARGIN - 8.0, f"{sheet.address}   {NOTE}", 6.5)
    return figure


def _signed(figure: Figure, y: float) -> None:
    """Found at the machine, the outcome to tick, and two lines to sign."""
    from matplotlib.lines import Line2D

    def line(left: float, right: float, at: float) -> None:
        ends = [left / WIDTH, right / WIDTH], [at / HEIGHT, at / HEIGHT]
        figure.add_artist(Line2D(*ends, color="#000000", linewidth=0.6))

    _text(figure, MARGIN, y, "Found at the machine", 9.0, bold=True)
    line(MARGIN + 110.0, WIDTH - MARGIN, y - 10.0)
    y -= 26.0
    for place, outcome in enumerate(OUTCOMES):
        left = MARGIN + place * (WIDTH - 2 * MARGIN) / len(OUTCOMES)
        _box(figure, left, y, 9.0)
        _text(figure, left + CHECK, y, outcome, 9.0)
    third = (WIDTH - 2 * MARGIN) / 3
    for place, name in enumerate(SIGNED):
        left, at = MARGIN + (place % 3) * third, y - 40.0 - 34.0 * (place // 3)
        line(left, left + third - 14.0, at)
        _text(figure, left, at - 2.0, name, 7.5)


def _plot(figure: Figure, chart: Chart, top: float) -> None:
    low = (top - PLOT + 38.0) / HEIGHT
    axes = figure.add_axes(((MARGIN + 34.0) / WIDTH, low, (WIDTH - 2 * MARGIN - 44.0) / WIDTH, (PLOT - 66.0) / HEIGHT))
    for place, one in enumerate(chart.series, start=1):
        colour, stroke = STYLES.get(one.style or place, ("#7a3e9d", "-"))
        axes.plot(one.x, one.y, color=colour, linestyle=stroke, linewidth=1.0, label=one.name)
    for band in chart.bands:
        axes.axhspan(band.low, band.high, color="#6e7d8c", alpha=0.2, linewidth=0, label=band.name)
    for marker in chart.markers:
        axes.axvline(marker.x, color="#4c585e", linewidth=0.5, linestyle=":")
    axes.set_title(chart.title, fontsize=9, loc="left", parse_math=False)
    axes.set_xlabel(chart.x_label, fontsize=8, parse_math=False)
    axes.set_ylabel(chart.y_label, fontsize=8, parse_math=False)
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=7, loc="best", frameon=False)


def _text(figure: Figure, left: float, top: float, text: str, size: float, *, bold: bool = False) -> None:
    weight = "bold" if bold else "normal"
    figure.text(left / WIDTH, top / HEIGHT, text, fontsize=size, fontweight=weight, va="top", parse_math=False)


def _box(figure: Figure, left: float, top: float, size: float) -> None:
    from matplotlib.patches import Rectangle

    corner = left / WIDTH, (top - size) / HEIGHT
    square = Rectangle(corner, size / WIDTH, size / HEIGHT, fill=False, linewidth=0.8, transform=figure.transFigure)
    figure.add_artist(square)


def _wrapped(text: str, width: float, size: float, *, bold: bool = False) -> tuple[str, ...]:
    """Lines no wider than `width` [pt]; a word that is wider stands alone."""
    lines: list[str] = []
    for part in text.split("\n"):
        line = ""
        for word in part.split(" "):
            longer = f"{line} {word}" if line else word
            if line and _width(longer, bold) * size > width:
                lines.append(line)
                line = word
            else:
                line = longer
        lines.append(line)
    return tuple(lines)


@lru_cache(maxsize=4096)
def _width(text: str, bold: bool) -> float:
    """Of letters of one point [pt]."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    hundred = FontProperties(weight="bold" if bold else "normal", size=100.0)
    width, _, _ = text_to_path.get_text_width_height_descent(text, hundred, ismath=False)
    return float(width) / 100.0
