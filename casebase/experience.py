"""What the library knows of itself: how far its own cases lie from each other when their gearbox is held out.

From it come the three numbers that a diagnosis says: a p-value per class (conformal prediction), a probability
(votes calibrated on held-out gearboxes and on disturbed copies of their recordings), and the distance beyond which a
recording is like nothing in the library.

Source: Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World (2005), label-conditional p-values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from casebase.baseline import UNLIKE, Baseline, baseline
from casebase.calibration import PRIOR, Calibration, Usual, fitted
from casebase.case_table import CaseTable, Mask
from casebase.detection import Detection
from casebase.learning import Similarity
from casebase.novelty import (
    BASELINES,
    FEWEST_FOR_LIMIT,
    LIMIT,
    border,
    spread_out,
    where_unknown_begins,
)
from casebase.retrieval import CaseMatrix, Kinship
from casebase.similarity import Floats
from casebase.voting import NEAREST, balance, fitted_sharpness, log_votes, nonconformity

LARGEST_SAMPLE = 400
UNKNOWN_COLOUR = 5.0
"""A sound that is by so many standard deviations unlike all measured cases comes from another machine or recorder: of
no distribution do more than four in a hundred lie so far out (Chebyshev)."""
LEAST_LEAD = 0.05
"""However little a recording tells, what leads keeps so much of its lead over an even share [1]."""
LEVEL = 0.05
"""The level of the conformal test that the library should be large enough for."""


@dataclass(frozen=True)
class Judgement:
    """What the library says of one recording; arrays have shape (classes,).

    Args:
        still: whether it does not follow a motion although all cases do; it is then as far as anything can be.
        unlike: by how many standard deviations its colour is unlike that of measured cases; 0 without such.
        sound_gear: how often a sound gear departs as far from the normal ones; None where too few say so.
    """

    classes: tuple[str, ...]
    probabilities: Floats
    p_values: Floats
    novelty: float
    threshold: float | None
    supports_level: tuple[bool, ...]
    still: bool = False
    unlike: float = 0.0
    sound_gear: float | None = None

    @property
    def refused(self) -> bool:
        """Whether the leading label is `normal`, of a recording unlike every normal one."""
        leading = self.classes[int(self.probabilities.argmax())]
        return leading in BASELINES and self.sound_gear is not None and self.sound_gear < UNLIKE


@dataclass(frozen=True, eq=False)
class Experience:
    """The library held against itself, for one set of features that a query has.

    Args:
        nearest: squared distances to the nearest cases of every class, gearbox held out, shape (rows, classes, k).
        truth: class of every row.
        threshold: the novelty limit; None if the library is too small to set one.
        voters: the cases that vote, shape (cases,); see `possible_voters`.
        detection: which faults would be heard in a recording.
        calibration: how sure one may be of the leading label.
        names: of the features.
        colour_known: whether enough cases were measured to say what a recorder makes of this machine.
        normal: what normal recordings have shown; None where they are too few.
        judged: how many cases were held out for the sharpness; one by one where there is one gearbox alone.
    """

    classes: tuple[str, ...]
    nearest: Floats
    truth: NDArray[np.intp]
    sharpness: float
    threshold: float | None
    voters: Mask
    detection: Detection
    calibration: Calibration
    names: tuple[str, ...]
    colour_known: bool
    normal: Baseline | None
    judged: int

    @property
    def doubt(self) -> float:
        """Error rate that as many cases without any error still allow, by Laplace's rule of succession.

        The errors that were made are in the sharpness of the votes already.
        """
        return 1 / (self.judged + 2)

    def judge(self, nearest: Floats, novelty: float, values: NDArray[np.floating], still: bool = False) -> Judgement:
        """Return probabilities and p-values for one query.

        Args:
            nearest: squared distances to the nearest cases of every class, shape (classes, k).
            novelty: distance to what is known.
            values: its features, shape (n,).
            still: see `Judgement`.
        """
        unlike = float(self.calibration.unlike(self.names, values[None])[0]) if self.colour_known else 0.0
        return Judgement(
            self.classes,
            self._calibrated(self.shares(nearest, values), values),
            self._p_values(nonconformity(nearest[None])[0]),
            LIMIT if still or unlike > UNKNOWN_COLOUR else novelty,
            self.threshold,
            tuple(self._count(each) + 1 >= 1 / LEVEL for each in range(len(self.classes))),
            still,
            unlike,
            None if self.normal is None else self.normal.p_value(values),
        )

    def shares(self, nearest: Floats, values: NDArray[np.floating], but: str = "") -> Floats:
        """Return every class's share before calibration, shape (classes,); `but` is a gearbox that is held out."""
        votes = np.exp(log_votes(nearest[None], self.sharpness)[0])
        return self.detection.earned(votes, self.detection.missed(values, but))

    def _calibrated(self, shares: Floats, values: NDArray[np.floating]) -> Floats:
        """Return probabilities: that of the leading label is calibrated, the others share the rest as before."""
        top, count = int(shares.argmax()), len(self.classes)
        lacking = self.calibration.lacks(self.names, values[None])
        sound = np.array([self.classes[top] in BASELINES])
        sure = float(self.calibration.probability(shares[top : top + 1], lacking, sound)[0])
        sure = min(sure, 1 - self.doubt)
        if count == 1:
            return np.array([sure])
        even = 1 / count
        share = float(shares[top])
        sure = max(sure, even + LEAST_LEAD * (share - even))
        if share > sure:
            # drawn to an even share, so that the leading label stays in the lead
            return np.asarray(even + (sure - even) / (share - even) * (shares - even))
        probabilities = shares * ((1 - sure) / max(1 - share, 1e-12))
        probabilities[top] = sure
        return np.asarray(probabilities)

    def _p_values(self, strange: Floats) -> Floats:
        """Return the share of each class's own cases that are at least as strange to it."""
        known = nonconformity(self.nearest)
        values = np.empty(len(self.classes))
        for index in range(len(self.classes)):
            own = known[self.truth == index, index]
            own = own[np.isfinite(own)]
            values[index] = (1 + np.count_nonzero(own >= strange[index])) / (own.size + 1)
        return values

    def _count(self, index: int) -> int:
        own = nonconformity(self.nearest)[self.truth == index, index]
        return int(np.isfinite(own).sum())


def gather(table: CaseTable, similarity: Similarity, present: Mask, rows: NDArray[np.intp]) -> Experience:
    """Hold some of the cases against all others of other gearboxes, over the features present.

    Args:
        table: all cases.
        rows: the cases to hold out, one gearbox at a time.
        present: the features that the query has, shape (n,).
    """
    truth = np.searchsorted(table.classes, table.labels[rows])
    voter_sets = possible_voters(table)
    seen = _nearest_of_others(table, similarity, present, rows, table.values[rows], voter_sets)
    chosen = _enough(seen, truth)
    nearest = seen[chosen]
    known = _reached(nearest, truth)
    held, of = (nearest[known], truth[known]) if known.any() else _one_by_one(table, similarity, present, rows, truth)
    sharpness = fitted_sharpness(held, of)
    return Experience(
        table.classes,
        nearest[known],
        truth[known],
        sharpness,
        where_unknown_begins(table, present, rows),
        voter_sets[chosen],
        Detection.of(table, voter_sets[chosen]),
        similarity.calibration or replace(PRIOR, usual=usual(table, rows)),
        table.names,
        int((table.origins[rows] == "measured").sum()) >= FEWEST_FOR_LIMIT,
        baseline(table, border(table)),
        of.size,
    )


def usual(table: CaseTable, rows: NDArray[np.intp]) -> Usual:
    """Return what recordings of the library have; of measured ones, where there are enough."""
    measured = rows[table.origins[rows] == "measured"]
    return Usual.of(table.names, table.values[measured if measured.size >= FEWEST_FOR_LIMIT else rows])


@dataclass(frozen=True, eq=False)
class Copies:
    """Disturbed copies of the recordings of some cases.

    Args:
        rows: the case that each is a copy of, shape (copies,).
        values: features, shape (copies, n), NaN where missing.
    """

    rows: NDArray[np.intp]
    values: NDArray[np.float32]


MOST_MASKS = 4
"""Copies that lack features in more ways than these, the most frequent ones, are left aside."""
FEWEST_FOR_CALIBRATION = 30


def calibrated(table: CaseTable, similarity: Similarity, copies: Copies) -> Similarity:
    """Return the similarity with a calibration learned from cases and copies, each held out with its gearbox."""
    rows = representative(table)
    own = np.isin(rows, copies.rows)
    asked = np.concatenate([rows[own], copies.rows])
    values = np.concatenate([table.values[rows[own]], copies.values])
    masks, kinds, counts = np.unique(np.isfinite(values), axis=0, return_inverse=True, return_counts=True)
    typical, held_out = usual(table, rows), table.parts
    normal = {int(part): baseline(table, border(table) & (held_out != part)) for part in np.unique(held_out[asked])}
    share, right, sound, kept, truth = [], [], [], [], []
    for kind in np.argsort(-counts)[:MOST_MASKS]:
        experience = gather(table, similarity, masks[kind], rows)
        these = np.flatnonzero(kinds.ravel() == kind)
        seen = _nearest_of_others(table, similarity, masks[kind], asked[these], values[these], [experience.voters])[0]
        for index, near in zip(these, seen, strict=True):
            row = asked[index]
            if not (table.labels[experience.voters & (table.groups != table.groups[row])] == table.labels[row]).any():
                continue
            shares = experience.shares(near, values[index], str(table.groups[row]))
            leading = table.classes[int(shares.argmax())]
            known = normal[int(held_out[row])]
            if leading in BASELINES and known is not None and known.p_value(values[index]) < UNLIKE:
                continue
            share.append(float(shares.max()))
            right.append(leading == table.labels[row])
            sound.append(leading in BASELINES)
            kept.append(index)
            truth.append(int(np.searchsorted(table.classes, table.labels[row])))
    if len(kept) < FEWEST_FOR_CALIBRATION:
        return similarity
    lacking = replace(PRIOR, usual=typical).lacks(table.names, values[kept])
    weights = balance(np.array(truth))
    learned = fitted(np.array(share), lacking, np.array(sound), np.array(right), weights, typical)
    return replace(similarity, calibration=learned)


def possible_voters(table: CaseTable) -> list[Mask]:
    """Return which cases might vote: all, and those that say what is known (`border`) where these are fewer."""
    known = border(table)
    return [np.ones(len(table), bool)] if known.all() else [np.ones(len(table), bool), known]


def _nearest_of_others(
    table: CaseTable,
    similarity: Similarity,
    present: Mask,
    rows: NDArray[np.intp],
    values: NDArray[np.floating],
    voter_sets: Sequence[Mask],
) -> Floats:
    """Return squared distances to the nearest voters of each set from other gearboxes, shape (sets, rows, classes, k).

    Args:
        values: features of the rows, or of copies of them, shape (rows, n).
    """
    weights = np.array([similarity.weights_without(str(table.groups[row])) for row in rows])
    weights = weights.reshape(rows.size, len(table.names))
    held_out = table.parts
    kin = [(held_out, held_out[rows]), (table.sounds, table.sounds[rows])]
    queries = np.where(present, values, np.nan)
    nearest = np.full((len(voter_sets), rows.size, len(table.classes), NEAREST), np.inf)
    kinds, kind = np.unique(weights, axis=0, return_inverse=True)
    for number, learned in enumerate(kinds):
        these = np.flatnonzero(kind.ravel() == number)
        matrix = CaseMatrix(table, similarity.metric.with_weights(learned))
        own = [(shared, of[these]) for shared, of in kin]
        nearest[:, these] = _nearest_voters(matrix, queries[these], voter_sets, own)
    return nearest


def _nearest_voters(matrix: CaseMatrix, queries: Floats, voter_sets: Sequence[Mask], kin: Sequence[Kinship]) -> Floats:
    """Return squared distances to the nearest voters of each set that share nothing, shape (sets, queries, classes, k).

    Cases that sit in the same sets are searched as one group, so that each case is looked at once.
    """
    table = matrix.table
    seats = np.zeros(len(table), np.int16)
    for place, voters in enumerate(voter_sets):
        seats |= voters.astype(np.int16) << place
    sat, seat = np.unique(seats, return_inverse=True)
    groups = np.where(seats > 0, table.class_numbers * sat.size + seat, -1).astype(np.int16)
    count = len(table.classes) * sat.size
    _, distances = matrix.nearest_strangers(queries, groups, count, NEAREST, kin)
    shared = (distances**2).reshape(len(queries), len(table.classes), sat.size, NEAREST)
    together = [
        shared[:, :, (sat >> place) & 1 == 1].reshape(len(queries), len(table.classes), -1)
        for place in range(len(voter_sets))
    ]
    return np.array([_fewest(squares) for squares in together])


def _fewest(squares: Floats) -> Floats:
    """Return the NEAREST smallest along the last axis, in order, infinite where there are fewer."""
    missing = max(0, NEAREST - squares.shape[-1])
    return np.pad(np.sort(squares, axis=-1)[..., :NEAREST], ((0, 0), (0, 0), (0, missing)), constant_values=np.inf)


def _one_by_one(
    table: CaseTable, similarity: Similarity, present: Mask, rows: NDArray[np.intp], truth: NDArray[np.intp]
) -> tuple[Floats, NDArray[np.intp]]:
    """Return distances and classes of cases held out by themselves: all that a library of one gearbox can say."""
    everybody = [np.ones(len(table), bool)]
    queries, kin = np.where(present, table.values[rows], np.nan), [(table.sounds, table.sounds[rows])]
    found = _nearest_voters(CaseMatrix(table, similarity.metric), queries, everybody, kin)[0]
    reached = _reached(found, truth)
    return found[reached], truth[reached]


def _reached(nearest: Floats, truth: NDArray[np.intp]) -> Mask:
    """Return for which rows a case of their own class votes."""
    return np.asarray(np.isfinite(nearest[np.arange(truth.size), truth, 0]))


def _enough(seen: Floats, truth: NDArray[np.intp]) -> int:
    """Return the smallest set of voters where it judges as many measured cases as set a limit, else the largest.

    Simulated cases that seem to tell measured ones apart better still give labels to sounds of no gearbox: beside
    enough measured cases they are not listened to.
    """
    rows = np.logical_and.reduce([_reached(nearest, truth) for nearest in seen])
    return len(seen) - 1 if rows.sum() >= FEWEST_FOR_LIMIT else 0


def representative(table: CaseTable) -> NDArray[np.intp]:
    """Return the rows to hold out: measured cases if every class has some, at most LARGEST_SAMPLE, evenly spread."""
    rows = np.flatnonzero(table.origins == "measured")
    if set(table.labels[rows].tolist()) != set(table.classes):
        rows = np.arange(len(table))
    return spread_out(rows, LARGEST_SAMPLE)
