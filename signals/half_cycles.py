"""Half cycles of the motion averaged, each direction by itself, so that what repeats with the motion stands out.

A notch meets the mesh at one position and on one flank: one bump per cycle, in one direction. Play is crossed when
the torque reverses: a bump at the same time before or after the standstill in both directions.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, special

from signals.motion import HOP_HZ, Motion, stroke_centres

FALSE_ALARM = 0.05
"""Probability that noise alone puts a bump above 0 dB somewhere in the stroke."""

TOLERANCE = 2
"""Hops by which a repetition may be early or late [1]: 10 ms, as speed and the found reversals scatter."""

SMOOTH_S = 0.015
"""Width at half height of the smoothing of an envelope before it is folded [s]: the length of a mesh impact."""


@dataclass(frozen=True, eq=False)
class HalfCycles:
    """An envelope folded on the strokes of the motion, per direction.

    Args:
        offset_s: time from the reversal, ascending from minus half a stroke, shape (m,) [s].
        forward_db: height of the median stroke in one direction above what noise would reach, shape (m,) [dB];
            NaN where never recorded.
        backward_db: the same after the other reversals, shape (m,) [dB].
        zone_s: around the reversal where braking and the new start lie [s].
        quiet_s: around the reversal where the axis hardly moves [s].
        centres_s: times of all reversals, those just outside the record included, shape (k,) [s].
        first_direction: 0 if the first of them belongs to `forward_db`, 1 otherwise.
    """

    offset_s: NDArray[np.float64]
    forward_db: NDArray[np.float64]
    backward_db: NDArray[np.float64]
    zone_s: tuple[float, float]
    quiet_s: tuple[float, float]
    centres_s: NDArray[np.float64]
    first_direction: int

    @cached_property
    def in_zone(self) -> NDArray[np.bool_]:
        """Where the stroke is around its reversal, shape (m,)."""
        start, end = self.zone_s
        return (self.offset_s > start) & (self.offset_s < end)

    @cached_property
    def in_quiet(self) -> NDArray[np.bool_]:
        """Where the axis hardly moves, shape (m,)."""
        start, end = self.quiet_s
        return (self.offset_s > start) & (self.offset_s < end)

    @cached_property
    def both_db(self) -> NDArray[np.float64]:
        """Height that is reached in both directions, shape (m,) [dB].

        Where one direction alone was recorded, what stands out around the reversal is taken to be in both,
        and what stands out elsewhere to be in one.
        """
        both: NDArray[np.float64] = np.minimum(self.forward_db, _widened(self.backward_db))
        return np.where(np.isnan(both), np.where(self.in_zone, self._any_db, self._quiet_db), both)

    @cached_property
    def asymmetry_db(self) -> NDArray[np.float64]:
        """Half-cycle asymmetry: what one direction has over the other, shape (m,) [dB]; one alone: see `both_db`."""
        forward = self.forward_db - np.maximum(_widened(self.backward_db), 0.0)
        backward = self.backward_db - np.maximum(_widened(self.forward_db), 0.0)
        single: NDArray[np.float64] = np.maximum(forward, backward)
        return np.where(np.isnan(single), np.where(self.in_zone, self._quiet_db, self._any_db), single)

    @property
    def _any_db(self) -> NDArray[np.float64]:
        known: NDArray[np.float64] = np.fmax(self.forward_db, self.backward_db)
        return known

    @property
    def _quiet_db(self) -> NDArray[np.float64]:
        return np.minimum(self._any_db, 0.0)


def average_half_cycles(envelope: NDArray[np.float32], motion: Motion, freedom: float) -> HalfCycles | None:
    """Return an envelope folded on the motion's strokes, or None without a reversal.

    Args:
        envelope: positive, `HOP_HZ` values per second, shape (n,); NaN where left out.
        motion: with at least one reversal.
        freedom: degrees of freedom of the chi-squared distribution that noise has in the envelope [1].
    """
    if not motion.reversal_times_s:
        return None
    times = np.array(motion.reversal_times_s)
    duration_s = envelope.size / HOP_HZ
    stroke_s = _stroke(motion, duration_s)
    centres, before = stroke_centres(times, stroke_s, duration_s)
    direction = (np.arange(centres.size) - before) % 2
    rows = _rows(envelope, centres, stroke_s)
    positions = stroke_s / (2 * SMOOTH_S)
    level = float(np.nanmedian(envelope))
    forward, backward = (_height_db(rows[direction == side], level, freedom, positions) for side in (0, 1))
    offset_s = (np.arange(rows.shape[1]) - rows.shape[1] // 2) / HOP_HZ
    return HalfCycles(offset_s, forward, backward, motion.reversal_zone_s, motion.quiet_s, centres, int(direction[0]))


def _stroke(motion: Motion, duration_s: float) -> float:
    """Return the length of a stroke [s]: half a period; without one, the typical, or all that one reversal has."""
    times = motion.reversal_times_s
    if motion.period_s:
        return motion.period_s / 2
    return float(np.median(np.diff(times))) if len(times) > 1 else 2 * max(times[0], duration_s - times[0])


def noise_peak_db(strokes: int, freedom: float, positions: float, alarm: float = FALSE_ALARM) -> float:
    """Return the height that the lower median of so many strokes of noise reaches somewhere [dB over the median].

    The lower median of n strokes is high where floor(n / 2) + 1 of them are; with probability p each, that
    happens with about (n choose k) p^k at every independent position. p follows from the false alarm, the height
    from the chi-squared distribution of noise power (Papoulis, Probability, Random Variables and Stochastic
    Processes).

    >>> noise_peak_db(1, 8, 100) > noise_peak_db(3, 8, 100) > noise_peak_db(5, 8, 100) > 0
    True
    """
    needed = strokes // 2 + 1
    chance = (alarm / (2 * positions) / math.comb(strokes, needed)) ** (1 / needed)
    return float(10 * np.log10(special.chdtri(freedom, chance) / special.chdtri(freedom, 0.5)))


def _rows(envelope: NDArray[np.float32], centres: NDArray[np.float64], stroke_s: float) -> NDArray[np.float64]:
    """Cut the envelope into strokes around the centres, NaN outside the record, shape (strokes, m)."""
    size = max(2, round(stroke_s * HOP_HZ))
    known = np.isfinite(envelope)
    widest = ndimage.maximum_filter1d(np.where(known, envelope, np.float32(0)), 2 * TOLERANCE + 1)
    widest = np.where(known, widest, np.float32(np.nan))
    first = np.rint(centres * HOP_HZ).astype(np.intp)
    index = first[:, None] + np.arange(size) - size // 2
    inside = (index >= 0) & (index < envelope.size)
    return np.where(inside, widest[np.clip(index, 0, envelope.size - 1)], np.nan)


def _height_db(rows: NDArray[np.float64], level: float, freedom: float, positions: float) -> NDArray[np.float64]:
    """Return the lower median of the rows at each place above what noise would reach in it [dB]; NaN of nothing."""
    if rows.shape[0] == 0:
        return np.full(rows.shape[1], np.nan)
    known = np.isfinite(rows).sum(axis=0)
    place = np.maximum(known - 1, 0) // 2
    median = np.take_along_axis(np.sort(rows, axis=0), place[None], axis=0)[0]
    expected = np.array([0.0] + [noise_peak_db(n, freedom, positions) for n in range(1, rows.shape[0] + 1)])
    height: NDArray[np.float64] = 10 * np.log10(median / level) - expected[known]
    return height


def _widened(height_db: NDArray[np.float64]) -> NDArray[np.float64]:
    """Let every height hold within the tolerance, too; NaN stays NaN."""
    widened = ndimage.maximum_filter1d(np.nan_to_num(height_db, nan=-np.inf), 2 * TOLERANCE + 1)
    return np.where(np.isnan(height_db), np.nan, widened)
