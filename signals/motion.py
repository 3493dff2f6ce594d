"""Motion: the back and forth of the axis, given with the recording or found in its loudness.

The sound of a gear grows with speed and all but vanishes at standstill, so every reversal is a dip of the
loudness. Two reversals make a cycle.
"""

import itertools
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from signals.condition import OperatingCondition

HOP_HZ = 200.0
"""Values per second of loudness and envelope traces [Hz]."""

SMOOTH_HOPS = 16
"""Hops over which loudness is averaged before dips are looked for [1]: 80 ms, shorter than any standstill."""


CONTRADICTS = 0.05
"""Share by which a given period may differ from the one that is heard [1]."""


AT_THE_END = 0.002
"""Share of the stroke within which an axis counts as standing at its end [1]."""

SHORTEST_DIP_S = 0.04


@dataclass(frozen=True)
class MotionSearch:
    """What is believed to be a reversal.

    Args:
        smallest_depth_db: less deep is no dip [dB].
        smallest_fall_db: a machine that is less than this quieter at its reversals goes on sounding there: it
            turns steadily [dB].
        smallest_depth: smallest depth of a dip over the scatter of the loudness from one smoothing length to
            the next [1]. Between noise and its own 2nd percentile lie 2.6 standard deviations; this asks for
            5.7.
        smallest_depth_even: the same where most dips, three or more, are spaced evenly, which noise hardly ever
            does [1].
        smallest_depth_irregular: the same where the dips do not repeat: reversals without a period [1].
        largest_unevenness: share of the stroke by which evenly spaced dips may be early or late [1].
        largest_quiet_share: share of the time above which the quiet part is looked at again: it may hold slow
            strokes [1].
        fewest_to_contradict: a period that is heard over so many reversals is used where the time of one way
            was given [1].
        longest_burst_s: a shorter sound within a standstill does not divide it [s].
        largest_scatter: reversals repeat that are early or late by less than this share [1].
    """

    smallest_depth_db: float = 1.5
    smallest_fall_db: float = 2.0
    smallest_depth: float = 4.0
    smallest_depth_even: float = 2.5
    smallest_depth_irregular: float = 8.0
    largest_unevenness: float = 0.06
    largest_quiet_share: float = 0.4
    fewest_to_contradict: int = 4
    longest_burst_s: float = 0.2
    largest_scatter: float = 0.1


SEARCH = MotionSearch()


class MotionSource(StrEnum):
    """Where the knowledge of the motion comes from."""

    GIVEN = "given"
    SOUND = "sound"
    NONE = "none"


@dataclass(frozen=True)
class Motion:
    """Back and forth of the axis.

    Args:
        period_s: one full cycle of back and forth [s]; None if unknown.
        reversal_times_s: standstills from the start of the recording, ascending [s].
        source: given with the recording, or found in the sound.
        quiet_s: start and end of the quiet time around a reversal, relative to it [s].
        slow_s: start and end of the time around a reversal in which it is quieter than on the way [s].
        cycles: how many periods the recording covers; 0 without a period.
        depth_db: how far the loudness falls at a reversal [dB].
        period_in_sound_s: the period found in the sound, also where another was given [s].
    """

    period_s: float | None = None
    reversal_times_s: tuple[float, ...] = ()
    source: MotionSource = MotionSource.NONE
    quiet_s: tuple[float, float] = (-0.2, 0.2)
    slow_s: tuple[float, float] = (-0.4, 0.4)
    cycles: float = 0.0
    depth_db: float = 0.0
    period_in_sound_s: float | None = None

    @property
    def reversal_zone_s(self) -> tuple[float, float]:
        """Around a reversal, from where braking may start to where the new start may end [s].

        The quiet time and, on either side, three quarters of its length (0.2 to 0.5 s); or, if that is longer, the
        slow time and a tenth of a second: loudness falls only after braking has begun.
        """
        start, end = self.quiet_s
        margin = min(0.5, max(0.2, 0.75 * (end - start)))
        return min(start - margin, self.slow_s[0] - 0.1), max(end + margin, self.slow_s[1] + 0.1)


@dataclass(frozen=True)
class Span:
    """A stretch of the recording, from its start [s] to its end [s]."""

    start_s: float
    end_s: float

    @property
    def centre_s(self) -> float:
        """Middle [s]."""
        return (self.start_s + self.end_s) / 2

    @property
    def duration_s(self) -> float:
        """Length [s]."""
        return self.end_s - self.start_s


def runs_of(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where a mask, shape (n,), is true: first and one past the last of every run."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def quiet_runs(quiet: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the quiet stretches, as `runs_of`; a burst within one does not divide it."""
    burst = int(SEARCH.longest_burst_s * HOP_HZ)
    closed = ndimage.binary_closing(np.pad(quiet, burst, mode="edge"), np.ones(burst, dtype=np.bool_))[burst:-burst]
    return runs_of(closed)


def loudness_db(samples: NDArray[np.float32], rate_hz: float) -> NDArray[np.float32]:
    """Return the level of samples of shape (n,), `HOP_HZ` values per second [dB]."""
    block = round(rate_hz / HOP_HZ)
    blocks = samples[: samples.size // block * block].reshape(-1, block)
    power = np.einsum("ij,ij->i", blocks, blocks) / np.float32(block)
    level: NDArray[np.float32] = 10 * np.log10(np.maximum(power, np.finfo(np.float32).tiny))
    return level


def find_motion(level_db: NDArray[np.float32], condition: OperatingCondition) -> Motion:
    """Return the motion, from the condition where it says so and from the loudness for the rest.

    `level_db` is the level of the sound, `HOP_HZ` values per second, shape (n,) [dB].
    """
    duration_s = level_db.size / HOP_HZ
    if condition.steady:
        return Motion()
    dips, depth_db, clarity = find_dips(level_db)
    heard, repeats, needed = _reversals(dips)
    if clarity < needed or _fall_db(level_db, heard) < SEARCH.smallest_fall_db:
        dips, heard = [], ()
    quiet_s = _quiet(dips, heard)
    heard_period = 2 * _spacing(heard) if repeats and len(heard) > 1 else None
    given = tuple(t for t in condition.reversal_times_s if 0 <= t <= duration_s)
    period = condition.motion_period_s or (2 * _spacing(given) if len(given) > 1 else None)
    if period is None and not given:
        source = MotionSource.SOUND if heard else MotionSource.NONE
        period, times = heard_period, heard
    else:
        source = MotionSource.GIVEN
        if heard_period is not None and not given and len(heard) >= SEARCH.fewest_to_contradict:
            one_way = period is not None and abs(heard_period / period / 2 - 1) <= CONTRADICTS
            period = heard_period if one_way else period
        period = period or heard_period
        times = given or heard
    return Motion(
        period_s=period,
        reversal_times_s=times,
        source=source,
        quiet_s=quiet_s,
        slow_s=_slow(level_db, heard) if heard else Motion().slow_s,
        cycles=duration_s / period if period else 0.0,
        depth_db=depth_db if heard else 0.0,
        period_in_sound_s=heard_period,
    )


def fall_over_scatter(level_db: NDArray[np.float32]) -> float:
    """Return how far the loudness falls from where the axis moves to where it stands, over its scatter [1].

    Scatter is that from one smoothing length to the next; steady noise of any colour falls by about twice its own.
    """
    _, plateau, floor, scatter = _smoothed(level_db)
    return (plateau - floor) / scatter if scatter > 0 else np.inf


def _smoothed(level_db: NDArray[np.float32]) -> tuple[NDArray[np.float64], float, float, float]:
    """Return the smoothed loudness, its plateau (70th percentile), its floor (2nd) and its scatter [dB]."""
    smooth = ndimage.uniform_filter1d(level_db.astype(np.float64), SMOOTH_HOPS)
    plateau, floor = np.percentile(smooth, [70, 2])
    if smooth.size <= 2 * SMOOTH_HOPS:
        return smooth, float(plateau), float(floor), np.inf
    scatter = 1.4826 * float(np.median(np.abs(np.diff(smooth[::SMOOTH_HOPS]))))
    return smooth, float(plateau), float(floor), scatter


def find_dips(level_db: NDArray[np.float32]) -> tuple[list[Span], float, float]:
    """Return the quiet times whole within the recording, how deep they are [dB], and depth over scatter [1].

    A dip is where the loudness is below the middle between its floor and its plateau (70th percentile; an axis
    moves most of the time). A short burst within it, such as a click at standstill, does not divide it, and a dip
    of less than half the usual width is none.
    """
    smooth, plateau, floor, scatter = _smoothed(level_db)
    depth = plateau - floor
    clarity = depth / scatter if scatter > 0 else np.inf
    if depth < SEARCH.smallest_depth_db or clarity < SEARCH.smallest_depth_even:
        return [], depth, clarity
    quiet = smooth < (plateau + floor) / 2
    if np.mean(quiet) > SEARCH.largest_quiet_share:
        slow = float(np.percentile(smooth[quiet], 70))
        if slow - floor > depth / 4:
            quiet = smooth < (slow + floor) / 2
    runs = [Span(a / HOP_HZ, b / HOP_HZ) for a, b in quiet_runs(quiet) if a > 0 and b < quiet.size]
    shortest = max(SHORTEST_DIP_S, 0.5 * float(np.median([dip.duration_s for dip in runs]))) if runs else 0.0
    return [dip for dip in runs if dip.duration_s >= shortest], depth, clarity


def _reversals(dips: list[Span]) -> tuple[tuple[float, ...], bool, float]:
    """Return the reversal times, whether they repeat, and how clear the dips must be to be believed [1]."""
    centres = np.array([dip.centre_s for dip in dips])
    even = even_times(centres)
    if even.size:
        return tuple(even.tolist()), True, SEARCH.smallest_depth_even
    pairs = centres[2:] - centres[:-2]
    repeats = pairs.size == 0 or bool(np.ptp(pairs) <= SEARCH.largest_scatter * float(np.median(pairs)))
    return tuple(centres.tolist()), repeats, SEARCH.smallest_depth if repeats else SEARCH.smallest_depth_irregular


def even_times(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the evenly spaced times that most of the given ones lie on, shape (k,) [s]; none if there are none.

    Three that all lie on them are enough; else at least four and seven tenths of the times given must, and as many
    of the places must be taken; a dropout adds a time that lies on none, a loud standstill leaves a place free.
    """
    best = np.empty(0)
    if times.size < 3:
        return best
    most, typical = 2, float(np.median(np.diff(times)))
    for anchor in times:
        count = np.rint((times - anchor) / typical)
        near = np.abs(times - anchor - count * typical) <= SEARCH.largest_unevenness * typical * (1 + np.abs(count) / 3)
        if np.unique(count[near]).size < 3:
            continue
        stroke, first = np.polyfit(count[near], times[near], 1)
        on = near & (np.abs(times - first - count * stroke) <= SEARCH.largest_unevenness * stroke)
        taken = np.unique(count[on])
        places = taken[-1] - taken[0] + 1 if taken.size else np.inf
        enough = taken.size >= (3 if taken.size == times.size else 4)
        if enough and taken.size > most and taken.size >= 0.7 * max(times.size, places):
            most, best = taken.size, first + stroke * np.arange(taken[0], taken[-1] + 1)
    return best


def _fall_db(level_db: NDArray[np.float32], times: tuple[float, ...]) -> float:
    """Return how much quieter it is at the reversals than on the way (70th percentile) [dB]; 0 without reversals."""
    if not times:
        return 0.0
    smooth = ndimage.uniform_filter1d(level_db.astype(np.float64), SMOOTH_HOPS)
    at = np.clip(np.rint(np.array(times) * HOP_HZ).astype(np.intp), 0, smooth.size - 1)
    return float(np.percentile(smooth, 70) - np.median(smooth[at]))


def _spacing(times: tuple[float, ...]) -> float:
    if len(times) == 2:
        return times[1] - times[0]
    return float(np.median(np.subtract(times[2:], times[:-2]))) / 2


def _quiet(dips: list[Span], times: tuple[float, ...]) -> tuple[float, float]:
    """Return median start and end of the dips, relative to the reversal next to each [s]."""
    if not times:
        return Motion().quiet_s
    next_to = [min(times, key=lambda time: abs(time - dip.centre_s)) for dip in dips]
    starts = np.median([dip.start_s - time for dip, time in zip(dips, next_to, strict=True)])
    ends = np.median([dip.end_s - time for dip, time in zip(dips, next_to, strict=True)])
    return float(starts), float(ends)


def _slow(level_db: NDArray[np.float32], times: tuple[float, ...]) -> tuple[float, float]:
    """Return from when to when, around a reversal, the median level is below that of the way [s].

    Below means by a decibel or a tenth of the depth. Looked at is up to a third of a stroke, 1 s at most, on either
    side.
    """
    reach_s = min(1.0, _spacing(times) / 3) if len(times) > 1 else 1.0
    reach = round(reach_s * HOP_HZ)
    smooth = ndimage.uniform_filter1d(level_db.astype(np.float64), SMOOTH_HOPS)
    index = np.rint(np.array(times) * HOP_HZ).astype(np.intp)[:, None] + np.arange(-reach, reach + 1)
    course = np.median(smooth[np.clip(index, 0, smooth.size - 1)], axis=0)
    way = float(np.percentile(course, 80))
    full = np.flatnonzero(course >= way - max(1.0, 0.1 * (way - float(course.min())))) - reach
    before, after = full[full < 0], full[full > 0]
    start = before[-1] / HOP_HZ if before.size else -reach_s
    end = after[0] / HOP_HZ if after.size else reach_s
    return float(start), float(end)


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
