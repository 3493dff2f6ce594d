"""How probable a name is: against no name, against other names in its place, and against something without a name.

Differences of squared error between two models are compared by how they scatter over blocks of rows that neither fit
has seen (Vuong, Econometrica 57 (1989) 307): where residuals are coloured, their sum alone says far too much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.hypothesis import Key, Term
from sim.investigation.hypotheses.nonparametric import CURVES
from sim.investigation.parallel import each
from sim.investigation.search.held_out_blocks import advantage, paired

CLOSEST = 3  # rivals that are refitted in place of a named term


@dataclass(frozen=True)
class Model:
    """Terms and numbers of a fit, without its rows."""

    terms: tuple[Term, ...]
    values: Mapping[str, float]

    @staticmethod
    def of(fit: Fit) -> Model:
        return Model(fit.terms, fit.values)


@dataclass(frozen=True)
class ModelComparison:
    """A named term against the rest.

    `gain`: whitened squares that it takes away; `share`: of those that remain; `shared`: of its gain, what the terms
    without a name would take as well; `rivals`: other terms in its place, and the standard errors by which it does
    better than they on unseen blocks; `model`, `instead`: the model with it, and with each of the rivals in its place.
    """

    gain: float
    share: float
    shared: float
    rivals: tuple[tuple[Term, float], ...]
    model: Model
    instead: tuple[Model, ...]

    def against(self, other: Term, t: float, model: Model) -> ModelComparison:
        """The same where `other` is `t` standard errors behind, with the model in which it stands in its place."""
        rest = [(r, m) for r, m in zip(self.rivals, self.instead, strict=True) if r[0].key != other.key]
        rivals, instead = zip(*rest, ((other, t), model), strict=True)
        return replace(self, rivals=rivals, instead=instead)


def standings(
    problem: Problem,
    fit: Fit,
    found: Sequence[Term],
    gains: Mapping[Key, float],
    rivals: Mapping[Key, Sequence[tuple[Term, Mapping[str, float]]]],
) -> dict[Key, ModelComparison]:
    """How each of the terms `found` in `fit` stands; `rivals`: terms and numbers that were tried when it came in."""
    plain = named_alone(problem, fit)
    model = Model.of(plain)
    beyond = max((gains[t.key] for t in fit.terms if t.mechanism in CURVES), default=0.0)
    out = {}
    for term in found:
        shared = 0.0
        if beyond:
            rest = tuple(t for t in fit.terms if t is not term)
            less = problem.fit(rest, fit.values, held=fit.sensitivities)
            shared = min(beyond, max(0.0, gains[term.key] - (less.cost - fit.cost)))
        present = {t.key for t in plain.terms}
        tried = [r for r in rivals.get(term.key, ()) if r[0].key not in present][:CLOSEST]

        def instead(rival: tuple[Term, Mapping[str, float]], term: Term = term) -> Fit | None:
            other, values = rival
            return in_place(problem, plain, term, other, (values, own_of(term, other, values)))

        fits = [(r[0], f) for r, f in zip(tried, each(instead, tried), strict=True) if f]
        against = tuple((other, paired(advantage(f, plain))) for other, f in fits)
        models = tuple(Model.of(f) for _, f in fits)
        share = gains[term.key] / fit.misfit
        out[term.key] = ModelComparison(gains[term.key], share, shared, against, model, models)
    return out


def in_place(problem: Problem, fit: Fit, term: Term, other: Term, starts: Sequence[Mapping[str, float]]) -> Fit | None:
    """`fit` with `other` in place of `term`, the best from `starts`, None where that cannot be simulated."""
    terms = (*(t for t in fit.terms if t is not term), other)
    return problem.best(terms, [({**fit.values, **start}, fit.sensitivities) for start in starts])


def own_of(term: Term, other: Term, values: Mapping[str, float]) -> dict[str, float]:
    """Of the numbers with which `other` was tried, its own and those of which `term` takes the place."""
    own = {p.name for p in other.parameters} | set(term.replaces)
    return {name: value for name, value in values.items() if name in own}


def named_alone(problem: Problem, fit: Fit) -> Fit:
    """The fit without what has no name, but for what every axis has."""
    named = tuple(term for term in fit.terms if term.named or term.traits.in_every_axis)
    if len(named) == len(fit.terms):
        return fit
    return problem.fit(named, fit.values, held=fit.sensitivities, to_end=True)
