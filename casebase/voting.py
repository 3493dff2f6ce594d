"""Reuse: a distance-weighted vote of the nearest cases of every class, so that large classes do not win by size.

With the k nearest cases of class c at squared distances d_i^2, the class gets the vote mean_i (1 + b d_i^2 / a)^-a;
votes divided by their sum are probabilities once b is calibrated. The scatter that distances are held against is itself
known from few gearboxes, so the vote falls as Student's t does and not as the normal distribution: far from all cases,
which one is nearest says little. With q classes of N gearboxes in all, each class counting its own, the exponent a is
(N - q + 1) / 2; the scatters of other features of the same kind count as PRIOR_FREEDOM gearboxes more.

Source: Geisser, Posterior odds for multivariate normal classifications, J. R. Stat. Soc. B 26 (1964), the predictive
density of classes with one scatter that was estimated.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.priors import PRIOR_FREEDOM
from casebase.similarity import Floats

NEAREST = 3
"""How many cases of each class vote."""
SHARPEST = 1e4


def nearest_of_classes(squares: NDArray[np.floating], labels: NDArray[np.str_], classes: tuple[str, ...]) -> Floats:
    """Return the smallest squared distances to each class, shape (queries, classes, NEAREST), infinite where none.

    Args:
        squares: shape (queries, cases), infinite where a case may not vote.
        labels: shape (cases,).
    """
    nearest = np.full((squares.shape[0], len(classes), NEAREST), np.inf)
    for index, name in enumerate(classes):
        block = squares[:, labels == name]
        if block.shape[1] > NEAREST:
            block = np.partition(block, NEAREST - 1, axis=1)[:, :NEAREST]
        nearest[:, index, : block.shape[1]] = np.sort(block, axis=1)
    return nearest


def strangeness(nearest: Floats) -> Floats:
    """Return the mean squared distance to the voting cases of each class, shape (queries, classes)."""
    known = np.isfinite(nearest)
    count = known.sum(axis=-1)
    total = np.where(known, nearest, 0.0).sum(axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.inf)


def log_sum_exp(values: Floats) -> Floats:
    """Return log(sum(exp)) over the last axis, minus infinity of nothing (SciPy's costs ten times as much here)."""
    top = values.max(axis=-1)
    shift = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(shift + np.log(np.exp(values - shift[..., None]).sum(axis=-1)))


@dataclass(frozen=True)
class Vote:
    """How much a case says at a distance.

    Args:
        sharpness: b, how fast the vote falls near the case.
        tail: a, how slowly far from it [1]; infinite for the normal distribution.
    """

    sharpness: float
    tail: float

    def log_shares(self, nearest: Floats) -> Floats:
        """Return the logarithm of every class's share of the votes, shape (queries, classes).

        Args:
            nearest: squared distances, shape (queries, classes, k), infinite where there is no case.
        """
        count = np.isfinite(nearest).sum(axis=-1)
        scaled = self.sharpness * nearest
        each = -scaled if math.isinf(self.tail) else -self.tail * np.log1p(scaled / self.tail)
        votes = log_sum_exp(each) - np.log(np.maximum(count, 1))
        return np.asarray(votes - log_sum_exp(votes)[..., None])


def tail_of(labels: NDArray[np.str_], groups: NDArray[np.str_]) -> float:
    """Return the exponent of votes whose scatter is known from cases, labels and gearboxes of shape (cases,)."""
    classes = np.unique(labels)
    independent = sum(np.unique(groups[labels == name]).size - 1 for name in classes)
    return (independent + 1 + PRIOR_FREEDOM) / 2


def fitted_vote(nearest: Floats, truth: NDArray[np.intp], tail: float = math.inf) -> Vote:
    """Return the vote under which the true classes of held-out cases are most probable.

    Half a case that is right and half a case that is wrong are added to the likelihood, so that a library that makes
    no error does not become certain.

    Args:
        nearest: squared distances, shape (cases, classes, k).
        truth: class of each, shape (cases,).
        tail: see `tail_of`.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    near = nearest[np.isfinite(nearest).any(axis=-1).sum(axis=-1) > 1]
    true = truth[np.isfinite(nearest).any(axis=-1).sum(axis=-1) > 1]
    scale = float(np.median(near[np.isfinite(near)])) if near.size else 1.0
    if not true.size or scale <= 0:
        return Vote(1.0, tail)
    weights = balance(true)

    def loss(log_sharpness: float) -> float:
        shares = Vote(float(np.exp(log_sharpness)), tail).log_shares(near)
        right = np.take_along_axis(shares, true[:, None], axis=1)[:, 0]
        return float(-(weights @ np.maximum(right, -50.0)) + 0.01 * (log_sharpness + np.log(scale)) ** 2)

    found = minimize_scalar(loss, bounds=(-np.log(scale) - 5, -np.log(scale) + 7), method="bounded")
    return Vote(float(min(np.exp(found.x), SHARPEST / scale)), tail)


def balance(truth: NDArray[np.intp]) -> Floats:
    """Return weights of sum 1 that give every class the same say, shape (cases,)."""
    counts = np.bincount(truth)
    weights = 1.0 / counts[truth]
    return np.asarray(weights / weights.sum())
