"""Reuse: a distance-weighted vote of the nearest cases of every class, so that large classes do not win by size.

With the k nearest cases of class c at squared distances d_i^2, the class gets the vote mean_i exp(-b d_i^2); votes
divided by their sum are probabilities once b is calibrated.
"""

import numpy as np
from numpy.typing import NDArray

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


def nonconformity(nearest: Floats) -> Floats:
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


def log_votes(nearest: Floats, sharpness: float) -> Floats:
    """Return the logarithm of every class's share of the votes, shape (queries, classes)."""
    count = np.isfinite(nearest).sum(axis=-1)
    votes = log_sum_exp(-sharpness * nearest) - np.log(np.maximum(count, 1))
    return np.asarray(votes - log_sum_exp(votes)[..., None])


def fitted_sharpness(nearest: Floats, truth: NDArray[np.intp]) -> float:
    """Return the sharpness b under which the true classes of held-out cases are most probable.

    Half a case that is right and half a case that is wrong are added to the likelihood, so that a library that makes
    no error does not become certain.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    near = nearest[np.isfinite(nearest).any(axis=-1).sum(axis=-1) > 1]
    true = truth[np.isfinite(nearest).any(axis=-1).sum(axis=-1) > 1]
    scale = float(np.median(near[np.isfinite(near)])) if near.size else 1.0
    if not true.size or scale <= 0:
        return 1.0
    weights = balance(true)

    def loss(log_sharpness: float) -> float:
        shares = log_votes(near, float(np.exp(log_sharpness)))
        right = np.take_along_axis(shares, true[:, None], axis=1)[:, 0]
        return float(-(weights @ np.maximum(right, -50.0)) + 0.01 * (log_sharpness + np.log(scale)) ** 2)

    found = minimize_scalar(loss, bounds=(-np.log(scale) - 5, -np.log(scale) + 7), method="bounded")
    return float(min(np.exp(found.x), SHARPEST / scale))


def balance(truth: NDArray[np.intp]) -> Floats:
    """Return weights of sum 1 that give every class the same say, shape (cases,)."""
    counts = np.bincount(truth)
    weights = 1.0 / counts[truth]
    return np.asarray(weights / weights.sum())
