"""What the pages plot: one description per chart, drawn as SVG at once and sent as JSON to the interactive plot."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from app.recordings import views
from app.report.disturbed import stretches
from app.report.svg import Band, Marker, Series, Stretch, line_chart, polar_chart
from casebase.gearboxes import NOTE, History
from casebase.reasoning.trend import CREST_FACTOR, RECORDINGS_PER_FALSE_ALARM, Followed, Trend
from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.band import Band as SignalBand
from signals.features import feature_words
from signals.half_cycles import HalfCycles
from signals.recording import Recording
from signals.recording_quality.disturbances import Survey

SECTORS = 72
SHOWN_POINTS = 6000


@dataclass(frozen=True)
class Chart:
    """Lines over one pair of axes and what is marked there; charts with the same cursor are read together."""

    title: str
    series: tuple[Series, ...]
    x_label: str
    y_label: str
    bands: tuple[Band, ...] = ()
    markers: tuple[Marker, ...] = ()
    events: tuple[float, ...] = ()
    stretches: tuple[Stretch, ...] = ()
    cursor: str = ""
    clock: tuple[str, float] | None = None
    """Of a trend: the time at which x is 0, ISO 8601, and the length of its unit [s]."""

    def svg(self, width: float = 640.0, height: float = 220.0) -> Markup:
        """Draw it."""
        return line_chart(
            self.title,
            self.series,
            self.x_label,
            self.y_label,
            bands=self.bands,
            markers=self.markers,
            events=self.events,
            stretches=self.stretches,
            width=width,
            height=height,
        )

    def document(self) -> dict[str, object]:
        """Return it as JSON for the interactive plot; all series share the x of the first, in a trend that of all."""
        x = self.series[0].x if self.clock is None else np.unique(np.concatenate([one.x for one in self.series]))
        return {
            "title": self.title,
            "x_label": self.x_label,
            "y_label": self.y_label,
            "x": x.tolist(),
            "series": [
                {"name": one.name, "y": _finite(_on(x, one, self.clock is None)), "style": one.style or place}
                for place, one in enumerate(self.series, start=1)
            ],
            "bands": [{"name": b.name, "low": b.low, "high": b.high} for b in self.bands],
            "markers": [{"x": m.x, "text": m.text} for m in self.markers],
            "events": list(self.events),
            "stretches": [{"start": s.start_s, "end": s.end_s, "text": s.text} for s in self.stretches],
        }


def _on(x: NDArray[np.float64], series: Series, is_course: bool) -> NDArray[np.float64]:
    if is_course:
        return series.y if series.x is x else np.interp(x, series.x, series.y, left=np.nan, right=np.nan)
    values = np.full(x.size, np.nan)
    values[np.searchsorted(x, series.x)] = series.y
    return values


def _finite(values: NDArray[np.float64]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def envelope(samples: NDArray[np.float32], rate_hz: float, points: int) -> Series:
    """Lowest and highest sample of each interval, one after the other, so that no peak is lost."""
    width = max(1, math.ceil(2 * samples.size / points))
    starts = np.arange(0, samples.size, width)
    values = np.stack([np.minimum.reduceat(samples, starts), np.maximum.reduceat(samples, starts)], axis=1).ravel()
    times = (np.repeat(starts, 2) + np.tile([0.0, width / 2], starts.size)) / rate_hz
    return Series("", times, values.astype(np.float64))


def waveform(surveyed: Survey, events: tuple[float, ...], points: int = SHOWN_POINTS) -> Chart:
    """The sound, what is analysed of it below 200 Hz, reversals of the motion, impulses, and what is left out."""
    recording, analysis = surveyed.recording, surveyed.analysis
    sound = envelope(recording.samples, recording.sample_rate_hz, points)
    low = envelope(analysis.low_passed, ANALYSIS_RATE_HZ, points)
    return Chart(
        "Sound over time",
        (Series("sound", sound.x, sound.y), Series("below 200 Hz", low.x + surveyed.start_s, low.y)),
        "time [s]",
        f"sound, 0 to peak [{recording.unit}]",
        markers=reversals(surveyed),
        events=events,
        stretches=stretches(surveyed),
        cursor="time",
    )


def reversals(surveyed: Survey) -> tuple[Marker, ...]:
    """The first reversals of the motion that were recognised, the first of them named."""
    times = surveyed.analysis.motion.reversal_times_s[:40]
    return tuple(Marker(t + surveyed.start_s, "" if number else "reversal") for number, t in enumerate(times))


def crest_trace(surveyed: Survey) -> Chart:
    """Figures 8 and 9 of the paper: crest factor over time, its mean, when it is largest, reversals of the motion."""
    found = views.crest(surveyed.recording)
    times = np.array(found.time_s)
    values = np.array(found.crest_factor, dtype=np.float64)
    series = [Series(f"below {found.low_pass_hz:g} Hz, windows of {found.window_s:g} s", times, values)]
    if found.mean and found.whole_record:
        words = (
            f"mean {found.mean:.2f}; the largest, {found.whole_record:.2f}, is {found.whole_record / found.mean:.1f}"
        )
        series.append(Series(f"{words} times as large", times, np.full(times.size, found.mean)))
    return Chart(
        "Crest factor over time",
        tuple(series),
        "time [s]",
        "crest factor [1]",
        markers=reversals(surveyed),
        events=tuple(times[values == found.whole_record].tolist()),
        stretches=stretches(surveyed),
        cursor="time",
    )


def level_trace(recording: Recording) -> Chart:
    """RMS and peak of the whole sound in windows of the same length: crest factor can fall as damage grows."""
    found = views.crest(recording, low_pass_hz=0)
    times = np.array(found.time_s)
    return Chart(
        "RMS and peak over time",
        (Series("RMS", times, np.array(found.rms)), Series("peak", times, np.array(found.peak))),
        "time [s]",
        f"level [{recording.unit}]",
        cursor="time",
    )


def spectrum(recording: Recording, markers: tuple[Marker, ...], order_hz: float | None = None) -> Chart:
    """Averaged spectrum in hertz or, with the frequency of order 1 given, in orders of the output."""
    found = views.spectrum(recording, 2.0)
    frequency = np.array(found.frequency_hz)
    scale = order_hz or 1.0
    moved = tuple(Marker(m.x / scale, m.text) for m in markers)
    label = f"order of the output, at {order_hz:.3g} Hz [1]" if order_hz else "frequency [Hz]"
    return Chart(
        "Spectrum",
        (Series("spectrum", frequency / scale, np.array(found.level_db)),),
        label,
        f"level, rms [dB re {recording.unit}²]",
        markers=moved,
    )


def fold_charts(analysis: Analysis, marked_deg: float | None = None) -> tuple[Chart, Markup] | None:
    """The low band folded on the strokes: over time from the reversal, and around the cycle of the motion.

    None where no motion is known or heard.
    """
    folded = analysis.folded(SignalBand.LOW)
    if folded is None:
        return None
    chart = Chart(
        "Average stroke of the motion",
        (
            Series("around one end of the motion", folded.offset_s, folded.forward_db),
            Series("around the other end", folded.offset_s, folded.backward_db),
        ),
        "time from the reversal [s]",
        "height above noise [dB]",
        markers=(Marker(0.0, "standstill"),),
    )
    return chart, cycle_chart(folded, marked_deg)


def cycle_chart(folded: HalfCycles, marked_deg: float | None = None) -> Markup:
    """Draw the height above noise around one cycle of the motion, with a marked phase [°].

    0° is the first reversal that was heard, as for the phases that the evidence tells; half a cycle later is the other.
    """
    per_hop = 180.0 / folded.offset_s.size
    hops = np.arange(folded.offset_s.size) - folded.offset_s.size // 2
    phase_deg = np.concatenate([per_hop * hops, 180.0 + per_hop * hops]) % 360.0
    height_db = np.concatenate([folded.forward_db, folded.backward_db])
    sector = (phase_deg / 360.0 * SECTORS).astype(int)
    heights: list[float | None] = []
    for k in range(SECTORS):
        here = height_db[(sector == k) & np.isfinite(height_db)]
        heights.append(max(0.0, float(here.max())) if here.size else None)
    return polar_chart("Height above noise around one cycle of the motion", heights, marked_deg)


LOW = SignalBand.LOW.label
SHOWN = (
    (f"play_bump_{LOW}", "Impacts at the reversal: rise with backlash", "height above noise [dB]"),
    (f"notch_bump_{LOW}", "Impacts in one direction: rise with tooth damage", "height above noise [dB]"),
    (CREST_FACTOR, "Crest factor below 200 Hz", "crest factor [1]"),
)
LEVELS = {"rms": "RMS", "peak": "peak"}
SIZES = (("size", "value", 1), ("low end of 90 %", "low", 6), ("high end of 90 %", "high", 6))
"""Words, key and style of each line of a size."""
UNITS = (("days", 86400.0, 2.0), ("hours", 3600.0, 2.0), ("minutes", 60.0, 0.0))
"""Name, length [s], and how many of it a trend must span to be drawn in it."""


@dataclass(frozen=True)
class Window:
    """What is looked at of a trend: all of it, or what lies between two times, and other gearboxes laid over it."""

    since: datetime | None = None
    until: datetime | None = None
    others: Mapping[str, Trend] = field(default_factory=dict)

    def holds(self, at: datetime) -> bool:
        """Whether a time is looked at."""
        return (self.since is None or at >= self.since) and (self.until is None or at <= self.until)


WHOLE = Window()


def charts_of(
    trend: Trend, history: History, sizes: Mapping[str, Mapping[str, float]], window: Window = WHOLE
) -> list[Chart]:
    """Return the charts of a gearbox; RMS and peak, which follow the place of the microphone too, stand last.

    Args:
        sizes: of the fault, by the id of the recording: value, low, high [rad].
    """
    marks = _marks(trend, history)
    followed = {one.name: one for one in trend.followed}
    charts = [_followed(trend, followed[name], title, label, marks, window) for name, title, label in SHOWN]
    leading = trend.leading
    if leading.name not in {name for name, _, _ in SHOWN} and trend.changed:
        title, unit = f"What rises most: {feature_words(leading.name)}", "height above noise [dB]"
        charts.insert(0, _followed(trend, leading, title, unit, marks, window))
    lines = [(words, _times(trend, followed[key].rows), followed[key].values, None) for key, words in LEVELS.items()]
    level = _chart(trend, "RMS and peak as recorded", "level [unit of the sound]", marks, window, *lines)
    return [chart for chart in (*charts, _size(trend, sizes, marks, window), level) if chart is not None]


def chart_of(trend: Trend, history: History, label: str | None, here: tuple[datetime, str]) -> Chart:
    """Return the chart that rises with the fault of a label, with one recording marked; by default the reversal's."""
    followed = {one.name: one for one in trend.followed}
    name, title, unit = SHOWN[1] if label == "notch" else SHOWN[0]
    return _followed(trend, followed[name], title, unit, _marks(trend, history, here), WHOLE)


def _time_axis(trend: Trend) -> tuple[str, tuple[str, float], Callable[[datetime], float]]:
    """Return the words of the axis of time, its clock, and where a time stands on it."""
    start, end = trend.recordings[0].at, trend.recordings[-1].at
    span_s = (end - start).total_seconds()
    name, length_s, _ = next(unit for unit in UNITS if span_s >= unit[1] * unit[2])
    written = f"{start:%Y-%m-%d}" if name == "days" else f"{start:%Y-%m-%d %H:%M} UTC"
    clock = start.isoformat(), length_s
    return f"{name} since {written}", clock, lambda at: (at - start).total_seconds() / length_s


def _marks(trend: Trend, history: History, *here: tuple[datetime, str]) -> tuple[Marker, ...]:
    *_, place = _time_axis(trend)
    words = [(each.at, each.text if each.kind == NOTE else f"{each.kind}: {each.text}") for each in history.done]
    if trend.at_once is not None:
        words.append((trend.at_once.at, "change at once"))
    elif trend.changed:
        words.append((trend.began.at, "change begins"))
    return tuple(Marker(place(at), text[:24]) for at, text in (*words, *here))


def _times(trend: Trend, rows: Iterable[int]) -> list[datetime]:
    return [trend.recordings[row].at for row in rows]


def _chart(
    trend: Trend,
    title: str,
    label: str,
    marks: tuple[Marker, ...],
    window: Window,
    *lines: tuple[str, Sequence[datetime], ArrayLike, int | None],
    bands: tuple[Band, ...] = (),
) -> Chart:
    """Return a chart of lines, each with its words, its times, its values and its style."""
    name, clock, place = _time_axis(trend)
    series = []
    for words, times, values, style in lines:
        shown = [window.holds(at) for at in times]
        x = np.array([place(at) for at in times])[shown]
        series.append(Series(words, x, np.asarray(values)[shown], style))
    return Chart(title, tuple(series), name, label, bands=bands, markers=marks, clock=clock)


def _followed(trend: Trend, one: Followed, title: str, label: str, marks: tuple[Marker, ...], window: Window) -> Chart:
    found = one.expected()
    expected = Band(f"expected: all but 1 in {RECORDINGS_PER_FALSE_ALARM:,} good recordings", found.low, found.high)
    lines = [("as it would be in the typical state of operation", _times(trend, one.rows), found.adjusted, None)]
    for words, other in window.others.items():
        same = next(each for each in other.followed if each.name == one.name)
        lines.append((words, _times(other, same.rows), same.expected().adjusted, None))
    bands = (expected,) if math.isfinite(found.low) else ()
    return _chart(trend, title, label, marks, window, *lines, bands=bands)


def _size(
    trend: Trend, sizes: Mapping[str, Mapping[str, float]], marks: tuple[Marker, ...], window: Window
) -> Chart | None:
    rows = [row for row, one in enumerate(trend.recordings) if one.recording_id in sizes]
    if len(rows) < 2:
        return None
    found = [sizes[trend.recordings[row].recording_id] for row in rows]
    lines = [(words, _times(trend, rows), [1e3 * each[key] for each in found], style) for words, key, style in SIZES]
    return _chart(trend, "Size of the fault", "size [mrad]", marks, window, *lines)
