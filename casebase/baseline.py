"""Is it like a sound gear at all? A prediction test of normal recordings, so that `normal` is earned like any label.

Every feature of a recording is held against the normal recordings of the library: a Student's t of the difference
from their mean over gearboxes, with the scatter between gearboxes and within. Few gearboxes say little of a scatter,
so that of each feature is drawn towards the mean of its kind as if PRIOR_FREEDOM more gearboxes had shown that one.
The p-values of all features become one by their harmonic mean, in which every kind has the same say; it holds however
the features depend on each other.

Sources: Smyth, Linear models and empirical Bayes methods, Stat. Appl. Genet. Mol. Biol. 3 (2004), the moderated t;
Hahn and Meeker, Statistical Intervals (1991), prediction of one more observation; Wilson, The harmonic mean p-value,
PNAS 116 (2019).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import special

from casebase.case_table import CaseTable, Mask
from casebase.novelty import BASELINES, NEW_ONCE_IN, spread_out
from casebase.priors import repeatability
from casebase.signals.features import FEATURES
from casebase.similarity import Floats

PRIOR_FREEDOM = 3.0
"""How alike the scatters of one kind of features are: as if each were known from so many gearboxes (Smyth's estimate
from normal recordings of ten gearboxes: 2.5 to 3.3 on four draws of tests/field_bank, 1.9 on shared recordings)."""
FEWEST_GEARBOXES, LARGEST_SAMPLE = 2, 2000
SMALLEST = 1e-300
UNLIKE = 1 / NEW_ONCE_IN
"""A sound gear that the library has not seen gets a smaller p-value so seldom."""


@lru_cache
def kinds(names: tuple[str, ...]) -> NDArray[np.intp]:
    """Return for every feature the number of its kind, features of one family and unit; -1 where it has no say.

    A rate in hertz has none: a count of rare events is not normally distributed.
    """
    known: dict[str, tuple[str, str]] = {}
    for family in FEATURES:
        if family.of_the_gear:
            known |= {
                each.name: (type(family).__name__, each.unit)
                for each in family.definitions
                if each.compared and each.unit != "Hz"
            }
    order = sorted(set(known.values()))
    return np.array([order.index(known[name]) if name in known else -1 for name in names], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Baseline:
    """What normal recordings have shown.

    Args:
        center: mean over gearboxes, shape (n,).
        scale: standard deviation of one more recording of another gearbox from it, shape (n,).
        freedom: degrees of freedom of Student's t.
        say: how much each feature has to say, shape (n,); 0 for none.
    """

    center: Floats
    scale: Floats
    freedom: float
    say: Floats

    def departures(self, values: NDArray[np.floating]) -> Floats:
        """Return Student's t of every feature, shape (n,); NaN where there is none."""
        return np.where(self.say > 0, (np.asarray(values, np.float64) - self.center) / self.scale, np.nan)

    def p_value(self, values: NDArray[np.floating]) -> float:
        """Return how often a sound gear departs as far as this recording; 1 if they have no feature in common."""
        t = np.abs(self.departures(values))
        known = np.isfinite(t)
        if not known.any():
            return 1.0
        p = np.maximum(2 * special.stdtr(self.freedom, -t[known]), SMALLEST)
        return float(min(1.0, self.say[known].sum() / np.sum(self.say[known] / p)))


def baseline(table: CaseTable, rows: Mask) -> Baseline | None:
    """Return what the normal ones among some rows have shown; None if they are of too few gearboxes to tell."""
    chosen = spread_out(np.flatnonzero(rows & np.isin(table.labels, BASELINES)), LARGEST_SAMPLE)
    groups, of = np.unique(table.groups[chosen], return_inverse=True)
    if groups.size < FEWEST_GEARBOXES:
        return None
    order = np.argsort(of, kind="stable")
    values, of = table.values[chosen[order]].astype(np.float64), of[order]
    first = np.searchsorted(of, np.arange(groups.size))
    known = np.isfinite(values)
    each = np.add.reduceat(known.astype(np.intp), first, axis=0)
    sums = np.add.reduceat(np.where(known, values, 0.0), first, axis=0)
    means = np.where(each > 0, sums / np.maximum(each, 1), np.nan)
    shown = (each > 0).sum(axis=0)
    says = (kinds(table.names) >= 0) & (shown >= FEWEST_GEARBOXES)
    center = np.where(says, np.where(each > 0, means, 0.0).sum(axis=0) / np.maximum(shown, 1), 0.0)
    spread = np.where(each > 0, means - center, 0.0)
    between = (spread**2).sum(axis=0) / np.maximum(shown - 1, 1)
    apart = np.where(known, values - means[of], 0.0)
    within = (apart**2).sum(axis=0) / np.maximum(known.sum(axis=0) - shown, 1)
    # the means of a gearbox's recordings have part of the scatter within; one recording has all of it
    part = 1 - shown / np.maximum(known.sum(axis=0), 1)
    variance = between + part * within + repeatability(table.names) ** 2
    freedom, say = groups.size - 1.0, np.zeros(says.size)
    for kind in np.unique(kinds(table.names)[says]):
        same = says & (kinds(table.names) == kind)
        say[same] = 1 / np.count_nonzero(same)
        variance[same] = (freedom * variance[same] + PRIOR_FREEDOM * variance[same].mean()) / (freedom + PRIOR_FREEDOM)
    scale = np.sqrt(np.where(says, variance, 1.0) * (1 + 1 / groups.size))
    return Baseline(center, np.maximum(scale, 1e-12), freedom + PRIOR_FREEDOM, say)
