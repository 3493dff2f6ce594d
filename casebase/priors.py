"""What physics says about features before a library has said anything: which ones tell faults apart.

A feature that no line here speaks of counts 1. The sentences are the reason; they are shown with the weights.
"""

import numpy as np

from casebase.similarity import Floats

PRIORS: tuple[tuple[str, float, str], ...] = ()
"""(how the feature's name begins, weight, why); the first line that fits holds."""


def prior_weights(names: tuple[str, ...]) -> Floats:
    """Return the weight of every feature before learning, shape (n,), sum 1."""
    weights = np.array([prior_of(name)[0] for name in names])
    return np.asarray(weights / weights.sum())


def prior_of(name: str) -> tuple[float, str]:
    """Return the weight of a feature and why."""
    for beginning, weight, why in PRIORS:
        if name.startswith(beginning):
            return weight, why
    return 1.0, "nothing is known of it beforehand"
