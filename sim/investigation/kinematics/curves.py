"""What page and report show of two encoders: the transmission error over the angle, the course of a pull test."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.investigation.kinematics.motion_findings import columns_of
from sim.investigation.kinematics.transmission_error import TransmissionError
from sim.investigation.report.panels import Panel
from sim.investigation.results import Finding

Array = NDArray[np.float64]

SHOWN = 120  # points over the angle
SHOWN_ROWS = 2000


def over_the_angle(seen: TransmissionError, findings: Sequence[Finding]) -> Panel:
    """Means over the angle, forth and back, with the model of what was found."""
    around = seen.angle % (2.0 * math.pi) if seen.whole else seen.angle
    low, high = float(around.min()), float(around.max())
    cell = np.minimum(((around - low) / (high - low) * SHOWN).astype(np.int64), SHOWN - 1)
    model = seen.error - seen.left_by(seen.fitted(columns_of(seen, findings)))
    lines = []
    for way, name in ((1.0, "forth"), (-1.0, "back")):
        rows = seen.direction == way
        if rows.any():
            lines.append((f"measured, {name}", _means(cell[rows], seen.error[rows])))
            lines.append((f"with what was found, {name}", _means(cell[rows], model[rows])))
    x = low + (np.arange(SHOWN) + 0.5) / SHOWN * (high - low)
    title = "Motor over ratio, less load"
    return Panel(title, "angle of the load [rad]", "difference [rad]", "load angle", x, tuple(lines))


def _means(cell: NDArray[np.int64], values: Array) -> Array:
    count = np.bincount(cell, minlength=SHOWN)
    return np.where(count > 0, np.bincount(cell, values, SHOWN) / np.maximum(count, 1), np.nan)


def course(time_s: Array, driven: Array, load: Array) -> Panel:
    """Angles over time, shape (n,)."""
    every = max(1, time_s.size // SHOWN_ROWS)
    lines = (("motor, at the load", driven[::every]), ("load", load[::every]))
    return Panel("Load pulled while the motor holds", "time [s]", "angle [rad]", "time", time_s[::every], lines)
