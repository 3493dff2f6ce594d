"""Charts as inline SVG: what a page shows before, and without, any script.

A chart carries classes instead of colours, so that one style sheet serves light, dark and print under a content
security policy without inline style. Long series are reduced to the extremes of each pixel column, so that no peak
is lost.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

LEFT, RIGHT, TOP, BOTTOM = 58.0, 20.0, 10.0, 40.0
FEW, MARKER_ROWS = 24, 3
"""Up to this many values are drawn as dots besides; markers have their words in this many rows."""


@dataclass(frozen=True)
class Series:
    """One line of a chart: x and y of the same length (n,), named for the legend.

    `style`: number of its colour and stroke, the same for one thing in all charts of a page; its place where None.
    """

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    style: int | None = None


@dataclass(frozen=True)
class Band:
    """A shaded range of y, such as a noise floor or a baseline."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Marker:
    """A vertical line at x, with its words."""

    x: float
    text: str


@dataclass(frozen=True)
class Stretch:
    """A marked range of x in seconds, with its words; without any it belongs to the one before."""

    start_s: float
    end_s: float
    text: str


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """Return round numbers of the 1-2-5 series that cover low to high.

    >>> ticks(0.0, 10.0)
    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    """
    if not high > low:
        return [low]
    raw = (high - low) / max(count - 1, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(k * step, 12) for k in range(first, last + 1)]


def extremes(series: Series, columns: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reduce a series to minimum and maximum of each of at most `columns` equal runs, in order of time."""
    n = series.y.size
    if n <= 2 * columns:
        return series.x, series.y
    size = -(-n // columns)
    starts = np.arange(0, n, size)
    ends = np.minimum.reduceat(series.y, starts), np.maximum.reduceat(series.y, starts)
    middles = np.minimum(starts + size // 2, n - 1)
    return np.stack([series.x[starts], series.x[middles]], axis=1).ravel(), np.stack(ends, axis=1).ravel()


def _limits(values: list[NDArray[np.float64]]) -> tuple[float, float]:
    joined = np.concatenate([np.empty(0), *(v[np.isfinite(v)] for v in values)])
    if joined.size == 0:
        return 0.0, 1.0
    low, high = float(joined.min()), float(joined.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _tick_text(value: float) -> str:
    return f"{value:.4g}".replace("-", "\N{MINUS SIGN}")


def line_chart(
    title: str,
    series: Sequence[Series],
    x_label: str,
    y_label: str,
    *,
    bands: Sequence[Band] = (),
    markers: Sequence[Marker] = (),
    events: Sequence[float] = (),
    stretches: Sequence[Stretch] = (),
    width: float = 640.0,
    height: float = 220.0,
) -> Markup:
    """Draw series over one pair of axes; the title is read out by screen readers, events stand as triangles."""
    x0, x1 = _limits([s.x for s in series])
    edges = [np.array([b.low, b.high]) for b in bands]
    y0, y1 = _limits([*(s.y for s in series), *edges])
    pad = (0.1 if bands else 0.04) * (y1 - y0)  # the edges of a band are seen
    y0, y1 = y0 - pad, y1 + pad
    inner_w, inner_h = width - LEFT - RIGHT, height - TOP - BOTTOM

    def px(x: float) -> float:
        return LEFT + (x - x0) / (x1 - x0) * inner_w

    def py(y: float) -> float:
        return TOP + (1.0 - (min(max(y, y0), y1) - y0) / (y1 - y0)) * inner_h

    parts = [_frame(title, x_label, y_label, width, height)]
    for value in ticks(y0, y1, 7):
        parts.append(
            f'<path class="grid-line" d="M{LEFT:.1f} {py(value):.1f}H{width - RIGHT:.1f}"/>'
            f'<text x="{LEFT - 7:.1f}" y="{py(value) + 4:.1f}" text-anchor="end">{_tick_text(value)}</text>'
        )
    parts += [
        f'<text x="{px(value):.1f}" y="{height - BOTTOM + 16:.1f}" text-anchor="middle">{_tick_text(value)}</text>'
        for value in ticks(x0, x1, 8)
    ]
    for band in bands:
        top, bottom = py(band.high), py(band.low)
        parts.append(
            f'<rect class="band" x="{LEFT}" y="{top:.1f}" width="{inner_w:.1f}" height="{bottom - top:.1f}">'
            f"<title>{escape(band.name)}</title></rect>"
        )
    parts += _stretches([(px(max(s.start_s, x0)), px(min(s.end_s, x1)), s.text) for s in stretches], width, height)
    for place, one in enumerate(series, start=1):
        number = one.style or place
        x, y = extremes(one, int(inner_w))
        keep = np.isfinite(y) & (x >= x0) & (x <= x1)
        line = _line([(px(float(a)), py(float(b))) if k else None for a, b, k in zip(x, y, keep, strict=True)])
        parts.append(f'<path class="series s{number}" d="{line}"><title>{escape(one.name)}</title></path>')
        if x.size <= FEW:
            parts += [
                f'<circle class="dot s{number}" cx="{px(float(a)):.1f}" cy="{py(float(b)):.1f}" r="3"/>'
                for a, b in zip(x[keep], y[keep], strict=True)
            ]
    parts += _markers([(px(marker.x), marker.text) for marker in markers if x0 <= marker.x <= x1], width, height)
    for event in events:
        if x0 <= event <= x1:
            x_px = px(event)
            parts.append(f'<path class="event" d="M{x_px - 4:.1f} {TOP}h8l-4 7z"/>')
    parts.append(f'<path class="axis" d="M{LEFT} {TOP}V{height - BOTTOM}H{width - RIGHT}"/></svg>')
    return Markup("".join(parts))  # noqa: S704  every text above is escaped


def _frame(title: str, x_label: str, y_label: str, width: float, height: float) -> str:
    middle = TOP + (height - TOP - BOTTOM) / 2
    return (
        f'<svg class="chart" viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{escape(title)}">'
        f'<text x="{LEFT + (width - LEFT - RIGHT) / 2:.1f}" y="{height - 6:.1f}" text-anchor="middle">'
        f"{escape(x_label)}</text>"
        f'<text transform="translate(13 {middle:.1f}) rotate(-90)" text-anchor="middle">{escape(y_label)}</text>'
    )


def _line(points: Sequence[tuple[float, float] | None]) -> str:
    """Return the path through points, broken where there is none.

    >>> _line([(0.0, 1.0), (1.0, 2.0), None, (3.0, 4.0)])
    'M0.0 1.0L1.0 2.0M3.0 4.0'
    """
    before = (None, *points)
    return "".join(
        f"{'L' if last else 'M'}{point[0]:.1f} {point[1]:.1f}"
        for last, point in zip(before, points, strict=False)
        if point
    )


def _stretches(places: Sequence[tuple[float, float, str]], width: float, height: float) -> list[str]:
    """Shade ranges between two lines; words stand at the bottom, for those of markers stand at the top."""
    bottom = height - BOTTOM
    wide = [(low, max(high, low + 2), text) for low, high, text in sorted(places)]
    shades = [
        f'<rect class="stretch" x="{low:.1f}" y="{TOP}" width="{high - low:.1f}" height="{bottom - TOP:.1f}"/>'
        f'<path class="stretch-edge" d="M{low:.1f} {TOP}V{bottom}M{high:.1f} {TOP}V{bottom}"/>'
        for low, high, _ in wide
    ]
    words = [
        f'<text class="stretch-word" x="{left:.1f}" y="{bottom - 5 - 13 * row:.1f}">{escape(text)}</text>'
        for left, row, text in _rows([(low, text) for low, _, text in wide], width)
    ]
    return shades + words


def _markers(places: Sequence[tuple[float, str]], width: float, height: float) -> list[str]:
    """Draw vertical lines; words that would run into each other go into a row of their own."""
    lines = [f'<path class="marker" d="M{x:.1f} {TOP}V{height - BOTTOM}"/>' for x, _ in places]
    return lines + [
        f'<text x="{left:.1f}" y="{TOP + 10 + 13 * row:.1f}">{escape(text)}</text>'
        for left, row, text in _rows(sorted(places), width)
    ]


def _rows(places: Sequence[tuple[float, str]], width: float) -> Iterator[tuple[float, int, str]]:
    """Give words that stand at x a left edge and a row each, so that they do not run into each other."""
    ends = [0.0] * MARKER_ROWS
    for x, text in places:
        if text:
            long = 6.0 * len(text)
            left = min(x + 3, width - RIGHT - long)
            row = next((k for k, end in enumerate(ends) if end <= left), 0)
            ends[row] = left + long
            yield left, row, text


def polar_chart(
    title: str, values: Sequence[float | None], marked_deg: float | None = None, *, size: float = 300.0
) -> Markup:
    """Draw a value around one cycle of a motion back and forth, and a marked phase; None was never heard.

    The values hold equal sectors that start at 0 degrees (up), one reversal, and run clockwise; the other is below.
    """
    centre = size / 2
    inner, outer = centre * 0.25, centre * 0.78
    peak = max((v for v in values if v is not None), default=1.0) or 1.0
    parts = [f'<svg class="chart polar" viewBox="0 0 {size:.0f} {size:.0f}" role="img" aria-label="{escape(title)}">']
    for k, value in enumerate(values):
        a, b = 2 * math.pi * k / len(values), 2 * math.pi * (k + 1) / len(values)
        radius = outer if value is None else inner + (outer - inner) * value / peak
        kind = "unvisited" if value is None else f"sector s{1 if 2 * k < len(values) else 2}"
        parts.append(f'<path class="{kind}" d="{_sector(centre, inner, radius, a, b)}"/>')
    parts.append(f'<circle class="axis" cx="{centre}" cy="{centre}" r="{inner:.1f}"/>')
    words = {0: "0° reversal", 90: "90°", 180: "180° reversal", 270: "270°"}
    for degrees, text in words.items():
        x, y = _around(centre, centre * 0.9, degrees)
        parts.append(f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle">{text}</text>')
    if marked_deg is not None:
        (x0, y0), (x1, y1) = (_around(centre, part * centre, marked_deg) for part in (0.25, 0.84))
        parts.append(f'<path class="phase" data-phase="{marked_deg:.0f}" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>')
    return Markup("".join([*parts, "</svg>"]))  # noqa: S704  every text above is escaped


def _around(centre: float, radius: float, degrees: float) -> tuple[float, float]:
    angle = math.radians(degrees)
    return centre + radius * math.sin(angle), centre - radius * math.cos(angle)


def _sector(centre: float, inner: float, outer: float, a: float, b: float) -> str:
    def at(radius: float, angle: float) -> str:
        return f"{centre + radius * math.sin(angle):.1f} {centre - radius * math.cos(angle):.1f}"

    return (
        f"M{at(inner, a)}L{at(outer, a)}A{outer:.1f} {outer:.1f} 0 0 1 {at(outer, b)}"
        f"L{at(inner, b)}A{inner:.1f} {inner:.1f} 0 0 0 {at(inner, a)}Z"
    )


def shape_name(label: str) -> str:
    """Return the class of a label's shape and colour; labels without their own share one.

    >>> shape_name("notch"), shape_name("pitting")
    ('notch', 'other')
    """
    return label if label in ("normal", "play", "notch") else "other"


def sign_of(label: str | None) -> str:
    """Return the class of shape and colour of an answer: every fault has that of a likely fault, none that of unknown.

    >>> sign_of("play"), sign_of("normal"), sign_of(None)
    ('notch', 'normal', 'other')
    """
    return "other" if label is None else "normal" if label == "normal" else "notch"


def shape_path(label: str, x: float, y: float, r: float) -> str:
    """Return the path of a label's shape around (x, y): circle, diamond, triangle, or square."""
    name = shape_name(label)
    if name == "normal":
        return f"M{x - r:.1f} {y:.1f}a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0z"
    if name == "play":
        return f"M{x:.1f} {y - 1.25 * r:.1f}l{1.25 * r} {1.25 * r}l{-1.25 * r} {1.25 * r}l{-1.25 * r} {-1.25 * r}z"
    if name == "notch":
        return f"M{x:.1f} {y - 1.2 * r:.1f}l{1.2 * r} {2.1 * r}h{-2.4 * r}z"
    return f"M{x - r:.1f} {y - r:.1f}h{2 * r}v{2 * r}h{-2 * r}z"
