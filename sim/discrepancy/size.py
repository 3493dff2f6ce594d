"""How large a term is, and how well the data know it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from sim.discrepancy.fit import Fit
from sim.discrepancy.parameters import Values
from sim.discrepancy.terms import Term


def deviations(fit: Fit, term: Term, numbers: Callable[[Values], Mapping[str, float]]) -> dict[str, float]:
    """Standard deviation of each of `numbers`, which are made of the parameters of `term`, by small changes."""
    own = [k for k, p in enumerate(fit.parameters) if p in term.parameters]
    covariance = fit.covariance[np.ix_(own, own)]
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(spread, spread)
    centre = numbers(fit.values)
    names = [fit.parameters[k].name for k in own]
    moved = [numbers({**fit.values, n: fit.values[n] + sd}) for n, sd in zip(names, spread, strict=True)]
    out = {}
    for name, value in centre.items():
        change = np.array([m[name] - value for m in moved])
        out[name] = math.sqrt(max(float(change @ correlation @ change), 0.0))
    return out


def magnitude(term: Term, values: Values) -> float:
    """What is held against `Term.size`."""
    return abs(term.magnitude(values) if term.magnitude else next(iter(term.report(values).values())))


def beyond(term: Term, fit: Fit) -> float:
    """Standard deviations by which a term is larger than what does not matter or is as new; infinite without a name.

    For a dent either infinity: teeth may leave it before its bottom, and then how deep it is cannot be seen.
    """
    if not term.named:
        return math.inf
    excess = magnitude(term, fit.values) - term.size
    if term.mechanism == "tooth_damage":
        return math.copysign(math.inf, excess)
    deviation = deviations(fit, term, lambda values: {"size": magnitude(term, values)})["size"]
    return excess / max(deviation, 1e-6 * max(term.size, 1e-300))
