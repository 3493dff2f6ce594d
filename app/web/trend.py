"""Trend: crest factor of one gearbox over time, with its baseline and what was done to it."""

from collections.abc import Sequence
from datetime import datetime

import numpy as np

from app.web.charts import Chart
from app.web.svg import Band, Marker, Series
from casebase.models import StoredRecording
from casebase.signals.features import feature_words

FEATURE = "crest_factor_low_pass_200_hz_median_of_cycles"
"""Below 200 Hz a fault stands above what the microphone hears of everything else, and one knock is no trend."""
BASELINE = 5
SAME_STATE = 0.1
UNITS = (("days", 86400.0, 2.0), ("hours", 3600.0, 2.0), ("minutes", 60.0, 0.0))
"""Name, length [s], and how many of it a trend must span to be drawn in it."""


def when(row: StoredRecording) -> datetime:
    """Return when it was recorded or, where that was not told, received."""
    return row.recorded_at or row.created_at


def trend(title: str, points: Sequence[tuple[datetime, float]], marks: Sequence[tuple[datetime, str]]) -> Chart | None:
    """Draw values over time; None with fewer than two."""
    if len(points) < 2:
        return None
    ordered = sorted(points)
    start, end = ordered[0][0], ordered[-1][0]
    span_s = (end - start).total_seconds()
    name, length_s, _ = next(unit for unit in UNITS if span_s >= unit[1] * unit[2])
    values = np.array([value for _, value in ordered])
    times = np.array([(at - start).total_seconds() / length_s for at, _ in ordered])
    first = values[:BASELINE]
    spread = 2 * float(first.std())
    baseline = Band(f"baseline: first {first.size}", float(first.mean()) - spread, float(first.mean()) + spread)
    return Chart(
        title,
        (Series(feature_words(FEATURE), times, values),),
        f"{name} since {start:%Y-%m-%d %H:%M} UTC",
        "crest factor below 200 Hz [1]",
        bands=(baseline,) if len(ordered) > BASELINE else (),
        markers=tuple(Marker((at - start).total_seconds() / length_s, text[:24]) for at, text in marks),
    )


def same_state(one: StoredRecording, other: StoredRecording) -> bool:
    """Say whether speed and payload are within 10 %, or equally unknown."""
    pairs = ((one.speed_rad_s, other.speed_rad_s), (one.payload_kg_m2, other.payload_kg_m2))
    return all(a == b or (a and b and abs(a - b) <= SAME_STATE * b) for a, b in pairs)
