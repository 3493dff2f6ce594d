"""Novelty: is a recording like the cases of a label at all? One p-value per label, from all features together.

Every feature of a recording is held against the cases of a label: a Student's t of the difference from their mean over
gearboxes, with the scatter between gearboxes and within. Few gearboxes say little of a scatter, so that of each feature
is drawn towards the mean of its kind, as if `Tuning.prior_freedom` more gearboxes had shown that one. Noise and
filtering of the recorder are no matter of the gearbox, so there every recording of the library counts for itself. The
p-values of all features become one by their harmonic mean, half of it with every kind counting the same and half with
each feature counting by what it tells of kinds of faults (`casebase.reasoning.priors`); it holds however they depend on
each other.

Sources: Smyth, Linear models and empirical Bayes methods, Stat. Appl. Genet. Mol. Biol. 3 (2004), the moderated t;
Hahn and Meeker, Statistical Intervals (1991), prediction of one more observation; Wilson, The harmonic mean p-value,
PNAS 116 (2019).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from casebase.labels import BASELINES
from casebase.reasoning.priors import kind_weights, repeatability
from casebase.reasoning.tuning import TUNING
from casebase.search.case_table import CaseTable, Mask
from casebase.search.similarity import Floats
from signals.features import FEATURES
from signals.motion import SEARCH

FEWEST_GEARBOXES, LARGEST_SAMPLE = 2, 2000
SMALLEST_P = 1e-300
RATIOS, SMALLEST_RATIO = ("crest_factor", "kurtosis"), 1e-3
SIZES = (0.5, 0.75, 1.0, 1.25, 1.5)
NOISE = "noise_on_the_way_12_200_hz"
RECORDER = ("low_band_level", NOISE)
"""What microphone, filter and surroundings make of the sound."""
FALL, FOLDED, CYCLES = "loudness_fall_over_scatter", "notch_bump_12_200_hz", "cycles_left"


@lru_cache
def kinds(names: tuple[str, ...]) -> NDArray[np.intp]:
    """Return for every feature the number of its kind, features of one family and unit; -1 where it does not count.

    A rate in hertz does not: a count of rare events is not normally distributed.
    """
    known = {
        each.name: (type(family).__name__, each.unit)
        for family in FEATURES
        for each in family.definitions
        if (each.compared or each.name in RECORDER) and each.unit != "Hz"
    }
    order = sorted(set(known.values()))
    return np.array([order.index(known[name]) if name in known else -1 for name in names], dtype=np.intp)


@lru_cache
def smallest_scatter(names: tuple[str, ...]) -> Floats:
    """Return what features of two recordings of the same thing differ by at least, shape (n,).

    What speaks of the sound's colour and not of the gear differs as two microphones do.
    """
    colour = {each.name for family in FEATURES if not family.of_the_gear for each in family.definitions}
    return np.where([name in colour for name in names], TUNING.recorder_scatter_db, repeatability(names))


@dataclass(frozen=True, eq=False)
class Likeness:
    """What the cases of one label have shown; arrays have shape (n,).

    Args:
        names: of the features.
        center: mean over gearboxes, ratios as logarithms.
        scale: standard deviation of one more recording of another gearbox from it.
        freedom: degrees of freedom of Student's t.
        share: how much each feature counts; 0 for not at all.
        growth: what the label departs from normal by; zero for normal itself.
        highest: largest departure that counts: none of more noise than usual, for noise makes no other machine.
    """

    names: tuple[str, ...]
    center: Floats
    scale: Floats
    freedom: Floats
    share: Floats
    growth: Floats
    highest: Floats

    def departures(self, values: NDArray[np.floating]) -> Floats:
        """Return Student's t of every feature, shape (n,), at the size that fits best; NaN where there is none."""
        sizes = SIZES if self.growth.any() else (1.0,)
        return max((self._departures(values, size) for size in sizes), key=self._p_value)

    def usual(self, index: int) -> tuple[float, float]:
        """Return what one standard deviation around the mean of a feature is, in its unit."""
        ends = self.center[index] - self.scale[index], self.center[index] + self.scale[index]
        low, high = np.exp(ends) if self.names[index].startswith(RATIOS) else ends
        return float(low), float(high)

    def p_value(self, values: NDArray[np.floating]) -> float:
        """Return how often a recording of the label departs as far; 1 if they have no feature in common."""
        return self._p_value(self.departures(values))

    def _departures(self, values: NDArray[np.floating], size: float) -> Floats:
        center = self.center + (size - 1) * self.growth
        departures = np.minimum((comparable(self.names, values) - center) / self.scale, self.highest)
        return np.where(self.share > 0, departures, np.nan)

    def _p_value(self, departures: Floats) -> float:
        known = np.isfinite(departures)
        if not known.any():
            return 1.0
        p = np.maximum(2 * special.stdtr(self.freedom[known], -np.abs(departures[known])), SMALLEST_P)
        return float(min(1.0, self.share[known].sum() / np.sum(self.share[known] / p)))


def likenesses(table: CaseTable, rows: Mask) -> Mapping[frozenset[str], Likeness]:
    """Return what the labels of some cases have shown, by label; those of fewer than two gearboxes are left out.

    Two faults at once are like neither; each feature is then that of the fault that is farther from normal.
    """
    shown = {label: _likeness(table, rows & (table.labels == label), rows) for label in table.classes}
    found = {label: each for label, each in shown.items() if each is not None}
    normal = next((found[label] for label in BASELINES if label in found), None)
    if normal is not None:
        both = {label: (each.share > 0) & (normal.share > 0) for label, each in found.items()}
        for label in [each for each in found if each not in BASELINES]:
            growth = np.where(both[label], found[label].center - normal.center, 0.0)
            found[label] = replace(found[label], growth=growth)
    faults = [label for label in found if normal is not None and label not in BASELINES]
    pairs = {frozenset(pair): _superposed(*(found[label] for label in pair)) for pair in combinations(faults, 2)}
    return {frozenset({label}): each for label, each in found.items()} | pairs


def _superposed(one: Likeness, other: Likeness) -> Likeness:
    farther = np.abs(other.growth) * one.scale > np.abs(one.growth) * other.scale
    names = ("center", "scale", "freedom", "share", "growth")
    taken: dict[str, Any] = {each: np.where(farther, getattr(other, each), getattr(one, each)) for each in names}
    return replace(one, **taken)


def _likeness(table: CaseTable, rows: Mask, everything: Mask) -> Likeness | None:
    groups = np.unique(table.groups[rows])
    if groups.size < FEWEST_GEARBOXES:
        return None
    recorder = np.isin(table.names, RECORDER)
    values = comparable(table.names, table.values)
    gear = _moments(values, table.groups, spread_out(np.flatnonzero(rows), LARGEST_SAMPLE))
    heard = _moments(values, table.ids, spread_out(np.flatnonzero(everything), LARGEST_SAMPLE))
    center, variance, count = (np.where(recorder, one, other) for one, other in zip(heard, gear, strict=True))
    kind = kinds(table.names)
    counts = (kind >= 0) & (count >= FEWEST_GEARBOXES)
    variance = variance + smallest_scatter(table.names) ** 2
    freedom, share = np.maximum(count - 1.0, 1.0), np.zeros(kind.size)
    for each in np.unique(kind[counts]):
        share[counts & (kind == each)] = 1 / np.count_nonzero(counts & (kind == each))
    telling = np.where(counts, kind_weights(table.names), 0.0)
    share = share / max(share.sum(), 1.0) + telling / max(telling.sum(), 1e-12)
    variance = moderated(variance, freedom, np.where(counts, kind, -1))
    scale = np.sqrt(np.where(counts, variance, 1.0) * (1 + 1 / np.maximum(count, 1)))
    highest = np.where([name == NOISE for name in table.names], 0.0, np.inf)
    center, scale = np.where(counts, center, 0.0), np.maximum(scale, 1e-12)
    return Likeness(table.names, center, scale, freedom + TUNING.prior_freedom, share, np.zeros(kind.size), highest)


def moderated(variance: Floats, freedom: Floats | float, kind: NDArray[np.intp]) -> Floats:
    """Return variances drawn to the mean of their kind as if `Tuning.prior_freedom` degrees of freedom had shown that.

    Args:
        variance: shape (n,); freedom: with which each was estimated; kind: of each, -1 where it stays as it is.
    """
    drawn = np.array(variance, np.float64)
    for each in np.unique(kind[kind >= 0]):
        drawn[kind == each] = variance[kind == each].mean()
    return np.asarray((freedom * variance + TUNING.prior_freedom * drawn) / (freedom + TUNING.prior_freedom))


def comparable(names: tuple[str, ...], values: NDArray[np.floating]) -> Floats:
    """Return features, shape (..., n), crest factors and kurtosis as logarithms: ratios scatter as levels in dB do."""
    ratios = np.array([name.startswith(RATIOS) for name in names], np.bool_)
    found = np.array(values, np.float64)
    found[..., ratios] = np.log(np.maximum(found[..., ratios], SMALLEST_RATIO))
    return found


def _moments(
    values: NDArray[np.floating], names: NDArray[np.str_], rows: NDArray[np.intp]
) -> tuple[Floats, Floats, Floats]:
    """Return the mean over groups, the variance of one more recording of another group, and how many groups there are.

    All of shape (n,); groups that lack a feature are not counted for it.

    Args:
        values: shape (cases, n); names: the group of each, shape (cases,); rows: which of them count.
    """
    groups, of = np.unique(names[rows], return_inverse=True)
    order = np.argsort(of, kind="stable")
    chosen, of = values[rows[order]].astype(np.float64), of[order]
    first = np.searchsorted(of, np.arange(groups.size))
    known = np.isfinite(chosen)
    each = np.add.reduceat(known.astype(np.intp), first, axis=0)
    means = np.add.reduceat(np.where(known, chosen, 0.0), first, axis=0) / np.maximum(each, 1)
    count = (each > 0).sum(axis=0)
    center = np.where(each > 0, means, 0.0).sum(axis=0) / np.maximum(count, 1)
    between = (np.where(each > 0, means - center, 0.0) ** 2).sum(axis=0) / np.maximum(count - 1, 1)
    recordings = known.sum(axis=0)
    apart = np.where(known, chosen - means[of], 0.0)
    within = (apart**2).sum(axis=0) / np.maximum(recordings - count, 1)
    # the mean of a gearbox's recordings has part of the scatter within; one recording has all of it
    return center, between + (1 - count / np.maximum(recordings, 1)) * within, count.astype(np.float64)


def follow_motion(names: tuple[str, ...], values: NDArray[np.floating]) -> Mask:
    """Return which recordings follow a motion: reversals with a period, given or found, where the loudness falls.

    A hiss has no reversal, and so nothing that would stand out at one; its features would be those of a good gear.

    Args:
        values: features, shape (recordings, n).

    Returns:
        Shape (recordings,); false for all if these features do not speak of motion.
    """
    if not {FALL, FOLDED, CYCLES} <= set(names):
        return np.zeros(len(values), dtype=np.bool_)
    fall, folded, cycles = (values[:, names.index(name)] for name in (FALL, FOLDED, CYCLES))
    return np.asarray(np.isfinite(folded) & (fall >= SEARCH.smallest_depth_even) & (cycles > 0))


def nearly_all_move(names: tuple[str, ...], values: NDArray[np.floating]) -> bool:
    """Return whether nearly all cases follow a motion, so that a recording that does not is of none of them."""
    return bool(len(values) and follow_motion(names, values).mean() >= TUNING.nearly_all)


def spread_out(rows: NDArray[Any], most: int) -> NDArray[Any]:
    """Return at most so many rows, evenly spread over all."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).astype(np.intp)]
