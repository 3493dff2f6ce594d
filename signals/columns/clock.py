"""Stamps of time as a recorder writes them: from any origin, rounded, of rows that came at even times."""

import numpy as np
from numpy.typing import NDArray

MOST_DIGITS = 9
"""Decimal places of a stamp in seconds: nanoseconds."""
BESIDE = 0.05
"""Of an interval, by which a stamp is beside its row: a twentieth of what the axis does from row to row."""
ROUNDED = 1.1
"""Times the rounding that stamps of an even clock scatter over: a fitted line is not quite the clock."""
FITS = 3
"""Fits of the interval, each of which places the rows behind a longer gap anew."""


def stamps_from_zero(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return strictly ascending times [s], shape (n,), from the first on, those of an even clock without rounding.

    >>> stamps_from_zero(1764165785.0 + np.round(np.arange(6) / 3.0, 2)) * 3.0
    array([0., 1., 2., 3., 4., 5.])
    """
    times: NDArray[np.float64] = time_s - time_s[0]
    stored = 4.0 * float(np.spacing(np.abs(time_s).max(initial=0.0)))
    digit = next((q for q in 10.0 ** -np.arange(MOST_DIGITS + 1) if _is_multiple(times, q, stored)), 0.0)
    if digit:
        times = digit * np.rint(times / digit)
    rounding = digit + stored
    row, interval = rows_of(times)
    beside = times - interval * row
    if np.any(np.diff(row) < 1) or float(np.ptp(beside)) > max(ROUNDED * rounding, BESIDE * interval):
        return times
    return np.asarray(row * _plain(interval, rounding / max(int(row[-1]), 1)))


def rows_of(times: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
    """Return the rows of an even clock that are nearest to times, from 0, and its interval by least squares [s]."""
    steps = np.diff(times)
    interval = float(np.mean(steps[steps < 1.5 * np.median(steps)]))
    row = np.concatenate([[0], np.cumsum(np.rint(steps / interval))]).astype(np.int64)
    for _ in range(FITS):
        middle = row - row.mean()
        interval = float(middle @ times / (middle @ middle))
        row = np.rint(row.mean() + (times - times.mean()) / interval).astype(np.int64)
    return row - row[0], interval


def _is_multiple(times: NDArray[np.float64], step: float, about: float) -> bool:
    return bool(np.all(np.abs(times - step * np.rint(times / step)) <= about))


def _plain(interval: float, about: float) -> float:
    """The shortest decimal that an interval may be."""
    return next(plain for digits in range(1, 18) if abs((plain := float(f"{interval:.{digits}g}")) - interval) <= about)
