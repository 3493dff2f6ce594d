"""What the library knows of itself: how far its own cases lie from each other when their gearbox is held out.

From it come the three numbers that a diagnosis says: a p-value per class (conformal prediction), a probability
(votes calibrated on held-out gearboxes), and the distance beyond which a recording is like nothing in the library.

Source: Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World (2005), label-conditional p-values.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.case_table import CaseTable, Mask
from casebase.learning import Similarity
from casebase.novelty import FEWEST_FOR_LIMIT, LIMIT, KnownRanges, known_ranges, novelty_limit, spread_out
from casebase.retrieval import CaseMatrix
from casebase.similarity import Floats
from casebase.voting import NEAREST, balance, fitted_sharpness, log_votes, strangeness

LARGEST_SAMPLE = 400
MOST_PARTS = 20
PARTS = 10
UNKNOWN_GEARBOX = 1.5
"""Where gearboxes were not noted, cases of the same one make the library look better than it is on another; the
unknown then begins so many times as far out."""
LEVEL = 0.05
"""The level of the conformal test that the library should be large enough for."""


@dataclass(frozen=True)
class Judgement:
    """What the library says of one recording; arrays have shape (classes,).

    Args:
        still: whether it does not follow a motion although all cases do; it is then as far as anything can be.
    """

    classes: tuple[str, ...]
    probabilities: Floats
    p_values: Floats
    novelty: float
    threshold: float | None
    supports_level: tuple[bool, ...]
    still: bool = False


@dataclass(frozen=True, eq=False)
class Experience:
    """The library held against itself, for one set of features that a query has.

    Args:
        nearest: squared distances to the nearest cases of every class, gearbox held out, shape (rows, classes, k).
        truth: class of every row.
        threshold: the novelty limit; None if the library is too small to set one.
        jury: the cases that vote, shape (cases,); see `possible_juries`.
    """

    classes: tuple[str, ...]
    nearest: Floats
    truth: NDArray[np.intp]
    sharpness: float
    threshold: float | None
    jury: Mask

    @property
    def doubt(self) -> float:
        """Error rate that as many cases without any error still allow, by Laplace's rule of succession.

        The errors that were made are in the sharpness of the votes already.
        """
        return 1 / (self.truth.size + 2)

    def judge(self, nearest: Floats, novelty: float, still: bool = False) -> Judgement:
        """Return probabilities and p-values for one query.

        Args:
            nearest: squared distances to the nearest cases of every class, shape (classes, k).
            novelty: distance to what is known.
            still: see `Judgement`.
        """
        shares = np.exp(log_votes(nearest[None], self.sharpness)[0])
        return Judgement(
            self.classes,
            self._probabilities(shares),
            self._p_values(strangeness(nearest[None])[0]),
            LIMIT if still else novelty,
            self.threshold,
            tuple(self._count(each) + 1 >= 1 / LEVEL for each in range(len(self.classes))),
            still,
        )

    def _probabilities(self, shares: Floats) -> Floats:
        """Return shares of votes mixed with ignorance, so that a small library never is certain."""
        count = len(self.classes)
        if count == 1:
            return np.array([1 - self.doubt])
        ignorance = min(1.0, self.doubt * count / (count - 1))
        return np.asarray((1 - ignorance) * shares + ignorance / count)

    def _p_values(self, strange: Floats) -> Floats:
        """Return the share of each class's own cases that are at least as strange to it."""
        known = strangeness(self.nearest)
        values = np.empty(len(self.classes))
        for index in range(len(self.classes)):
            own = known[self.truth == index, index]
            own = own[np.isfinite(own)]
            values[index] = (1 + np.count_nonzero(own >= strange[index])) / (own.size + 1)
        return values

    def _count(self, index: int) -> int:
        own = strangeness(self.nearest)[self.truth == index, index]
        return int(np.isfinite(own).sum())


def gather(table: CaseTable, similarity: Similarity, present: Mask, rows: NDArray[np.intp]) -> Experience:
    """Hold some of the cases against all others of other gearboxes, over the features present.

    Args:
        table: all cases.
        rows: the cases to hold out, one gearbox at a time.
        present: the features that the query has, shape (n,).
    """
    truth = np.searchsorted(table.classes, table.labels[rows])
    juries = possible_juries(table)
    seen = _nearest_of_others(table, similarity, present, rows, juries)
    chosen = _most_telling(seen, truth)
    nearest = seen[chosen]
    known = _reached(nearest, truth)
    sharpness = fitted_sharpness(nearest[known], truth[known])
    limit = where_unknown_begins(table, present, rows)
    return Experience(table.classes, nearest[known], truth[known], sharpness, limit, juries[chosen])


def possible_juries(table: CaseTable) -> list[Mask]:
    """Return which cases might vote, each a part of the one before: all; no simulated ones of axes without a measured
    case; no simulated ones at all of classes that were measured. What was never measured is voted for by what is
    simulated in any of them."""
    measured = table.origins == "measured"
    needed = measured | ~np.isin(table.labels, np.unique(table.labels[measured]))
    own = np.isin(table.axes, np.unique(table.axes[measured]))
    juries = [np.ones(len(table), bool)]
    for jury in (needed | own, needed):
        if not np.array_equal(jury, juries[-1]):
            juries.append(jury)
    return juries


def _nearest_of_others(
    table: CaseTable, similarity: Similarity, present: Mask, rows: NDArray[np.intp], juries: Sequence[Mask]
) -> Floats:
    """Return squared distances to the nearest of each jury from other gearboxes, shape (juries, rows, classes, k)."""
    nearest = np.full((len(juries), rows.size, len(table.classes), NEAREST), np.inf)
    held_out = _held_out_together(table)
    matrices: dict[bytes, CaseMatrix] = {}
    for index, row in enumerate(rows):
        weights = similarity.weights_without(str(table.groups[row]))
        matrix = matrices.get(weights.tobytes())
        if matrix is None:
            matrix = matrices[weights.tobytes()] = CaseMatrix(table, similarity.metric.with_weights(weights))
        query = np.where(present, table.values[row], np.nan)
        others = (held_out != held_out[row]) & (table.samples != table.samples[row])
        for seen, jury in zip(nearest, juries, strict=True):
            seen[index] = matrix.nearest_by_class(query, NEAREST, where=jury & others).voting(NEAREST)
    return nearest


def _reached(nearest: Floats, truth: NDArray[np.intp]) -> Mask:
    """Return for which rows a case of their own class votes."""
    return np.asarray(np.isfinite(nearest[np.arange(truth.size), truth, 0]))


def _most_telling(seen: Floats, truth: NDArray[np.intp]) -> int:
    """Return the jury under whose votes the true classes are most probable; of equals the smallest.

    Trust in simulated cases is measured by this, on measured ones. Few rows decide nothing, and all may vote.
    """
    rows = np.logical_and.reduce([_reached(nearest, truth) for nearest in seen])
    if len(seen) == 1 or rows.sum() < FEWEST_FOR_LIMIT:
        return 0
    true, weights, losses = truth[rows], balance(truth[rows]), []
    for nearest in (each[rows] for each in seen):
        shares = log_votes(nearest, fitted_sharpness(nearest, true))
        losses.append(-float(weights @ np.maximum(shares[np.arange(true.size), true], -50.0)))
    return len(losses) - 1 - int(np.argmin(losses[::-1]))


def where_unknown_begins(table: CaseTable, present: Mask, rows: NDArray[np.intp]) -> float | None:
    """Return the novelty limit from how far cases lie from what all other gearboxes have shown; arguments as `gather`.

    Cases of a class that no other gearbox has say nothing. Measured cases alone decide where there are enough: what
    is simulated may widen what is known, but does not say how near to it a gearbox that is known must lie. None if
    the cases are too few.
    """
    held_out = _held_out_together(table)
    measured = table.origins == "measured"
    counts = (
        measured if _comparable(table, held_out, rows, measured).size >= FEWEST_FOR_LIMIT else np.full(len(table), True)
    )
    rows = _comparable(table, held_out, rows, counts)
    novelty = np.full(rows.size, np.inf)
    for group in np.unique(held_out[rows]):
        ranges = _ranges(table, counts & (held_out != group))
        for index in np.flatnonzero(held_out[rows] == group):
            query = np.where(present, table.values[rows[index]], np.nan)
            novelty[index] = ranges.distance(query) if ranges else np.inf
    limit = novelty_limit(novelty)
    alone = float(np.mean(table.groups[rows] == table.ids[rows])) if rows.size else 0.0
    caution = UNKNOWN_GEARBOX if alone > 0.5 else 1.0
    return None if limit is None else caution * limit


def _comparable(table: CaseTable, held_out: NDArray[np.intp], rows: NDArray[np.intp], among: Mask) -> NDArray[np.intp]:
    """Return those of the rows that are among some cases, and whose class another gearbox of them has too."""
    shared = [label for label in table.classes if np.unique(held_out[among & (table.labels == label)]).size > 1]
    return rows[among[rows] & np.isin(table.labels[rows], shared)]


def _held_out_together(table: CaseTable) -> NDArray[np.intp]:
    """Return the part that each case is held out with: its gearbox, or a tenth of the gearboxes where they are many."""
    groups, part = np.unique(table.groups, return_inverse=True)
    return part if groups.size <= MOST_PARTS else part % PARTS


def _ranges(table: CaseTable, rows: Mask) -> KnownRanges | None:
    return known_ranges(table.names, table.values[rows], table.labels[rows]) if rows.any() else None


def representative(table: CaseTable) -> NDArray[np.intp]:
    """Return the rows to hold out: measured cases if every class has some, at most LARGEST_SAMPLE, evenly spread."""
    rows = np.flatnonzero(table.origins == "measured")
    if set(table.labels[rows].tolist()) != set(table.classes):
        rows = np.arange(len(table))
    return spread_out(rows, LARGEST_SAMPLE)
