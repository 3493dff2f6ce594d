"""The motion of an axis as telemetry beside a recording has it."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.motion import SEARCH, reversal_times_s
from signals.motion_profile import Kind, MotionProfile

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuredMotion:
    """A motion as telemetry has it.

    Args:
        reversal_times_s: standstills, by the telemetry's clock, ascending [s].
    """

    profile: MotionProfile
    reversal_times_s: tuple[float, ...]

    def condition(self, delay_s: float, duration_s: float) -> Mapping[str, Any]:
        """Return what an operating condition has of it.

        Args:
            delay_s: time in the recording at which the telemetry's clock is at 0 [s].
            duration_s: of the recording [s].
        """
        times = (time + delay_s for time in self.reversal_times_s)
        within = tuple(time for time in times if 0 <= time <= duration_s)
        return {**self.profile.condition(), "reversal_times_s": within}


def measured_motion(time_s: Floats, angle_rad: Floats) -> MeasuredMotion:
    """Return the motion that the angle of the output follows, both of shape (n,) [s], [rad].

    All ways from one end to the other are laid upon each other at their middle; of the three kinds, that one is taken
    whose speed is nearest to theirs, by least squares over moving and acceleration time.

    Raises:
        TelemetryError: if the angle does not go back and forth, or not between the same two positions.
    """
    times = _reversals(time_s, angle_rad)
    if times.size < 2:
        raise TelemetryError("the angle does not go back and forth: one whole way from end to end is needed")
    ends = np.interp(times, time_s, angle_rad)
    strokes, half_s = np.abs(np.diff(ends)), float(np.median(np.diff(times)))
    stroke = float(np.median(strokes))
    if np.ptp(strokes) > SEARCH.largest_scatter * stroke:
        raise TelemetryError(
            f"the angle does not go back and forth between the same two positions: ways of {strokes.min():.4g} to "
            f"{strokes.max():.4g} rad; send the part in which it does"
        )
    grid = np.linspace(0, half_s, 401)
    pairs = zip(itertools.pairwise(times), itertools.pairwise(ends), strict=True)
    course = np.mean([_way(time_s, angle_rad, *each, grid) for each in pairs], axis=0)
    profile = _fitted(grid, stroke * np.gradient(course, grid), stroke)
    return MeasuredMotion(profile, tuple(times.tolist()))


def _reversals(time_s: Floats, angle: Floats) -> Floats:
    """Return the reversals, shape (n,) [s], the first and the last too, if the angle comes from elsewhere and goes on.

    For that, it is as if the angle came from the other end, and went there.
    """
    low, high = float(angle.min()), float(angle.max())
    before, after = (low if 2 * at > low + high else high for at in (angle[0], angle[-1]))
    longer = [time_s[0] - 1], time_s, [time_s[-1] + 1]
    times = np.array(reversal_times_s(np.concatenate(longer), np.concatenate([[before], angle, [after]])))
    ends = np.interp(times, time_s, angle)
    cut = 0.02 * (high - low)
    first = int(times.size > 0 and abs(ends[0] - angle[0]) <= cut)
    last = times.size - int(times.size > first and abs(ends[-1] - angle[-1]) <= cut)
    return times[first:last]


def _way(time_s: Floats, angle: Floats, times: tuple[float, float], ends: tuple[float, float], grid: Floats) -> Floats:
    """Return the share of one way that is done, its middle in the middle of the grid, shape (n,) [1]."""
    within = slice(*np.searchsorted(time_s, times).tolist())
    stroke = ends[1] - ends[0]
    middle = np.interp(0.5, np.maximum.accumulate((angle[within] - ends[0]) / stroke), time_s[within])
    way: Floats = (np.interp(grid - grid[-1] / 2 + middle, time_s, angle) - ends[0]) / stroke
    return way


def _fitted(grid: Floats, speed: Floats, stroke: float) -> MotionProfile:
    """Return the profile whose speed is nearest to the one on the grid, shape (n,) [rad/s]."""
    from scipy.optimize import least_squares  # slow to import

    half_s, top = float(grid[-1]), float(speed.max())
    moving_s = float(np.clip(np.mean(speed > top / 20) * half_s, max(1.01 * stroke / top, half_s / 19), half_s))

    def profile(kind: Kind, x: Floats) -> MotionProfile:
        moving_s, ramp = float(x[0]), None if kind == "sine" else float(x[0] * x[1])
        top = math.pi / 2 * stroke / moving_s if ramp is None else stroke / (moving_s - ramp)
        return MotionProfile(kind, stroke, top, ramp, max(half_s - moving_s, 0.0))

    def error(kind: Kind, x: Floats) -> Floats:
        return profile(kind, x).speeds(grid - (half_s - x[0]) / 2) - speed

    start = (moving_s, float(np.clip(1 - stroke / top / moving_s, 0.01, 0.49)))
    found = []
    for kind in get_args(Kind):
        fit = least_squares(partial(error, kind), start, bounds=((half_s / 20, 0.005), (half_s * (1 + 1e-6), 0.5)))
        found.append((fit.cost, kind, fit.x))
    _, kind, best = min(found, key=lambda each: each[0])
    return profile(kind, best)
