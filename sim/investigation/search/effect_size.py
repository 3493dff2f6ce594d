"""How large a term is, and how well the data know it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping

from sim import mechanisms
from sim.investigation.estimation.estimate import Fit
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.parameters import Values


def deviations(
    fit: Fit, term: Term, numbers: Callable[[Values], Mapping[str, float]], known: Collection[str] = ()
) -> dict[str, float]:
    """Standard deviation of each of `numbers`, which are made of the parameters of `term`, by small changes.

    `known`: parameters that are taken as they are.
    """
    centre = numbers(fit.values)
    slopes: dict[str, dict[str, float]] = {name: {} for name in centre}
    for parameter in term.parameters:
        step = max(fit.deviation({parameter.name: 1.0}), 1e-300)
        moved = numbers({**fit.values, parameter.name: fit.values[parameter.name] + step})
        for name, value in moved.items():
            slopes[name][parameter.name] = (value - centre[name]) / step
    return {name: fit.deviation(slope, known) for name, slope in slopes.items()}


def magnitude(term: Term, values: Values) -> float:
    """What is held against `Term.size`."""
    return abs(term.magnitude(values) if term.magnitude else next(iter(term.report(values).values())))


def makes_sense(term: Term, values: Values) -> bool:
    """Whether its numbers lie in the range that its mechanism can have at all."""
    kind = mechanisms.MECHANISMS.get(term.mechanism)
    known = {p.name: p for p in kind.parameters if not p.periodic} if kind else {}
    return all(known[name].low <= x <= known[name].high for name, x in term.report(values).items() if name in known)


def effect_size(term: Term, fit: Fit) -> float:
    """Standard deviations by which a term is larger than what does not matter or is as new; infinite without a name.

    For a dent either infinity: teeth may leave it before its bottom, and then how deep it is cannot be seen. Less than
    anything for what has no size at all. How large is asked of the shape as it was found.
    """
    if not term.named:
        return math.inf
    size = magnitude(term, fit.values)
    if size == 0.0 or not makes_sense(term, fit.values):
        return -math.inf
    excess = size - term.size
    if term.traits.dent:
        return math.copysign(math.inf, excess)
    deviation = deviations(fit, term, lambda values: {"size": magnitude(term, values)}, term.shape)["size"]
    return excess / max(deviation, 1e-6 * max(term.size, 1e-300))
