"""The trend of a gearbox as charts: what rises with a fault, against its own baseline, with what was done to it."""

import math
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike

from app.report.charts import Chart
from app.report.svg import Band, Marker, Series
from casebase.gearboxes import NOTE, History
from casebase.reasoning.trend import CREST_FACTOR, RECORDINGS_PER_FALSE_ALARM, Followed, Trend
from signals.band import Band as SignalBand
from signals.features import feature_words

LOW = SignalBand.LOW.label
SHOWN = (
    (f"play_bump_{LOW}", "Impacts at the reversal: rise with backlash", "height above noise [dB]"),
    (f"notch_bump_{LOW}", "Impacts in one direction: rise with tooth damage", "height above noise [dB]"),
    (CREST_FACTOR, "Crest factor below 200 Hz", "crest factor [1]"),
)
RISING = {
    "play_bump": "impacts at the reversal",
    "notch_bump": "impacts in one direction",
    "strongest_impulse": "strongest impact of a cycle",
}
"""What rises, by the beginning of a feature's name; its band follows."""
LEVELS = ("RMS", "peak")
SIZES = (("size", "value", 1), ("low end of 90 %", "low", 6), ("high end of 90 %", "high", 6))
"""Words, key and style of each line of a size."""
UNITS = (("days", 86400.0, 2.0), ("hours", 3600.0, 2.0), ("minutes", 60.0, 0.0))
"""Name, length [s], and how many of it a trend must span to be drawn in it."""


def charts_of(trend: Trend, history: History, sizes: Mapping[str, Mapping[str, float]]) -> list[Chart]:
    """Return the charts of a gearbox.

    Args:
        sizes: of the fault, by the id of the recording: value, low, high [rad].
    """
    marks = _marks(trend, history)
    followed = {one.name: one for one in trend.followed}
    charts = [_followed(trend, followed[name], title, label, marks) for name, title, label in SHOWN]
    leading = trend.leading
    if leading.name not in {name for name, _, _ in SHOWN} and trend.changed:
        unit = "height above noise [dB]"
        charts.insert(0, _followed(trend, leading, f"What rises most: {_rising(leading.name)}", unit, marks))
    sized = _size(trend, sizes, marks)
    return [chart for chart in (*charts, sized) if chart is not None]


def chart_of(trend: Trend, history: History, label: str | None, here: tuple[datetime, str]) -> Chart:
    """Return the chart that rises with the fault of a label, with one recording marked; by default the reversal's."""
    followed = {one.name: one for one in trend.followed}
    name, title, unit = SHOWN[1] if label == "notch" else SHOWN[0]
    return _followed(trend, followed[name], title, unit, _marks(trend, history, here))


def _rising(name: str) -> str:
    words, _, band = feature_words(name).partition(",")
    return next((told for beginning, told in RISING.items() if name.startswith(beginning)), words) + f",{band}"


def _time_axis(trend: Trend) -> tuple[str, Callable[[datetime], float]]:
    """Return the words of the axis of time, and where a time stands on it."""
    start, end = trend.recordings[0].at, trend.recordings[-1].at
    span_s = (end - start).total_seconds()
    name, length_s, _ = next(unit for unit in UNITS if span_s >= unit[1] * unit[2])
    written = f"{start:%Y-%m-%d}" if name == "days" else f"{start:%Y-%m-%d %H:%M} UTC"
    return f"{name} since {written}", lambda at: (at - start).total_seconds() / length_s


def _marks(trend: Trend, history: History, *here: tuple[datetime, str]) -> tuple[Marker, ...]:
    _, place = _time_axis(trend)
    words = [(each.at, each.text if each.kind == NOTE else f"{each.kind}: {each.text}") for each in history.done]
    if trend.at_once is not None:
        words.append((trend.at_once.at, "change at once"))
    elif trend.changed:
        words.append((trend.began.at, "change begins"))
    return tuple(Marker(place(at), text[:24]) for at, text in (*words, *here))


def _chart(
    trend: Trend,
    title: str,
    label: str,
    marks: tuple[Marker, ...],
    *lines: tuple[str, Sequence[int], ArrayLike, int | None],
    bands: tuple[Band, ...] = (),
) -> Chart:
    """Return a chart of lines, each with its words, the recordings that it is of, its values and its style."""
    name, place = _time_axis(trend)
    series = tuple(
        Series(words, np.array([place(trend.recordings[row].at) for row in rows]), np.asarray(values), style)
        for words, rows, values, style in lines
    )
    return Chart(title, series, name, label, bands=bands, markers=marks)


def _followed(trend: Trend, one: Followed, title: str, label: str, marks: tuple[Marker, ...]) -> Chart:
    found = one.expected()
    expected = Band(f"expected: all but 1 in {RECORDINGS_PER_FALSE_ALARM:,} good recordings", found.low, found.high)
    line = ("as it would be in the typical state of operation", one.rows.tolist(), found.adjusted, None)
    return _chart(trend, title, label, marks, line, bands=(expected,) if math.isfinite(found.low) else ())


def level_chart(trend: Trend, history: History) -> Chart:
    """Return the chart of RMS and peak, which follow the place of the microphone, too."""
    followed = {one.name: one for one in trend.followed}
    lines = [(words, followed[words.lower()].rows.tolist(), followed[words.lower()].values, None) for words in LEVELS]
    return _chart(trend, "RMS and peak as recorded", "level [unit of the sound]", _marks(trend, history), *lines)


def _size(trend: Trend, sizes: Mapping[str, Mapping[str, float]], marks: tuple[Marker, ...]) -> Chart | None:
    rows = [row for row, one in enumerate(trend.recordings) if one.recording_id in sizes]
    if len(rows) < 2:
        return None
    found = [sizes[trend.recordings[row].recording_id] for row in rows]
    lines = [(words, rows, [1e3 * each[key] for each in found], style) for words, key, style in SIZES]
    return _chart(trend, "Size of the fault", "size [mrad]", marks, *lines)
