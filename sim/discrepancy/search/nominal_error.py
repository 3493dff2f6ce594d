"""Whether numbers that the description has wrong explain what a term would."""

from __future__ import annotations

import math

from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import FAR_BENT
from sim.discrepancy.hypotheses.friction import LEFT_OUT
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.search.criterion import least_gain

OF_LINKS = ("damping_n_m_s_per_rad", "mesh_efficiency")  # of a stage: described as well, though less well known
SURE = 10.0  # times the least gain: so much is not explained by any number


def doubted(term: Term, gain: float, problem: Problem, less: Fit, more: Fit) -> tuple[Problem, Fit] | None:
    """The description taken for wrong where it is bent far, and its fit, where `term` gains too little over that.

    `less`: the fit without the term, `more` the one with it. That a number is known so many times less well costs twice
    the logarithm of that, and of how many numbers it was looked for among. Friction that was left out is itself one.
    """
    if term.mechanism in LEFT_OUT or gain > SURE * least_gain(term):
        return None
    base = {p.name for p in problem.base()}
    described = [p for p in less.parameters if p.name in base and (p.stated or p.name.endswith(OF_LINKS))]
    far = {p.name: p.deviation(less.values) for p in described if p.name not in term.replaces}
    wrong = {name: times for name, times in far.items() if times > FAR_BENT}
    if not wrong:
        return None
    other = problem.with_inflated_prior(wrong)
    rival = other.fit(less.terms, less.values, held=less.sensitivities, to_end=True)
    price = sum(2.0 * math.log(times * len(described)) for times in wrong.values())
    return (other, rival) if rival.cost + price - more.cost < least_gain(term) else None
