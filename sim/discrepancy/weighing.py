"""How probable a name is: against no name, against other names in its place, and against something without a name.

Differences of squared error between two models are compared by how they scatter over blocks of rows that neither fit
has seen (Vuong, Econometrica 57 (1989) 307): where residuals are coloured, their sum alone says far too much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr

from sim.chain_model import Array
from sim.discrepancy.fit import Fit, Problem, Refits, each
from sim.discrepancy.nameless import CURVES
from sim.discrepancy.terms import Term
from sim.discrepancy.weights import WEIGHTS, Weights

BLOCKS = 15
KEPT = 0.05  # less than one block
CLOSEST = 3  # rivals that are refitted in place of a named term
LARGEST_T = 12.0
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


@dataclass(frozen=True)
class Model:
    """Terms and numbers of a fit, without its rows."""

    terms: tuple[Term, ...]
    values: Mapping[str, float]

    @staticmethod
    def of(fit: Fit) -> Model:
        return Model(fit.terms, fit.values)


@dataclass(frozen=True)
class Standing:
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

    def against(self, other: Term, t: float, model: Model) -> Standing:
        """The same where `other` is `t` standard errors behind, with the model in which it stands in its place."""
        rest = [(r, m) for r, m in zip(self.rivals, self.instead, strict=True) if r[0].key != other.key]
        rivals, instead = zip(*rest, ((other, t), model), strict=True)
        return replace(self, rivals=rivals, instead=instead)


def standings(
    problem: Problem,
    fit: Fit,
    found: Sequence[Term],
    gains: Mapping[str, float],
    rivals: Mapping[str, Sequence[tuple[Term, Mapping[str, float]]]],
) -> dict[str, Standing]:
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
        out[term.key] = Standing(gains[term.key], share, shared, against, model, models)
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
    """The fit without what has no name."""
    named = tuple(term for term in fit.terms if term.named)
    if len(named) == len(fit.terms):
        return fit
    return problem.fit(named, fit.values, held=fit.sensitivities, to_end=True)


def advantage(less: Fit, more: Fit) -> Array:
    """By how much `more` predicts blocks better that it has not seen, shape (BLOCKS - 1,).

    What is known of the description counts in equal parts with every block: a model that bends its numbers to explain
    the data is no better. The block of the largest difference is left out: what hangs on one is not known on any other.
    """
    drop = held_out_squares(less) - held_out_squares(more)
    rest = np.delete(drop, largest(drop))
    return np.asarray(rest + (less.strain - more.strain) / BLOCKS)


def gain_elsewhere(less: Fit, more: Fit) -> float:
    """What `more` gains, as it was fitted, on all blocks but the one that `advantage` leaves out."""
    out = largest(held_out_squares(less) - held_out_squares(more))
    there = [float(np.sum(fit.residual[fit.blocks(BLOCKS)[out]] ** 2)) for fit in (less, more)]
    return less.cost - more.cost - (there[0] - there[1])


def largest(drop: Array) -> int:
    """Place of the largest difference."""
    return int(np.argmax(np.abs(drop)))


def paired(drop: Array) -> float:
    """Mean over blocks in standard errors; of signed roots, as a few blocks with reversals would hide all others.

    Roots of what noise alone makes scatter by about one, however alike two models are here.
    """
    drop = drop[drop != 0.0]
    if drop.size < 4:
        return 0.0
    root = np.sign(drop) * np.sqrt(np.abs(drop))
    error = max(float(root.std(ddof=1)), 1.0) / math.sqrt(root.size)
    return float(np.clip(root.mean() / error, -LARGEST_T, LARGEST_T))


def held_out_squares(fit: Fit) -> Array:
    """Sum of squares per block of time after one linear refit on the other blocks, shape (BLOCKS,).

    A `KEPT` part of all that is known goes into every refit: the other blocks cannot be asked for what one block alone
    knows.
    """
    refits = Refits.of(fit)
    out = np.zeros(BLOCKS)
    for k, part in enumerate(fit.blocks(BLOCKS)):
        columns, rows = refits.jacobian[part], fit.residual[part]
        out[k] = float(np.sum((rows + columns @ refits.steps(columns, rows, KEPT)) ** 2))
    return out


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
