"""Of two mechanisms that explain nearly as much, which it is: held against each other under the noise of either."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import rewhiten
from sim.investigation.hypotheses.hypothesis import Key, Term
from sim.investigation.search.comparison import Model, ModelComparison, in_place, named_alone, own_of
from sim.investigation.search.criterion import LEAST_EFFECT
from sim.investigation.search.held_out_blocks import advantage, paired
from sim.investigation.search.proposals import Rival

NEARLY, MOST_NEAR = 0.7, 2  # of the gain of the best: another may be meant, under noise of its own
ALIKE = 0.5  # standard errors between two that explain alike


def near_rivals(best: Rival, tried: Sequence[Rival]) -> list[Rival]:
    """Other mechanisms of a size that matters which explain nearly as much as one that came in, teeth in contact."""
    if not best.term.named or best.term.contact or best.effect_size <= LEAST_EFFECT:
        return []
    others = (r for r in tried if r.term.named and not r.term.contact and r.term.key != best.term.key)
    return [r for r in others if r.effect_size > LEAST_EFFECT and r.gain > NEARLY * best.gain][:MOST_NEAR]


@dataclass(frozen=True)
class RivalComparison:
    """A rival in the place of a term, and noise taken from that; `t`: standard errors by which the term does better on
    unseen blocks, the mean of those under the noise of either, and no fewer than under the rival's.

    Noise that is taken from a model with the wrong one of two holds what the right one would explain, and whichever
    came in first seems to be far ahead.
    """

    t: float
    problem: Problem
    fit: Fit

    @staticmethod
    def of(problem: Problem, fit: Fit, term: Term, rival: Rival) -> RivalComparison | None:
        """None where the rival is there already, or cannot be simulated."""
        other = rival.term
        if any(t.key == other.key for t in fit.terms):
            return None
        here = in_place(problem, fit, term, other, (rival.values, own_of(term, other, rival.values)))
        if here is None:
            return None
        anew, there = rewhiten(problem, here)
        own = anew.fit(fit.terms, fit.values, to_end=True)
        by_own, by_its = paired(advantage(here, fit)), paired(advantage(there, own))
        return RivalComparison(max(0.5 * (by_own + by_its), by_its), anew, there)


NearRivals = Mapping[Key, Sequence[Rival]]


def ahead(term: Term, other: Term) -> float:
    """Standard errors by which `other` must do better to take the place: of two alike, fewer numbers have it."""
    return ALIKE * float(np.sign(len(other.parameters) - len(term.parameters)))


def exchanged(problem: Problem, fit: Fit, nearly: NearRivals) -> tuple[Problem, Fit, NearRivals]:
    """With a mechanism that explained nearly as much in the place of one that came in, where it does better by both.

    In the place of friction that the description leaves out comes none, as every axis has it.
    """
    for term in (t for t in fit.terms if not t.traits.in_every_axis):
        for rival in nearly.get(term.key, ()):
            either = RivalComparison.of(problem, fit, term, rival)
            if either and -either.t > ahead(term, rival.term):
                back = Rival(term, rival.gain, fit.values)
                return either.problem, either.fit, {**nearly, rival.term.key: [back]}
    return problem, fit, nearly


def under_both_noises(
    problem: Problem, fit: Fit, term: Term, standing: ModelComparison, nearly: Sequence[Rival]
) -> ModelComparison:
    """The standing also against what explained nearly as much when `term` came in, under the noise of either."""
    plain = named_alone(problem, fit)
    for rival in nearly:
        either = RivalComparison.of(problem, plain, term, rival)
        if either:
            standing = standing.against(rival.term, either.t, Model.of(either.fit))
    return standing
