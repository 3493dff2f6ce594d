"""Posterior probability of a finding from its evidence and that of its rivals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from sim.investigation.assessment.calibration import WEIGHTS, Weights

CLOSE = math.log(3.0)  # log odds below which another name may well be meant
FORM = 0.07  # of its own gain, that something without a name would take as well where the name is right
SHARE = 0.01  # of the squared residual, where `Weights.bias` is meant


@dataclass(frozen=True)
class Evidence:
    """What the probability of a name hangs on.

    `share`: what the name takes away over what remains of the squared whitened residual; `rivals`: standard errors by
    which it does better on unseen blocks than each other term in its place; `left`: of what the name takes away, the
    part that something without a name would take as well, where that takes more besides.
    """

    share: float
    rivals: tuple[float, ...]
    left: float


def log_odds(t: float, overdispersion: float) -> float:
    """Log odds that the first of two models is the better one, at `t` standard errors between them."""
    z = t / overdispersion
    return float(log_ndtr(z) - log_ndtr(-z))


def against_rivals(rivals: Sequence[float], overdispersion: float) -> float:
    """Probability of the name among itself and the others in its place.

    >>> against_rivals([], 1.0), round(against_rivals([0.0], 1.0), 2), round(against_rivals([4.0, 1.0], 1.0), 2)
    (1.0, 0.5, 0.84)
    """
    return 1.0 / (1.0 + sum(math.exp(-log_odds(t, overdispersion)) for t in rivals))


def is_close(t: float, weights: Weights = WEIGHTS) -> bool:
    """Whether another term, `t` standard errors behind, may well be meant: it has a third of the odds."""
    return log_odds(t, weights.overdispersion) < CLOSE


def probability(evidence: Evidence, weights: Weights = WEIGHTS) -> float:
    """Probability that the name is right: a real effect, this name rather than another, and nothing larger beside it.

    The more structure the best model leaves, the less adequate it is, and the likelier is something without a name.
    """
    exists = 1.0 / (1.0 + math.exp(-existence(evidence, weights)))
    named = exists * against_rivals(evidence.rivals, weights.overdispersion)
    return float(np.clip(named, 0.01, weights.cap))


def existence(evidence: Evidence, weights: Weights = WEIGHTS) -> float:
    """Log odds that the effect is real, whichever of the names in its place it has."""
    real = (
        weights.bias
        + weights.slope * math.log(evidence.share / SHARE)
        - weights.left * math.log1p(evidence.left / FORM)
    )
    return float(np.clip(real, -30.0, 30.0))
