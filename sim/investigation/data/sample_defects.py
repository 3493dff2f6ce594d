"""Rows that no axis can have made: some that stand alone, jumps from one row to the next, values that stay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import find_objects, label, maximum_filter1d, median_filter, uniform_filter1d

from sim.chain.model import Array

Rows = NDArray[np.bool_]
TREND_ROWS = 21  # whose mean is taken away, so that a spike shows on a slope
MEDIAN_ROWS = 7  # a spike of up to three rows is not in their median
BESIDE = (3, 10)  # rows from a spike to those it is held against: nearer ones may belong to it
STANDS_OUT = 4.5  # times the largest change beside it: a blow rings on, noise has others as large
ABOVE_NOISE = 12.0  # standard deviations
ROUNDING = 1e-12  # of the largest value
QUANTA = 5.0  # steps of an encoder that noise may make within one row
COMMON = 0.98  # share of rows whose changes of speed are noise and steps of the encoder
ABOVE_COMMON = 3.0
NEIGHBOURS = 6  # increments on either side that say how fast a channel changes
BEFORE_ROWS = 8  # that say how a channel moved before a spell
MOVED_ON = 0.5  # of the pace over it
STAYS = 5  # rows of one and the same value that are looked at
CHANCE = 1e-6  # that quantised noise stays so long anywhere in the record


def quantum(values: Array) -> float:
    """Smallest step between rows, beyond what rounding makes of an even clock; 0 where there is none."""
    steps = np.abs(np.diff(values))
    steps = steps[steps > ROUNDING * float(np.abs(values).max(initial=0.0))]
    return float(steps.min()) if steps.size else 0.0


def bridged(values: Array, good: Rows) -> Array:
    """A smooth way over rows that are not good: a step would make the chain ring long after."""
    kept = np.flatnonzero(good)
    if kept.size == values.size or kept.size < 2:
        return values
    out = values.copy()
    lost = np.flatnonzero(~good)
    out[lost[lost < kept[0]]], out[lost[lost > kept[-1]]] = values[kept[0]], values[kept[-1]]
    lost = lost[(lost > kept[0]) & (lost < kept[-1])]
    out[lost] = PchipInterpolator(kept, values[kept])(lost)
    return out


def spikes(values: Array) -> Rows:
    """Up to three rows that stand alone: far from the median around them, when none nearby is, shape (n,).

    >>> wave = np.sin(np.arange(400) / 30) + 0.01 * np.cos(np.arange(400.0) ** 2)
    >>> wave[123] += 0.5
    >>> np.flatnonzero(spikes(wave))
    array([123])
    """
    level = values - uniform_filter1d(values, TREND_ROWS)
    off = np.abs(level - median_filter(level, MEDIAN_ROWS))
    changes = np.abs(np.diff(level, prepend=level[0]))
    noise = ABOVE_NOISE * max(1.4826 * float(np.median(off)), float(off.mean()))
    floor = max(noise, ABOVE_COMMON * float(np.quantile(changes, COMMON)))
    least = np.maximum(STANDS_OUT * _largest_beside(changes, *BESIDE), floor)
    found: Rows = off > least
    found[:TREND_ROWS] = found[-TREND_ROWS:] = False
    return found


def jumps(values: Array, trusted: Rows) -> tuple[tuple[int, float], ...]:
    """Rows behind which a channel has changed more than its neighbours' changes allow, and by how much.

    What moves an axis changes its speed from one row to the next, never its place: an increment beyond the range of
    those around it, by more than that range again, is none of the axis's. `trusted`: rows that were measured.
    """
    steps = np.diff(values)
    high, low = _largest_beside(steps, 1, NEIGHBOURS), -_largest_beside(-steps, 1, NEIGHBOURS)
    beyond = np.maximum(steps - high, low - steps)
    noise = float(np.quantile(np.abs(np.diff(steps)), COMMON))
    whole = maximum_filter1d((~trusted).astype(np.int8), 2 * NEIGHBOURS + 3)[:-1] == 0
    whole[: 2 * NEIGHBOURS] = whole[-2 * NEIGHBOURS :] = False
    least = np.maximum(high - low, ABOVE_COMMON * noise)
    return tuple((int(row), float(steps[row])) for row in np.flatnonzero(whole & (beyond > least)))


def _largest_beside(values: Array, near: int, far: int) -> Array:
    """Largest value among those `near` to `far` rows away on either side, shape (n,)."""
    size = far - near + 1
    around = maximum_filter1d(values, size)
    out = np.full(values.size, -np.inf)
    out[: values.size - far] = around[near + size // 2 :][: values.size - far]
    np.maximum(out[far:], around[size // 2 :][: values.size - far], out=out[far:])
    return out


def moves_on(steps: Array, pace: float) -> bool:
    """Whether the last `steps` before a spell lead the same way as the `pace` over it, and half as fast at least.

    >>> moves_on(np.array([0.9, 0.0, 1.1, 1.0]), 1.0), moves_on(np.array([0.0, 0.0, -0.1, 0.1]), 1.0)
    (True, False)
    """
    return bool(steps.size and steps[-BEFORE_ROWS:].mean() * np.sign(pace) > MOVED_ON * abs(pace))


def stays(values: Array) -> list[slice]:
    """Runs of at least `STAYS` rows of one and the same value, longer than quantised noise has them by chance."""
    same = np.diff(values) == 0.0
    runs = [rows for (rows,) in find_objects(label(same)[0])]
    long = [rows for rows in runs if rows.stop - rows.start >= STAYS - 1]
    kept = same.size - sum(r.stop - r.start for r in long)
    usual = (int(same.sum()) - sum(r.stop - r.start for r in long) + 1) / max(kept, 1)
    least = np.log(CHANCE / values.size) / np.log(min(usual, 0.999))
    return [slice(r.start, r.stop + 1) for r in long if r.stop - r.start >= least]
