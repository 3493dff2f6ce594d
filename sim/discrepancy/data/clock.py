"""Logs whose rows come as they come: on an even clock of the interval in which a row surely comes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from casebase.signals.telemetry import Telemetry
from sim.discrepancy.data.sample_defects import Rows
from sim.torsional.model import Array

NEAR = 0.3  # of the median interval: a step that differs by less belongs to an even clock
EVEN = 0.75  # of the steps that do so, where rows that are missing leave fewer than a fifth as long ones
SURELY = 0.95  # of the steps end within the interval that is taken instead


def means_of(cell: NDArray[np.int64]) -> Callable[[Array], Array]:
    """What takes the mean of values over each cell that has any, in their order; `cell`: of each row, shape (n,)."""
    _, place = np.unique(cell, return_inverse=True)
    count = np.bincount(place)
    return lambda values: np.asarray(np.bincount(place, values) / count)


def irregular(t: Telemetry, grid: Array) -> Rows:
    """Rows of an even `grid`, shape (n,) [s], within two of a step of the clock that is unlike the others."""
    steps = np.diff(t.time_s)
    odd = np.flatnonzero(np.abs(steps / np.median(steps) - 1.0) > NEAR)
    out = np.zeros(grid.size, dtype=np.bool_)
    for place in odd:
        first, last = np.searchsorted(grid, (t.time_s[place], t.time_s[place + 1]))
        out[max(int(first) - 2, 0) : int(last) + 3] = True
    return out


def evened(t: Telemetry) -> tuple[Telemetry, tuple[str, ...]]:
    """The telemetry as it is where its clock is even; else rows averaged over an interval, and a remark on it.

    Rows that come in bursts say no more than one where the next is late: what is faster than the longest usual step is
    not seen all the time.
    """
    steps = np.diff(t.time_s)
    if float((np.abs(steps / np.median(steps) - 1.0) < NEAR).mean()) >= EVEN:
        return t, ()
    interval = float(np.quantile(steps, SURELY))
    cell = ((t.time_s - t.time_s[0]) / interval).astype(np.int64)
    mean = means_of(cell)
    told = mean(t.time_s)  # a cell's mean belongs to the mean of its times
    clock = t.time_s[0] + interval * np.arange(int(t.duration_s / interval) + 1)
    before = np.clip(np.searchsorted(told, clock) - 1, 0, told.size - 2)
    seen = (told[0] <= clock) & (clock <= told[-1]) & (told[before + 1] - told[before] < 2.0 * interval)
    clock = clock[seen]
    anew = replace(
        t,
        time_s=clock,
        channels={name: np.interp(clock, told, mean(values)) for name, values in t.channels.items()},
        lost={name: np.interp(clock, told, mean(gone.astype(float))) > 0.5 for name, gone in t.lost.items()},
    )
    remark = (
        f"time_s: the steps are {1e3 * steps.min():.2g} to {1e3 * steps.max():.2g} ms long; rows were averaged over "
        f"{1e3 * interval:.2g} ms, and what is faster than {0.5 / interval:.2g} Hz is not seen."
    )
    return anew, (remark,)
