"""What is seen of a log and its sound before anything is investigated: courses to lay over each other, and a remark."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.reading.limited_pool import LimitedPool, refusals_as
from signals.telemetry import LONGEST_MAP
from sim.description.axis import Axis

PREVIEWS = LimitedPool(1, "app.web.log_preview_worker")
LIMITS: Mapping[str, float] = {"seconds": 60.0, "cpu_seconds": 30.0, "memory_bytes": 2 << 30, "cells": 25 << 20}
POINTS = 2000
"""Of a course: as many as a screen has columns."""
LONGEST_COURSES = 64 * POINTS * 4
STEP_S = 0.02
"""Over which the level of a sound is taken: shorter than a stroke, longer than a period of what is heard."""


@refusals_as(TelemetryError, "reading the table was given up ({}); export it again, with the known channels alone")
def log_preview(path: Path, channels: str | None, axis: Axis | None) -> Mapping[str, Any]:
    """Return the courses of a log and what it can show, read in a limited process.

    `x` [s] from the first row on; `series`: torque and speed of the motor as far as they are there, each with its
    `name`, `unit`, `largest` and `y`, its share of that; `remarks`.

    Raises:
        TelemetryError: if it cannot be read, with the lines of a channel map that would.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    asked = {
        "path": str(path.absolute()),
        "channels": channels,
        "axis": None if axis is None else axis.to_mapping(),
        "points": POINTS,
    }
    content, _ = PREVIEWS.perform("app.web.log_preview_worker:task", asked, LIMITS, LONGEST_COURSES + LONGEST_MAP)
    found: Mapping[str, Any] = json.loads(content)
    return found


def sound_preview(path: Path) -> Mapping[str, Any]:
    """Return the level of a sound over time: `step_s` between values, and `y`, the share of the largest.

    Raises:
        SignalError: if it cannot be read.
    """
    from app.recordings.intake import read_sound  # the limited process, which imports this module, needs no library

    sound = read_sound(path)
    step_s = max(STEP_S, sound.duration_s / POINTS)
    level = levels(sound.samples, max(1, round(step_s * sound.sample_rate_hz)))
    return {"step_s": step_s, "seconds": sound.duration_s, "y": shares(level)}


def levels(samples: NDArray[np.float32], width: int) -> NDArray[np.float64]:
    """Effective value of each run of so many samples, shape (n,) to (ceil(n / width),)."""
    starts = np.arange(0, samples.size, width)
    energy = np.add.reduceat(samples.astype(np.float64) ** 2, starts)
    return np.asarray(np.sqrt(energy / np.diff(np.append(starts, samples.size))))


def shares(values: NDArray[np.float64]) -> list[float]:
    """Values as shares of the largest, for JSON.

    >>> shares(np.array([0.0, -2.0, 1.0]))
    [0.0, -1.0, 0.5]
    """
    largest = float(np.abs(values).max()) or 1.0
    return [round(float(value), 4) for value in values / largest]
