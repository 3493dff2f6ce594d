"""Classifier: a multinomial logistic regression over scaled features, calibrated on gearboxes that it has not seen.

Each feature is scaled by its spread within the labels, moderated as in `casebase.reasoning.novelty`, and multiplied by
the root of its prior weight (`casebase.reasoning.priors`; even where the machine does not move to and fro): the penalty
on the coefficients is then a normal prior whose variance is that weight, so physics decides where the cases do not.
The data leave the coefficients uncertain, so
log odds shrink with the variance that this gives them: the regression is less sure where it has no cases. A feature
that a recording does not have counts as a usual one. From the answers to cases left out come

- the calibration of the leading label and of "there is a fault": logit p = offset + slope * score, both drawn weakly
  to what libraries of several machines had; no answer is surer than as many cases without an error allow (Laplace);
- the p-value of each label: how many of its own cases, left out, looked as little like it. Labels with a p-value above
  0.1 are a prediction set that holds the truth nine times in ten.

Sources: Gelman and others, A weakly informative default prior for logistic regression, Annals of Applied Statistics 2
(2008); Platt, Probabilistic outputs for support vector machines (1999); Vovk, Gammerman, Shafer, Algorithmic Learning
in a Random World (2005), label-conditional conformal prediction.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from casebase.labels import BASELINES
from casebase.reasoning.novelty import follow_motion, kinds, moderated, spread_out
from casebase.reasoning.priors import even_weights, prior_weights
from casebase.reasoning.tuning import TUNING
from casebase.search.case_table import CaseTable
from casebase.search.similarity import Floats, Metric, pooled_scales

LARGEST_SAMPLE = 800


@dataclass(frozen=True)
class Calibration:
    """How often an answer of a score is right: logit p = offset + slope * score.

    Args:
        observations: how many answers it was learned from.
    """

    offset: float = 0.0
    slope: float = 1.0
    observations: int = 0

    @property
    def most(self) -> float:
        """The largest probability that as many answers allow."""
        return 1 - 1 / (self.observations + 2)

    def probability(self, score: float) -> float:
        """Return how probable an answer of this score (log odds) is right."""
        return min(self.most, float(special.expit(self.offset + self.slope * score)))

    @classmethod
    def of(cls, scores: Floats, right: NDArray[np.bool_]) -> "Calibration":
        """Learn it from answers, shape (answers,): offset and logarithm of the slope have unit normal priors."""
        from scipy.optimize import minimize  # slow to import

        if not scores.size:
            return cls()

        def loss(parameters: Floats) -> float:
            offset, bend = parameters
            logit = offset + TUNING.usual_slope * np.exp(bend) * scores
            return float((np.logaddexp(0, logit) - right * logit).sum() + 0.5 * (offset**2 + bend**2))

        offset, bend = minimize(loss, np.zeros(2)).x
        return cls(float(offset), float(TUNING.usual_slope * np.exp(bend)), scores.size)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What the regression says of cases that it has not seen.

    Args:
        rows: of the table, shape (cases,).
        shares: of every label, shape (cases, labels).
        truth: number of the true label, shape (cases,).
    """

    classes: tuple[str, ...]
    rows: NDArray[np.intp]
    shares: Floats
    truth: NDArray[np.intp]

    def losses(self) -> Floats:
        """Return minus the log likelihood of each case, shape (cases,)."""
        own = np.take_along_axis(self.shares, self.truth[:, None], axis=1)[:, 0]
        return -np.log(np.clip(own, 1e-4, 1.0))

    def label(self) -> Calibration:
        """Return how often the leading label is right."""
        return Calibration.of(log_odds(self.shares.max(axis=1)), self.shares.argmax(axis=1) == self.truth)

    def fault(self) -> Calibration:
        """Return how often "there is a fault" or "there is none" is right, whichever leads."""
        sound = np.isin(self.classes, BASELINES)
        score, is_sound = log_odds(1 - self.shares[:, sound].sum(axis=1)), sound[self.truth]
        return Calibration.of(np.abs(score), (score > 0) != is_sound)

    def p_values(self, shares: Floats) -> Floats:
        """Return per label how many of its own cases had as small a share of it, shape (labels,)."""
        own = [self.shares[self.truth == number, number] for number in range(len(self.classes))]
        return np.array(
            [(1 + np.sum(each <= share)) / (each.size + 1) for each, share in zip(own, shares, strict=True)]
        )


def log_odds(shares: NDArray[np.floating]) -> Floats:
    """Return log odds, bounded so that rounding is not certainty."""
    return np.asarray(special.logit(np.clip(shares, 1e-6, 1 - 1e-6)), np.float64)


def weights_for(names: tuple[str, ...], values: NDArray[np.floating]) -> Floats:
    """Return prior weights of features, shape (n,): those of a motion to and fro, even ones where cases have none.

    Args:
        values: of the cases, shape (cases, n).
    """
    moves = len(values) > 0 and float(follow_motion(names, values).mean()) >= TUNING.mostly
    return prior_weights(names) if moves else even_weights(names)


class Classifier:
    """A regression over some cases of a table.

    Args:
        table: the cases, labels and gearboxes of which at least some differ.
        rows: the cases that count.
    """

    def __init__(self, table: CaseTable, rows: NDArray[np.intp]) -> None:
        of_labels = [rows[table.labels[rows] == label] for label in table.classes]
        self.rows = np.sort(np.concatenate([spread_out(each, LARGEST_SAMPLE // len(of_labels)) for each in of_labels]))
        values, labels = table.values[self.rows], table.labels[self.rows]
        self.classes = tuple(sorted(set(labels.tolist())))
        center, scale = pooled_scales(values, labels)
        kind = np.where(np.isfinite(values).any(axis=0), kinds(table.names), -1)
        scale = np.sqrt(moderated(scale**2, float(labels.size - len(self.classes)), kind))
        self._metric = Metric(table.names, center, scale, weights_for(table.names, values))
        weights = np.where(np.isfinite(values).any(axis=0), self._metric.weights, 0.0)
        self._roots = np.sqrt(weights / max(float(weights.max(initial=0.0)), 1e-12))
        self._points = self._scaled(values)
        self._truth = np.searchsorted(self.classes, labels)
        self._sounds = table.sounds[self.rows]
        self.held_out = self._held_out(table.parts[self.rows])
        self._fit = _Regression.of(self._points, self._truth)

    def labels(self, without: Sequence[int] = ()) -> tuple[str, ...]:
        """Return the labels of the cases that count, but for some rows of the table."""
        return tuple(self.classes[number] for number in np.unique(self._truth[~np.isin(self.rows, without)]))

    def shares(self, values: NDArray[np.floating], without: Sequence[int] = ()) -> Floats:
        """Return the share of every label, shape (labels,).

        Args:
            values: features of a recording, shape (n,).
            without: rows of the table that do not count, for they are the same recording.
        """
        seen = ~np.isin(self.rows, without)
        fit = self._fit if seen.all() else _Regression.of(self._points[seen], self._truth[seen])
        return np.asarray(fit.shares(self._scaled(values)[None], len(self.classes))[0], np.float64)

    def superposed(self, values: NDArray[np.floating], first: str, second: str, normal: Sequence[str]) -> float:
        """Return how probable a second fault is beside the first, which the recording has; 0 without normal cases.

        Two faults strike at their own angles, and of two sounds the louder one is what is measured: a case of both has
        each feature from the fault that is farther from normal. The same regression tells the first from both.

        Source: Nadas, Nahamoo, Picheny, Speech recognition using noise-adaptive prototypes, IEEE Trans. ASSP 37 (1989).
        """
        usual = self._points[np.isin(np.array(self.classes)[self._truth], normal)]
        ones, others = (self._points[self._truth == self.classes.index(label)] for label in (first, second))
        if not len(usual):
            return 0.0
        center = np.median(usual, axis=0)
        pairs = np.repeat(ones, len(others), axis=0), np.tile(others, (len(ones), 1))
        one, other = (each[spread_out(np.arange(len(pairs[0])), LARGEST_SAMPLE)] for each in pairs)
        both = np.where(np.abs(other - center) > np.abs(one - center), other, one)
        truth = np.repeat([0, 1], [len(ones), len(both)])
        fit = _Regression.of(np.concatenate([ones, both]), truth)
        return float(fit.shares(self._scaled(values)[None], 2)[0, 1])

    def _scaled(self, values: NDArray[np.floating]) -> Floats:
        return np.asarray(np.nan_to_num(self._metric.scaled(values)) * self._roots)

    def _held_out(self, parts: NDArray[np.intp]) -> HeldOut:
        shares = np.full((self.rows.size, len(self.classes)), np.nan)
        for part in np.unique(parts):
            asked = parts == part
            seen = ~asked & ~np.isin(self._sounds, self._sounds[asked])
            if np.unique(self._truth[seen]).size > 1:
                fit = _Regression.of(self._points[seen], self._truth[seen])
                shares[asked] = fit.shares(self._points[asked], len(self.classes))
        known = np.isfinite(shares).all(axis=1)
        return HeldOut(self.classes, self.rows[known], shares[known], self._truth[known])


@dataclass(frozen=True, eq=False)
class _Regression:
    """A multinomial logistic regression and how uncertain its log odds are.

    Args:
        classes: numbers of the labels that it has seen, shape (seen,).
        weights: intercept and coefficients of each, shape (1 + features, seen).
        covariances: of them, shape (seen, 1 + features, 1 + features).
    """

    classes: NDArray[np.intp]
    weights: Floats
    covariances: Floats

    @classmethod
    def of(cls, points: Floats, truth: NDArray[np.intp]) -> "_Regression":
        """Fit it: every label counts the same; the covariance is Laplace's, of one label against the rest."""
        from sklearn.linear_model import LogisticRegression  # slow to import

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fit = LogisticRegression(C=TUNING.strength, class_weight="balanced", max_iter=300).fit(points, truth)
        labels, counts = np.unique(truth, return_counts=True)
        weights = np.concatenate([fit.intercept_[:, None], fit.coef_], axis=1).T
        if labels.size == 2:  # one set of coefficients tells two labels apart
            weights = np.concatenate([-weights, weights], axis=1) / 2
        table = _with_one(points)
        shares = special.softmax(table @ weights, axis=1)
        balanced = (truth.size / (labels.size * counts))[np.searchsorted(labels, truth)]
        precision = np.diag(np.concatenate([[1e-2], np.full(points.shape[1], 1 / TUNING.strength)]))
        information = [(table * (balanced * share * (1 - share))[:, None]).T @ table for share in shares.T]
        return cls(labels, weights, np.linalg.inv(np.array(information) + precision))

    def shares(self, points: Floats, number: int) -> Floats:
        """Return shares of all labels, shape (points, number); none of a label that it has not seen."""
        asked = _with_one(points)
        variances = np.einsum("pi,lij,pj->pl", asked, self.covariances, asked, optimize=True)
        shares = np.zeros((len(points), number))
        shares[:, self.classes] = special.softmax(asked @ self.weights / np.sqrt(1 + np.pi / 8 * variances), axis=1)
        return shares


def _with_one(points: Floats) -> Floats:
    return np.concatenate([np.ones((len(points), 1)), points], axis=1)
