"""Feature weights learned from the library, and their score on gearboxes that they were not learned on.

The weights are those under which held-out cases are nearest to their own class: neighbourhood component analysis
with a diagonal matrix, where a case's neighbours are always cases of other gearboxes, each class counts the same, and
the logarithm of every weight is drawn towards its physical prior. How strongly it is drawn is chosen by
cross-validation over gearboxes, the stronger one when in doubt; a library too small for that keeps the priors. Where
the cases lack what the priors rest on (another kind of machine), plain band energies and even weights are tried first.

Source: Goldberger, Roweis, Hinton, Salakhutdinov, Neighbourhood Components Analysis, NIPS 17 (2004).
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from casebase.calibration import Calibration
from casebase.case_table import CaseTable
from casebase.novelty import spread_out
from casebase.priors import even_weights, prior_weights
from casebase.similarity import Floats, Metric, pooled_scales
from casebase.voting import balance, fitted_vote, log_sum_exp, nearest_of_classes

FOLDS = 10
LARGEST_SAMPLE = 160
LARGEST_LOSS = 10.0
LARGEST_BEND = 5.0
"""No weight moves by more than this factor, as a logarithm, from its prior."""
OUTGROWN = 0.05
"""Weights are learned again when the number of cases changed by more than this share, or the classes did."""
FEWEST_FOLDS = 3
"""Of two gearboxes each is judged by the other alone: that chooses no weights, and the most trusted ones stay."""
ONE_ERROR = 0.8413
"""Share of a normal distribution below one standard deviation [1]."""
BANDS = "band_level"
ENOUGH_FOR_SCALES = 20_000
"""The median of so many cases lies within a hundredth of the spread (1.25 over the root of their number) [1]."""
STRENGTHS = (1.0, 0.1, 0.01)
"""How strongly the logarithms of the weights are drawn to the priors, strongest first."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """Learned weights, those of every fold of the cross-validation, and the score.

    Args:
        metric: scales and weights learned from all cases.
        folds: per fold, the gearboxes that were held out and the weights learned without them.
        strength: how strongly the weights were drawn to the priors; None if they are the priors.
        score: share of held-out cases whose class got most votes, each class counting the same; None if the library
            is too small to say.
        reason: one sentence on how it came about.
        calibration: how sure one may be of a label; None if nothing was learned of that.
    """

    metric: Metric
    folds: tuple[tuple[frozenset[str], Floats], ...]
    strength: float | None
    score: float | None
    log_loss: float | None
    cases: int
    gearboxes: int
    classes: tuple[str, ...]
    reason: str
    calibration: Calibration | None = None

    def weights_without(self, group: str) -> Floats:
        """Return weights that were learned without this gearbox."""
        for groups, weights in self.folds:
            if group in groups:
                return weights
        return self.metric.weights

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {
            "metric": self.metric.to_document(),
            "folds": [{"groups": sorted(groups), "weights": weights.tolist()} for groups, weights in self.folds],
            "strength": self.strength,
            "score": self.score,
            "log_loss": self.log_loss,
            "cases": self.cases,
            "gearboxes": self.gearboxes,
            "classes": list(self.classes),
            "reason": self.reason,
            "calibration": None if self.calibration is None else self.calibration.to_document(),
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any], names: Sequence[str]) -> "Similarity":
        """Read it back; raises ArtifactError if it is not for these features."""
        folds = tuple(
            (frozenset(fold["groups"]), np.array(fold["weights"], dtype=np.float64)) for fold in document["folds"]
        )
        return cls(
            Metric.from_document(document["metric"], names),
            folds,
            document["strength"],
            document["score"],
            document["log_loss"],
            document["cases"],
            document["gearboxes"],
            tuple(document["classes"]),
            document["reason"],
            None if document.get("calibration") is None else Calibration.from_document(document["calibration"]),
        )

    def fits(self, table: CaseTable) -> bool:
        """Whether the library is still about the one that this was learned from."""
        return self.classes == table.classes and abs(len(table) - self.cases) <= OUTGROWN * self.cases


@dataclass(frozen=True, eq=False)
class _Sample:
    """What learning looks at: squared differences (cases, cases, n), who may vote for whom, classes, folds."""

    differences: NDArray[np.float32]
    allowed: NDArray[np.bool_]
    truth: NDArray[np.intp]
    labels: NDArray[np.str_]
    classes: tuple[str, ...]
    folds: NDArray[np.intp]
    kinds: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class _Trial:
    """Weights learned in one way without each fold, and how the cases of the fold fared under them."""

    start: str
    prior: Floats
    strength: float | None
    losses: Floats
    right: NDArray[np.bool_]
    weights: tuple[Floats, ...]

    @property
    def reason(self) -> str:
        if self.strength is None:
            return f"{self.start} scored best"
        return f"learned, drawn to {self.start} by {self.strength}"


class LearningStoppedError(Exception):
    """Learning was given up because somebody asked for it."""


def learn(table: CaseTable, stop: Event | None = None) -> Similarity:
    """Learn weights from a table of cases; deterministic.

    Raises:
        LearningStoppedError: if `stop` is set before it is done.
    """
    whole, table = table, teaching(table)
    small = too_small(table)
    if small is not None:
        return unlearned(table, small)
    metric = unlearned(table, "to start from").metric
    sample = _sampled(table, metric)
    trials: list[_Trial] = []
    for start, weights in _starts(table, metric):
        if sample.kinds.size < FEWEST_FOLDS:
            trials = [_trial(sample, start, weights, None, stop)]
            break
        trials += _trials(sample, start, weights, stop)
        if any(trial.right.all() for trial in trials):
            break
    chosen = _chosen(trials, sample.folds)
    everything = np.ones(sample.truth.size, dtype=bool)
    final = metric.with_weights(_fit(sample, everything, chosen.prior, chosen.strength))
    share = balance(sample.truth)
    return _similarity(
        whole,
        final,
        tuple(zip(_groups_of_folds(table, sample.kinds), chosen.weights, strict=True)),
        chosen.strength,
        min(1.0, float(share @ chosen.right)),
        float(share @ chosen.losses),
        chosen.reason,
    )


def teaching(table: CaseTable) -> CaseTable:
    """Return the cases to learn from: measured ones alone, where they show every class and are enough."""
    measured = table.take(table.origins == "measured")
    return measured if measured.classes == table.classes and too_small(measured) is None else table


def _starts(table: CaseTable, metric: Metric) -> list[tuple[str, Floats]]:
    """Return the weights to begin with, by name, the most trusted first.

    The physical priors rest on features that follow the motion. The colour of a sound alone is not tried where the
    cases have them: it tells a few gearboxes apart better than it tells faults. Where most of their weight is on
    features that the cases do not have, as for a machine that turns steadily, the plain distance of band energies is
    trusted first: in decibel, not scaled, so that a band in which the cases differ by much counts for much.
    """
    physics, even = ("physical priors", metric.weights), ("even weights", even_weights(table.names))
    had = np.isfinite(table.values).mean(axis=0) > 0.5
    if metric.weights[had].sum() > 0.5:
        return [physics, even]
    bands = np.array([name.startswith(BANDS) for name in table.names]) * metric.scale**2
    plain = [("plain band energies", bands / bands.sum())] if bands.any() else []
    return [*plain, even, physics]


def unlearned(table: CaseTable, reason: str) -> Similarity:
    """Return the physical priors as they are."""
    taught = teaching(table)
    taught = taught.take(spread_out(np.arange(len(taught)), ENOUGH_FOR_SCALES))
    center, scale = pooled_scales(taught.values, taught.labels)
    metric = Metric(table.names, center, scale, prior_weights(table.names))
    return _similarity(table, metric, (), None, None, None, f"physical priors: {reason}")


def too_small(table: CaseTable) -> str | None:
    """Return why nothing can be learned from this library, or None if something can."""
    if len(table.classes) < 2:
        return "there are not two classes to tell apart"
    shared = [name for name in table.classes if len(set(table.groups[table.labels == name].tolist())) >= 2]
    if len(shared) < 2:
        return "no two classes have cases from two gearboxes each"
    if len(table) < 4 * len(table.classes):
        return f"{len(table)} cases are fewer than four per class"
    return None


def _similarity(
    table: CaseTable,
    metric: Metric,
    folds: tuple[tuple[frozenset[str], Floats], ...],
    strength: float | None,
    score: float | None,
    log_loss: float | None,
    reason: str,
) -> Similarity:
    gearboxes = len(table.gearboxes_known)
    return Similarity(metric, folds, strength, score, log_loss, len(table), gearboxes, table.classes, reason)


def fold_numbers(table: CaseTable) -> NDArray[np.intp]:
    """Return the fold that every case is held out with: known gearboxes in turn, whatever else by its hash."""
    known = sorted({str(name) for name in table.gearboxes if name})
    places = {name: place % FOLDS for place, name in enumerate(known)}
    groups, group = np.unique(table.groups, return_inverse=True)
    return np.array([places.get(name, _hashed(name)) for name in groups.tolist()], dtype=np.intp)[group]


def _hashed(name: str) -> int:
    return int(hashlib.sha256(name.encode()).hexdigest()[:8], 16) % min(FOLDS, 5)


def _groups_of_folds(table: CaseTable, kinds: NDArray[np.intp]) -> list[frozenset[str]]:
    folds = fold_numbers(table)
    return [frozenset(np.unique(table.groups[folds == kind]).tolist()) for kind in kinds]


def _sampled(table: CaseTable, metric: Metric) -> _Sample:
    folds, rows = fold_numbers(table), _representative(table)
    table = table.take(rows)
    scaled = metric.scaled(table.values)
    missing = np.isnan(scaled)
    filled = np.where(missing, 0.0, scaled).astype(np.float32)
    differences = (filled[:, None, :] - filled[None, :, :]) ** 2
    differences += missing[:, None, :].astype(np.float32) + missing[None, :, :].astype(np.float32)
    same = (table.groups[:, None] == table.groups) | (table.samples[:, None] == table.samples)
    kinds, folds = np.unique(folds[rows], return_inverse=True)
    truth = np.searchsorted(table.classes, table.labels)
    return _Sample(differences, ~same, truth, table.labels, table.classes, folds, kinds)


def _representative(table: CaseTable) -> NDArray[np.intp]:
    """Return rows of at most LARGEST_SAMPLE cases: measured ones first, every class and gearbox in turn."""
    if len(table) <= LARGEST_SAMPLE:
        return np.arange(len(table))
    turn: dict[tuple[str, str], int] = {}
    keys = []
    for row in range(len(table)):
        simulated = table.origins[row] == "simulated"
        kind = (str(table.labels[row]), "" if simulated else str(table.groups[row]))
        turn[kind] = turn.get(kind, -1) + 1
        keys.append((turn[kind], simulated, row))
    return np.sort(np.array([row for *_, row in sorted(keys)[:LARGEST_SAMPLE]]))


def _trials(sample: _Sample, start: str, prior: Floats, stop: Event | None) -> list[_Trial]:
    """Learn ever more freely, until that no longer helps."""
    trials = [_trial(sample, start, prior, None, stop)]
    for strength in STRENGTHS:
        trials.append(_trial(sample, start, prior, strength, stop))
        if trials[-1].losses.mean() >= trials[-2].losses.mean():
            break
    return trials


def _trial(sample: _Sample, start: str, prior: Floats, strength: float | None, stop: Event | None) -> _Trial:
    """Learn in one way without each fold in turn."""
    losses, right = np.zeros(sample.truth.size), np.zeros(sample.truth.size, dtype=bool)
    weights = []
    for fold in range(sample.kinds.size):
        if stop is not None and stop.is_set():
            raise LearningStoppedError
        inside = sample.folds == fold
        weights.append(_fit(sample, ~inside, prior, strength))
        squares = np.where(sample.allowed, sample.differences @ weights[-1].astype(np.float32), np.inf)
        nearest = nearest_of_classes(squares, sample.labels, sample.classes)
        shares = fitted_vote(nearest[~inside], sample.truth[~inside]).log_shares(nearest[inside])
        truth = sample.truth[inside]
        losses[inside] = -np.maximum(np.take_along_axis(shares, truth[:, None], axis=1)[:, 0], -LARGEST_LOSS)
        right[inside] = shares.argmax(axis=1) == truth
    return _Trial(start, prior, strength, losses, right, tuple(weights))


def _chosen(trials: Sequence[_Trial], folds: NDArray[np.intp]) -> _Trial:
    """Return the first trial whose loss is within one standard error of the best; the first is the most careful.

    Cases of one fold share gearboxes and are no independent witnesses: the error is also taken over folds, with
    Student's factor, which asks much of few.

    Source: Breiman, Friedman, Olshen, Stone, Classification and Regression Trees (1984), the one-standard-error rule.
    """
    best = min(trials, key=lambda trial: float(trial.losses.mean()))
    kinds = np.unique(folds)
    means = np.array([float(best.losses[folds == kind].mean()) for kind in kinds])
    error = float(best.losses.std() / np.sqrt(best.losses.size))
    if kinds.size > 1:
        factor = float(special.stdtrit(kinds.size - 1, ONE_ERROR))
        error = max(error, factor * float(means.std(ddof=1) / np.sqrt(kinds.size)))
    return next(trial for trial in trials if trial.losses.mean() <= best.losses.mean() + error)


def _fit(sample: _Sample, rows: NDArray[np.bool_], prior: Floats, strength: float | None) -> Floats:
    """Return weights of sum 1 learned from some rows."""
    if strength is None:
        return prior
    from scipy.optimize import minimize  # slow to import

    inside = np.flatnonzero(rows)
    differences = sample.differences[np.ix_(inside, inside)]
    allowed = sample.allowed[np.ix_(inside, inside)]
    truth = sample.truth[inside]
    own = (truth[:, None] == truth) & allowed
    usable = own.any(axis=1) & (allowed & ~own).any(axis=1)
    if not usable.any():
        return prior
    shares = np.zeros(truth.size)
    shares[usable] = balance(truth[usable])
    counts = np.stack([(allowed & (truth == each)).sum(axis=1) for each in range(len(sample.classes))], axis=1)
    log_size = np.log(np.maximum(counts[:, truth], 1))
    free = prior > 0
    flat = differences[:, :, free].reshape(truth.size**2, -1)
    typical = float(np.median((flat @ prior[free].astype(np.float32))[allowed.ravel()]))

    def loss(parameters: Floats) -> tuple[float, Floats]:
        bend, sharp = parameters[:-1], float(np.exp(parameters[-1])) / max(typical, 1e-9)
        weights = prior[free] * np.exp(bend)
        squares = (flat @ weights.astype(np.float32)).reshape(truth.size, -1).astype(np.float64)
        exponent = np.where(allowed, -sharp * squares - log_size, -np.inf)[usable]
        mine = np.where(own[usable], exponent, -np.inf)
        all_sum, own_sum = log_sum_exp(exponent)[:, None], log_sum_exp(mine)[:, None]
        pull = np.zeros_like(squares)
        pull[usable] = shares[usable, None] * (np.exp(mine - own_sum) - np.exp(exponent - all_sum))
        slope = pull.astype(np.float32).ravel() @ flat
        gradient = np.append(
            sharp * weights * slope + 2 * strength * prior[free] * bend,
            sharp * float((pull * squares).sum()) + 0.02 * parameters[-1],
        )
        value = float(shares[usable] @ (all_sum - own_sum)[:, 0])
        return value + strength * float(prior[free] @ bend**2) + 0.01 * float(parameters[-1] ** 2), gradient

    start = np.zeros(int(free.sum()) + 1)
    bounds = [(-LARGEST_BEND, LARGEST_BEND)] * start.size
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 30})
    weights = np.zeros_like(prior)
    weights[free] = prior[free] * np.exp(found.x[:-1])
    return np.asarray(weights / weights.sum())
