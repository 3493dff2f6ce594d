"""Is it like anything known? How far a recording lies outside what each class has shown, and where unknown begins.

Each class has a range in every feature: what its cases have shown, and half as much again in the direction in which
the class departs from normal, because a known fault that grew is not a new one. Nor is a small one: all ranges of a
class may be drawn towards the middle of normal together. Two known faults at once are a class as well. The distance to
a class is

    sqrt(sum_j w_j min(e_j / s_j, LIMIT)^2),

with e_j what the value lies outside the range, s_j the spread of normal recordings, and w_j how much a feature says
about the kind of a fault (`casebase.priors`). The novelty is the distance to the nearest class. It begins where a
recording of a known class, from a gearbox that the library has not seen, gets once in NEW_ONCE_IN.

Sources of the limit: Hahn and Meeker, Statistical Intervals (1991), prediction limit of a normal sample; Wilson and
Hilferty, The Distribution of Chi-Square, PNAS 17 (1931): the cube root of a sum of squares is nearly normal.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from casebase.case_table import CaseTable, Mask
from casebase.labels import BASELINES as BASELINES
from casebase.priors import kind_weights, repeatability
from casebase.similarity import Floats, column_quantiles, pooled_scales, robust_scales

GROWTH = 0.5
PAIR = " and "
SIZES = (1.0, 0.75)
"""Of one fault that departs less from normal than its cases, in all features alike."""
TAIL = 0.02
"""Share of a class's cases that may lie outside its range at each end, once there are so many."""
LIMIT = 7.0
SMALLEST_LIMIT = 1.0
"""What lies outside by less than one spread, in the mean over all features, is not unlike what is known."""
LARGEST_LIMIT = 0.9 * LIMIT
"""However much known gearboxes differ, what lies this far outside in everything is none of them."""
NEW_ONCE_IN = 50
NINTH_DECILE = 1.2816
"""Of the standard normal distribution."""
FEWEST_FOR_LIMIT = 6
OWN_CASES = 8.0
LARGEST_CLASS = 500
UNKNOWN_GEARBOX = 1.5
"""Where gearboxes were not noted, cases of the same one make the library look better than it is on another; the
unknown then begins so many times as far out."""


@dataclass(frozen=True, eq=False)
class KnownRanges:
    """What the classes have shown.

    Args:
        ranges: per class, low and high end of every feature, shape (n,); NaN where the class never had it.
        center: middle of normal, shape (n,).
        scale: spread that a departure is held against, shape (n,).
        weights: shape (n,), sum 1.
    """

    ranges: Mapping[str, tuple[Floats, Floats]]
    center: Floats
    scale: Floats
    weights: Floats

    def parts(self, values: NDArray[np.floating]) -> tuple[str, Floats]:
        """Return the nearest class and the weighted squared departure of every feature from it, shape (n,).

        Features that the recording does not have are left out and the weights brought to sum 1 again; one that the
        class never had counts as one spread.
        """
        present = np.isfinite(values)
        weights = np.where(present, self.weights, 0.0)
        weights /= weights.sum() if weights.any() else 1.0
        best: tuple[float, str, Floats] | None = None
        for label, (low, high) in self.ranges.items():
            for size in (1.0,) if label in BASELINES or PAIR in label else SIZES:
                first, last = (self.center + size * (end - self.center) for end in (low, high))
                outside = np.maximum(np.maximum(first - values, values - last), 0.0) / self.scale
                outside = np.where(np.isnan(low) & present, 1.0, outside)
                departure = weights * np.where(present, np.minimum(outside, LIMIT), 0.0) ** 2
                total = float(departure.sum())
                if best is None or (total, label) < best[:2]:
                    best = total, label, departure
        assert best is not None
        return best[1], best[2]

    def distance(self, values: NDArray[np.floating]) -> float:
        """Return the distance to the nearest class."""
        return float(np.sqrt(self.parts(values)[1].sum()))


def known_ranges(names: tuple[str, ...], values: NDArray[np.floating], labels: NDArray[np.str_]) -> KnownRanges:
    """Return the ranges that cases have shown.

    Args:
        values: shape (cases, n), NaN where missing.
        labels: shape (cases,).
    """
    classes = np.unique(labels)
    shares = [spread_out(np.flatnonzero(labels == label), LARGEST_CLASS) for label in classes]
    rows = np.concatenate(shares) if shares else np.empty(0, np.intp)
    values, labels = np.asarray(values[rows], np.float64), labels[rows]
    normal = np.isin(labels, BASELINES)
    center, scale = _normal_scale(values, labels, normal)
    shown = {str(label): values[labels == label] for label in classes}
    faults = [label for label in shown if label not in BASELINES] if normal.any() else []
    for one, other in itertools.combinations(faults, 2):
        shown[f"{one}{PAIR}{other}"] = superposed(shown[one], shown[other], center, scale)
    ranges = {}
    for label, cases in shown.items():
        low, high = column_quantiles(cases, (TAIL, 1 - TAIL))
        if normal.any() and label not in BASELINES:
            low, high = (
                low - GROWTH * np.fmax(center - low, 0.0),
                high + GROWTH * np.fmax(high - center, 0.0),
            )
        ranges[label] = (low, high)
    return KnownRanges(ranges, center, np.hypot(scale, repeatability(names)), kind_weights(names))


def superposed(ones: Floats, others: Floats, normal: Floats, scale: Floats) -> Floats:
    """Return cases of two faults, shape (cases, n): each feature from the fault that is farther from normal.

    Two faults strike at places of their own, and of two sounds the stronger one is heard. As many as there are ones.

    Args:
        ones, others: cases of one fault each, shape (cases, n).
        normal, scale: middle of normal cases and spread of each feature, shape (n,).
    """
    others = others[np.arange(len(ones)) % len(others)]
    away, beyond = (np.nan_to_num(np.abs((each - normal) / scale), nan=-1.0) for each in (ones, others))
    return np.where(beyond > away, others, ones)


def _normal_scale(
    values: NDArray[np.floating], labels: NDArray[np.str_], normal: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Return middle and spread of normal recordings; few of them are drawn towards the spread within all classes."""
    center, pooled = pooled_scales(values, labels)
    count = int(normal.sum())
    if count < 3:
        return center, pooled
    center = robust_scales(values[normal])[0]
    own = _winsorised_deviation(np.asarray(values[normal], np.float64))
    return center, np.sqrt((count * own**2 + OWN_CASES * pooled**2) / (count + OWN_CASES))


def _winsorised_deviation(values: Floats) -> Floats:
    """Return the standard deviation per column with values beyond three robust ones drawn in, shape (n,).

    The median absolute deviation of few values alone is often far too small, and one in sixty would then cry wolf.
    """
    center, scale = robust_scales(values)
    drawn = np.clip(values, center - 3 * scale, center + 3 * scale)
    known = np.isfinite(drawn).sum(axis=0) > 1
    deviation = scale.copy()
    deviation[known] = np.maximum(np.nanstd(drawn[:, known], axis=0, ddof=1), scale[known] / 2)
    return deviation


def spread_out(rows: NDArray[Any], most: int) -> NDArray[Any]:
    """Return at most so many rows, evenly spread over all."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).astype(np.intp)]


def novelty_limit(distances: Floats) -> float | None:
    """Return where the unknown begins, from cases whose gearbox was held out; None if they are too few.

    The spread is taken between the median and the ninth decile, so that one odd case does not set the limit; Student's
    factor makes a small library careful to call anything new.

    Args:
        distances: of held-out cases, shape (cases,).
    """
    if distances.size < FEWEST_FOR_LIMIT:
        return None
    middle, high = np.quantile(distances ** (2 / 3), [0.5, 0.9])
    spread = float(high - middle) / NINTH_DECILE
    factor = float(special.stdtrit(distances.size - 1, 1 - 1 / NEW_ONCE_IN))
    limit = float((middle + factor * spread * np.sqrt(1 + 1 / distances.size)) ** 1.5)
    return min(max(limit, SMALLEST_LIMIT), LARGEST_LIMIT)


def border(table: CaseTable, among: Mask | None = None) -> Mask:
    """Return the cases that say what is known: measured ones, and simulated ones of what was never measured.

    Args:
        among: the cases that there are, shape (cases,); all by default.
    """
    measured = table.origins == "measured"
    if among is not None:
        measured &= among
    shown = np.zeros(len(table.classes), np.bool_)
    shown[table.class_numbers[measured]] = True
    known = measured | ~shown[table.class_numbers]
    return np.asarray(known if among is None else known & among)


def where_unknown_begins(table: CaseTable, present: Mask, rows: NDArray[np.intp]) -> float | None:
    """Return the novelty limit from how far cases lie from what all other gearboxes have shown; arguments as `gather`.

    Cases of a class that no other gearbox has say nothing. Measured cases alone decide where there are enough. None if
    the cases are too few.
    """
    held_out = table.parts
    measured = table.origins == "measured"
    counts = measured if _comparable(table, held_out, rows, measured).size >= FEWEST_FOR_LIMIT else border(table)
    rows = _comparable(table, held_out, rows, counts)
    novelty = np.full(rows.size, np.inf)
    for group in np.unique(held_out[rows]):
        ranges = ranges_of(table, border(table, held_out != group))
        for index in np.flatnonzero(held_out[rows] == group):
            query = np.where(present, table.values[rows[index]], np.nan)
            novelty[index] = ranges.distance(query) if ranges.ranges else np.inf
    limit = novelty_limit(novelty)
    alone = float(np.mean(table.groups[rows] == table.ids[rows])) if rows.size else 0.0
    caution = UNKNOWN_GEARBOX if alone > 0.5 else 1.0
    return None if limit is None else caution * limit


def _comparable(table: CaseTable, held_out: NDArray[np.intp], rows: NDArray[np.intp], among: Mask) -> NDArray[np.intp]:
    """Return those of the rows that are among some cases, and whose class another gearbox of them has too."""
    shared = [label for label in table.classes if np.unique(held_out[among & (table.labels == label)]).size > 1]
    return rows[among[rows] & np.isin(table.labels[rows], shared)]


def ranges_of(table: CaseTable, rows: Mask) -> KnownRanges:
    """Return what these cases have shown."""
    of_classes = [np.flatnonzero(rows & (table.class_numbers == number)) for number in range(len(table.classes))]
    sample = np.concatenate([spread_out(each, LARGEST_CLASS) for each in of_classes] or [np.empty(0, np.intp)])
    return known_ranges(table.names, table.values[sample], table.labels[sample])
