"""Strokes of an axis, from its position."""

import itertools

import numpy as np
from numpy.typing import NDArray

AT_THE_END = 0.002
"""Share of the stroke within which an axis counts as standing at its end [1]."""


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
