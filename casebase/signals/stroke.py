"""Strokes of an axis, from its telemetry."""

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from casebase.signals.condition import OperatingCondition
from casebase.signals.telemetry import Telemetry

POSITIONS = ("load_position_rad", "motor_position_rad", "reference_position_rad")
AT_THE_END = 0.002
"""Share of the stroke within which an axis counts as standing at its end [1]."""


def with_telemetry(condition: OperatingCondition, telemetry: Telemetry) -> OperatingCondition:
    """Return the condition with the reversals and, from the load's position, the speed that telemetry shows.

    What the condition already says stays. The sound must start with the telemetry.
    """
    position = next((telemetry[name] for name in POSITIONS if name in telemetry), None)
    if position is None:
        return condition
    times = reversal_times_s(telemetry.time_s - telemetry.time_s[0], position)
    speed = condition.speed_rad_s
    if speed is None and "load_position_rad" in telemetry:
        speed = plateau_speed(telemetry.time_s, telemetry["load_position_rad"]) or None
    return replace(condition, reversal_times_s=condition.reversal_times_s or times, speed_rad_s=speed)


def reversal_times_s(time_s: NDArray[np.float64], position: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the middle of every stay at an end of the stroke, ascending [s]; () for a motion without return.

    Between two passages through the middle of the range lies one end; passages count with a hysteresis of a tenth
    of the range, so that noise makes none.
    """
    lowest, highest = float(position.min()), float(position.max())
    span = highest - lowest
    if span <= 0:
        return ()
    share = (position - lowest) / span
    side = np.where(share > 0.55, 1, np.where(share < 0.45, -1, 0))
    known = np.flatnonzero(side)
    turns = known[1:][np.diff(side[known]) != 0]
    if turns.size < 2:
        return ()
    times = []
    for first, last in itertools.pairwise(turns):
        piece = share[first:last]
        end = piece.max() if side[first] > 0 else piece.min()
        stays = first + np.flatnonzero(np.abs(piece - end) <= AT_THE_END)
        times.append(float(time_s[stays[0]] + time_s[stays[-1]]) / 2)
    return tuple(times)


def plateau_speed(time_s: NDArray[np.float64], position: NDArray[np.float64]) -> float:
    """Return the speed that is reached but not passed in nine tenths of the time [rad/s], over steps of 50 ms."""
    step = max(1, round(0.05 / float(np.median(np.diff(time_s)))))
    if position.size <= step:
        return 0.0
    speed = np.abs(position[step:] - position[:-step]) / (time_s[step:] - time_s[:-step])
    return float(np.percentile(speed, 90))
