"""Unrepeated: what a cycle of the motion has that the other cycles have not, so that it is not the machine.

What a tooth does comes in every cycle. Stroke by stroke the level of a band is held against the median of the other
strokes in the same direction, at the same time from the reversal: what stands out in one stroke alone is an event of
the surroundings, with a time. Of two others the one that is more like it counts, so that most of three decide. Two
strokes in a direction are the least of which anything can be said, and of two the louder one is the odd one.

Play strikes where the load reverses, and not in every cycle: the gap is crossed from wherever the gear came to rest in
it, so its blows scatter down to nothing. What strikes beside the axis does not know when the axis reverses. So a knock
stays where so many other strokes are struck at the same time from the reversal as chance would hardly bring.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from signals.band import Band
from signals.motion import HOP_HZ, Motion, Span, runs_of

Floats = NDArray[np.float64]
SLOW_HOPS, SLOW_S = 5, 0.1
"""Levels are averaged over four times so many hops [1], so long [s], when they are held against other cycles."""


@dataclass(frozen=True)
class TransientLimits:
    """When one stroke has something that the others have not.

    Args:
        early_or_late_s: by so much a repetition may be early or late [s], as cycles scatter.
        false_alarm_of_events: probability with which noise alone is taken for an event, per recording and band
            [1].
        knock_db: a knock of the machine comes with half to twice its amplitude in the next cycle [dB].
        change_db: the machine is not twice as loud in one cycle as in the others [dB].
        edge_s: at the ends of the record a line rings where it was mirrored; a knock there is not told from
            that [s].
        around_s: left out on either side of an event: its beginning and its ringing [s].
        shortest_change_s: a level that differs for less is no event [s].
        longest_knock_s: a blow and its ringing last no longer [s]; what does is a sound.
        kept_by_chance: probability with which knocks that know nothing of the axis are taken for its own [1].
    """

    early_or_late_s: float = 0.02
    false_alarm_of_events: float = 0.001
    knock_db: float = 6.0
    change_db: float = 3.0
    edge_s: float = 0.05
    around_s: float = 0.04
    shortest_change_s: float = 0.1
    longest_knock_s: float = 0.4
    kept_by_chance: float = 0.05


LIMITS = TransientLimits()


@dataclass(frozen=True)
class Event:
    """Something that one cycle has alone.

    Args:
        span: when, from the start of the analysed piece.
        excess_db: how much louder than the other cycles at most, per band; negative where it is quieter.
        knock: whether it is as short as a blow.
    """

    span: Span
    excess_db: dict[Band, float]
    knock: bool


@dataclass(frozen=True, eq=False)
class Unrepeated:
    """What does not repeat.

    Args:
        events: in order of time.
        share: of the time that another cycle can be held against, in which the level of a band is more than twice or
            less than half of the other cycles', per band [1].
    """

    events: tuple[Event, ...]
    share: dict[Band, float]


def find_unrepeated(
    traces: Mapping[Band, NDArray[np.float32]],
    peaks_db: Mapping[Band, float],
    changes_db: Mapping[Band, float],
    motion: Motion,
) -> Unrepeated | None:
    """Hold every cycle against the others; None without a motion of two cycles.

    Args:
        traces: smoothed squared envelopes of bands, `HOP_HZ` values per second, shape (n,) each; NaN where left out.
        peaks_db: height over the median that noise hardly ever reaches in each [dB].
        changes_db: by how much an averaged level must differ to be an event [dB].
        motion: with the reversals that strokes are counted from.
    """
    if not traces or motion.period_s is None or len(motion.reversal_times_s) < 2:
        return None
    size = min(trace.size for trace in traces.values())
    fast, slow = _Strokes.of(motion, size, HOP_HZ), _Strokes.of(motion, size // SLOW_HOPS, HOP_HZ / SLOW_HOPS)
    if fast is None or slow is None:
        return None
    heights, excesses, share = {}, {}, {}
    edge = round(LIMITS.edge_s * HOP_HZ)
    knocks, changes = np.zeros(fast.size, np.bool_), np.zeros(slow.size, np.bool_)
    for band, trace in traces.items():
        heights[band] = fast.above(_level_db(trace[:size]), peaks_db[band], LIMITS.knock_db)
        knocks[edge:-edge] |= heights[band][edge:-edge] > LIMITS.knock_db
        excess = slow.differs(_level_db(_averaged(trace[:size])))
        excesses[band] = np.nan_to_num(excess)
        judged = np.isfinite(excess)
        share[band] = float(np.mean(np.abs(excess[judged]) > LIMITS.change_db)) if judged.any() else 0.0
        changes |= np.abs(excesses[band]) > changes_db[band]
    changes = ndimage.binary_opening(changes, np.ones(round(LIMITS.shortest_change_s * HOP_HZ / SLOW_HOPS), np.bool_))
    changed = np.repeat(changes, SLOW_HOPS)
    knocks[: changed.size] |= changed
    events = [_event(span, heights, excesses) for span in _spans(knocks)]
    level_db = {band: np.nan_to_num(_level_db(trace[:size]), nan=-np.inf) for band, trace in traces.items()}
    return Unrepeated(tuple(each for each in events if not _is_own(each, level_db, peaks_db, fast)), share)


def _level_db(trace: NDArray[np.float32]) -> Floats:
    known = np.isfinite(trace)
    median = float(np.median(trace[known])) if known.any() else 1.0
    return np.asarray(10 * np.log10(np.maximum(trace.astype(np.float64), np.finfo(np.float32).tiny) / median))


def _averaged(trace: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return means over four times SLOW_HOPS, one per SLOW_HOPS."""
    blocks = trace[: trace.size // SLOW_HOPS * SLOW_HOPS].reshape(-1, SLOW_HOPS).mean(axis=1)
    smooth: NDArray[np.float32] = ndimage.uniform_filter1d(blocks, 4)
    return smooth


@dataclass(frozen=True, eq=False)
class _Strokes:
    """Where every stroke lies in the record: place per stroke and time from its start, shape (strokes, m)."""

    centres: NDArray[np.intp]
    index: NDArray[np.intp]
    inside: NDArray[np.bool_]
    size: int
    tolerance: int

    @classmethod
    def of(cls, motion: Motion, size: int, rate_hz: float) -> "_Strokes | None":
        times = np.array(motion.reversal_times_s)
        assert motion.period_s is not None
        stroke_s = motion.period_s / 2
        before = np.arange(np.floor(-times[0] / stroke_s - 0.5), 0) * stroke_s + times[0]
        after = np.arange(1, np.ceil((size / rate_hz - times[-1]) / stroke_s + 0.5) + 1) * stroke_s + times[-1]
        centres = np.concatenate([before, times, after])
        width = round(stroke_s * rate_hz)
        if width < 4 or len(centres) < 3:
            return None
        hops = np.rint(centres * rate_hz).astype(np.intp)
        index = hops[:, None] + np.arange(width) - width // 2
        inside = (index >= 0) & (index < size)
        return cls(hops, np.clip(index, 0, size - 1), inside, size, round(LIMITS.early_or_late_s * rate_hz))

    def above(self, level_db: Floats, least_db: float, least_excess_db: float) -> Floats:
        """Return by how much what is above a level stands out of the other strokes, shape (n,); 0 elsewhere."""
        found = np.zeros(self.size)
        level_db = np.nan_to_num(level_db, nan=-np.inf)
        high = level_db > least_db
        if not high.any():
            return found
        columns = np.flatnonzero((self.inside & high[self.index]).any(axis=0))
        index, inside = self.index[:, columns], self.inside[:, columns]
        wide = ndimage.maximum_filter1d(level_db, 2 * self.tolerance + 1)
        highest = np.where(inside & np.isfinite(wide)[index], wide[index], np.nan)
        for parity in (0, 1):
            excess = level_db[index[parity::2]] - _median_of_others(highest[parity::2], upper=True)
            counts = inside[parity::2] & high[index[parity::2]] & (excess > least_excess_db)
            found[index[parity::2][counts]] = excess[counts]
        return found

    def differs(self, level_db: Floats) -> Floats:
        """Return by how much the level is above or below the other strokes', shape (n,); NaN where there is none."""
        filled = np.nan_to_num(level_db)
        wide = ndimage.maximum_filter1d(filled, 2 * self.tolerance + 1)
        thin = ndimage.minimum_filter1d(filled, 2 * self.tolerance + 1)
        known = self.inside & np.isfinite(level_db)[self.index]
        found = np.full(self.size, np.nan)
        for parity in (0, 1):
            index, here = self.index[parity::2], known[parity::2]
            above = _median_of_others(np.where(here, wide[index], np.nan), upper=True)
            below = _median_of_others(np.where(here, thin[index], np.nan), upper=False)
            below = np.where(here.sum(axis=0) > 2, below, -np.inf)
            own = level_db[index]
            excess = np.where(own > above, own - above, np.minimum(own - below, 0.0))
            found[index[here]] = np.where(np.isfinite(above), excess, np.nan)[here]
        return found


def _is_own(event: Event, levels_db: Mapping[Band, Floats], peaks_db: Mapping[Band, float], strokes: _Strokes) -> bool:
    """Whether a knock is the machine's: other strokes are struck at its time from the reversal, and about as hard.

    With chance each of them is struck then as often as at any other time.
    """
    from scipy.special import bdtrc  # slow to import

    around = round(LIMITS.around_s * HOP_HZ)
    first, last = round(event.span.start_s * HOP_HZ) + around, round(event.span.end_s * HOP_HZ) - around
    if not event.knock or last <= first:
        return False
    band = max(event.excess_db, key=lambda each: event.excess_db[each])
    level_db = levels_db[band]
    own = int(np.argmin(np.abs(strokes.centres - (first + last) / 2)))
    shifts = np.delete(strokes.centres, own) - strokes.centres[own]
    windows = [slice(first + by - strokes.tolerance, last + by + strokes.tolerance) for by in shifts.tolist()]
    highest = [float(level_db[each].max()) for each in windows if each.start >= 0 and each.stop <= level_db.size]
    struck = sum(each > peaks_db[band] for each in highest)
    if not struck or float(level_db[first:last].max()) - max(highest) > LIMITS.knock_db:
        return False
    width = last - first + 2 * strokes.tolerance
    anywhere = ndimage.maximum_filter1d((level_db > peaks_db[band]).astype(np.int8), width)
    elsewhere = np.concatenate([anywhere[: max(0, first - width)], anywhere[last + width :]])
    return elsewhere.size > 0 and bool(bdtrc(struck - 1, len(highest), float(elsewhere.mean())) < LIMITS.kept_by_chance)


def _median_of_others(rows: Floats, *, upper: bool) -> Floats:
    """Return for every row the median of the others in each column, of an even number the upper or lower one.

    Shape as the rows; NaN where the row itself is NaN, or all others are.
    """
    order = np.argsort(rows, axis=0)
    rank = np.empty_like(order)
    np.put_along_axis(rank, order, np.arange(len(rows))[:, None], axis=0)
    others = np.isfinite(rows).sum(axis=0) - 1
    place = others // 2 if upper else (others - 1) // 2
    place = np.clip(place + (rank <= place), 0, len(rows) - 1)
    median: Floats = np.take_along_axis(np.take_along_axis(rows, order, axis=0), place, axis=0)
    return np.where(np.isfinite(rows) & (others > 0), median, np.nan)


def _spans(mask: NDArray[np.bool_]) -> list[Span]:
    """Return where a mask, `HOP_HZ` values per second, is true and a little around it."""
    around = round(LIMITS.around_s * HOP_HZ)
    wide = ndimage.binary_dilation(mask, np.ones(2 * around + 1, np.bool_)) if mask.any() else mask
    return [Span(first / HOP_HZ, last / HOP_HZ) for first, last in runs_of(wide)]


def _event(span: Span, heights: Mapping[Band, Floats], excesses: Mapping[Band, Floats]) -> Event:
    """Return the event of a span, from what stands out hop by hop and in averages, in whichever it is more."""
    highest = {}
    for band, height in heights.items():
        parts = ((height, HOP_HZ), (excesses[band], HOP_HZ / SLOW_HOPS))
        inside = np.concatenate([each[int(span.start_s * hz) : int(np.ceil(span.end_s * hz))] for each, hz in parts])
        highest[band] = float(inside[np.argmax(np.abs(inside))]) if inside.size else 0.0
    louder = max(highest.values(), key=abs, default=0.0) > 0
    return Event(span, highest, louder and span.duration_s <= LIMITS.longest_knock_s + 2 * LIMITS.around_s)
