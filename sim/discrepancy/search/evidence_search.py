"""Which terms the data ask for, by one score: the evidence of the model with them.

All terms are ranked at once in the linear picture; the best set of it, and by itself what no linear picture shows, are
fitted by simulation; what the score does not want is taken away again. Until nothing raises it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from sim.discrepancy.data.controller_law import DriveLaw
from sim.discrepancy.data.preprocessing import STANDSTILL_SHARE
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import BENT, look_closely, multistart, noise_in_band, rewhiten
from sim.discrepancy.estimation.whitening import LONG
from sim.discrepancy.hypotheses.hypothesis import Key, Term
from sim.discrepancy.hypotheses.traits import AS_NEW, FIXED
from sim.discrepancy.model.parameters import Values
from sim.discrepancy.parallel import each
from sim.discrepancy.search.comparison import Model, ModelComparison, in_place, own_of
from sim.discrepancy.search.effect_size import beyond, magnitude
from sim.discrepancy.search.linear_picture import LinearPicture, Start, is_curve
from sim.discrepancy.search.model_evidence import (
    NAMES,
    log_odds,
    occam,
    overdispersion,
    prior,
    wald,
)
from sim.discrepancy.search.own_noise import likelier, without
from sim.discrepancy.search.proposals import Rival, as_described, bottomed, candidates_of, settled
from sim.discrepancy.search.proposals import elsewhere as in_other_meshes
from sim.discrepancy.search.search import Selection

Progress = Callable[[str, float], None]
ROUNDS, MOST_TERMS = 8, 8
AT_ONCE = 4  # terms that come in together
LOOKED_AT = 10  # starts whose overdispersion is looked at, the most promising first
FITTED, RIVALS = 3, 3  # terms that no linear picture shows, fitted in one round; others in the place of a term
ALIKE = 0.3  # of a size, by which it may change when a curve without a name comes in
SURE = 100.0  # log odds by the curvature alone, beyond which no fit without a term is asked
LIKELY = math.log(NAMES)  # nats by which a model that comes in may be less likely in the band of the motion
NONLINEAR = -5.0  # log odds in the linear picture from which what is far from linear is fitted

Ranked = tuple[float, Start]
Move = tuple[tuple[Term, ...], Values]


@dataclass
class State:
    """The model so far, with what each term gains and its log odds; `seen`: sets of terms that it has been."""

    problem: Problem
    fit: Fit
    gains: Mapping[Key, float] = field(default_factory=dict)
    odds: Mapping[Key, float] = field(default_factory=dict)
    seen: set[tuple[object, ...]] = field(default_factory=set)


def select(problem: Problem, base: Fit, progress: Progress, law: DriveLaw | None = None) -> Selection:
    """The model of most evidence, begun with short noise, ended with slow noise and the rows at rest; asks no `law`."""
    state = State(*with_friction(problem, base))
    prune(state)
    for _ in range(ROUNDS):
        progress("candidates in the band of the motion", 0.2)
        if not advance(state, in_band=True):
            break
    for step in range(ROUNDS):
        progress(f"candidates, round {step + 1}", 0.25 + 0.07 * step)
        if advance(state) or (state.problem.memory == LONG and revise(state)):
            continue
        if state.problem.memory == LONG:
            break
        state.problem, state.fit = look_closely(state.problem, state.fit)
    if state.problem.memory != LONG:
        state.problem, state.fit = look_closely(state.problem, state.fit)
    elsewhere(state)
    state.fit = bottomed(state.problem, state.fit)
    prune(state, every=True)
    return selection_of(state, base)


def advance(state: State, *, in_band: bool = False) -> bool:
    """Let in or exchange what raises the evidence most; whether anything did.

    `in_band`: of every frequency of the motion alike. Noise that is taken without a large cause holds it.
    """
    problem, fit = in_the_band(state.problem, state.fit) if in_band else (state.problem, state.fit)
    picture = LinearPicture.of(problem, fit, candidates(problem, fit, dented=True))
    tried = []
    for terms, values in moves(picture):
        held = {} if any(t.contact for t in terms) else fit.sensitivities
        rough = problem.best(terms, [(values, held)], to_end=False)
        tried += [rough] if rough else []
    best = min(tried, key=lambda f: cost(problem, f), default=None)
    if best is None:
        return False
    best = settled(problem, best.terms, best.values, best.sensitivities)
    if cost(problem, best) >= cost(problem, fit):
        return False
    more = State(*multistart(*rewhiten(problem, best)))
    prune(more)
    gained = likelier((more.problem, more.fit), (state.problem, state.fit))
    if gained < -LIKELY:
        return False
    if any(is_curve(t) for t in best.terms) and not alike(fit, more.fit):
        return False
    state.seen.add(_as_it_was(state, in_band=in_band))
    become = _as_it_was(more, in_band=in_band)
    if (become in state.seen and gained < LIKELY) or len(more.fit.terms) > MOST_TERMS:
        return False
    state.seen.add(become)
    m = more.problem.measurement
    if more.problem.has_contact_loss(more.fit.terms) and (m.rests or m.standstill < STANDSTILL_SHARE):
        more.problem, more.fit = rewhiten(more.problem.down_to(STANDSTILL_SHARE), more.fit)
    state.problem, state.fit, state.gains, state.odds = more.problem, more.fit, more.gains, more.odds
    return True


def _as_it_was(state: State, *, in_band: bool) -> tuple[object, ...]:
    """What a search that goes round in a circle comes back to."""
    return in_band, state.problem.memory, frozenset(t.key for t in state.fit.terms)


def revise(state: State) -> bool:
    """Take away a term without which the model, under noise of its own, is likelier; whether there was one.

    Noise that is taken from a model with a cause is quiet where that cause is, and nothing else is believed there.
    """
    best = (state.problem, state.fit)
    for term in state.fit.terms:
        if term.named and not term.traits.in_every_axis:
            less = without(state.problem, state.fit, term)
            if less and likelier(less, best) > LIKELY:
                best = less
    if best[1] is state.fit:
        return False
    state.seen.add(_as_it_was(state, in_band=False))
    state.problem, state.fit = best
    prune(state)
    return True


def candidates(problem: Problem, fit: Fit, *, dented: bool) -> list[Term]:
    """Terms that may come in; a line without a name was picked by the data among all that the record tells apart."""
    among = problem.measurement.samples // 2
    return [
        replace(t, among=among) if t.mechanism == FIXED else t for t in candidates_of(problem, fit, None, dented=dented)
    ]


def in_the_band(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Under noise that is as loud as what a fit leaves in the band of the motion, and white in it."""
    plain = problem.with_noise(noise_in_band(problem, fit, independent=True))
    return plain, plain.fit(fit.terms, fit.values, to_end=True)


def alike(fit: Fit, more: Fit) -> bool:
    """Whether all that has a name is still there, of about its size: else a curve stands in its place."""
    there = {t.key: t for t in more.terms}
    named = [t for t in fit.terms if t.named]
    sizes = [(magnitude(t, fit.values), magnitude(t, more.values)) for t in named if t.key in there]
    return len(sizes) == len(named) and all(abs(b - a) <= ALIKE * a for a, b in sizes)


def moves(picture: LinearPicture) -> list[Move]:
    """Models to fit, each with its numbers to begin with."""
    fit = picture.fit
    chosen, ranked = best_set(picture)
    out: list[Move] = []
    if chosen:
        posterior = picture.posterior(chosen)
        values = dict(fit.values)
        for start in chosen:
            told = picture.values(start, posterior)
            names = {p.name for p in (*start.term.brings, *start.term.parameters)}
            values |= {name: told[name] for name in names}
        out.append(((*fit.terms, *(s.term for s in chosen)), values))
    else:
        out += exchanges(picture)
        out += [
            ((*fit.terms, s.term), picture.values(s, picture.posterior([s])))
            for odds, s in ranking(picture, [], curves=True)[:1]
            if odds > 0.0
        ]
    least = NONLINEAR if chosen else 0.5 * NONLINEAR
    bent = [s for odds, s in ranked if s.term.nonlinear and odds > least and s not in chosen]
    out += [((*fit.terms, s.term), picture.values(s, picture.posterior([s]))) for s in bent[:FITTED]]
    out += [((*fit.terms, t), {**fit.values, **v}) for t, v in loosening(picture)]
    return out


def best_set(picture: LinearPicture) -> tuple[list[Start], list[Ranked]]:
    """Starts whose evidence together is the largest, one after the other; and how each stood alone, best first."""
    chosen: list[Start] = []
    alone: list[Ranked] = []
    while len(chosen) < AT_ONCE:
        ranked = ranking(picture, chosen)
        alone = alone or ranked
        if not ranked or ranked[0][0] <= 0.0:
            break
        chosen.append(ranked[0][1])
    return chosen, alone


def ranking(picture: LinearPicture, chosen: Sequence[Start], *, curves: bool = False) -> list[Ranked]:
    """Log odds of each start in contact on top of what is chosen, best first; two starts of a term at most. `curves`:
    those of torque without a name and no others."""
    before = picture.posterior(chosen)
    present = {s.term.key for s in chosen}
    promising = []
    for start in picture.starts:
        if start.term.key not in present and not start.term.contact and is_curve(start.term) == curves:
            start = picture.as_large(start, chosen)
            with_it = picture.posterior([*chosen, start])
            if picture.is_possible(start, with_it):
                promising.append((with_it.log_evidence - before.log_evidence + prior(start.term), start, with_it))
    promising.sort(key=lambda p: -p[0])
    looked_at: dict[Key, int] = {}
    out: list[Ranked] = []
    for odds, start, with_it in promising:
        looked_at[start.term.key] = looked_at.get(start.term.key, 0) + 1
        if looked_at[start.term.key] <= 2 and len(out) < LOOKED_AT:
            excess = picture.overdispersion(start, [*chosen, start], with_it)
            out.append((odds - (1.0 - 1.0 / excess) * max(with_it.drop - before.drop, 0.0), start))
    return sorted(out, key=lambda r: -r[0])


def with_friction(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """With what every axis has and this description leaves out, friction above all, whatever else there may be."""
    terms = tuple(t for t in candidates(problem, fit, dented=False) if t.traits.in_every_axis)
    if not terms:
        return problem, fit
    return multistart(*rewhiten(problem, problem.fit(terms, fit.values, to_end=True)))


def exchanges(picture: LinearPicture) -> list[Move]:
    """Another term in the place of each that is in, where the picture gives it more evidence."""
    out: list[Move] = []
    for term in picture.fit.terms:
        if term.traits.in_every_axis or term.contact:
            continue
        for odds, start in instead_of(picture, term)[:1]:
            if odds < 0.0 and start.term.named:
                gone = picture.without(term)
                terms = (*(t for t in picture.fit.terms if t is not term), start.term)
                out.append((terms, picture.values(start, gone.posterior([start]))))
    return out


def instead_of(picture: LinearPicture, term: Term) -> list[Ranked]:
    """Log odds of a term of the fit to each other in its place, least first; of each the likeliest start."""
    gone = picture.without(term)
    paid = occam(picture.problem, term, picture.fit)
    own = picture.posterior().log_evidence - paid + prior(term)
    best: dict[Key, Ranked] = {}
    for start in picture.starts:
        if start.term.contact or is_curve(start.term):
            continue
        start = gone.as_large(start, ())
        other = gone.posterior([start])
        if gone.is_possible(start, other):
            odds = own - (other.log_evidence + prior(start.term))
            if start.term.key not in best or odds < best[start.term.key][0]:
                best[start.term.key] = (odds, start)
    return sorted(best.values(), key=lambda r: r[0])


def loosening(picture: LinearPicture) -> list[tuple[Term, Values]]:
    """Terms by which teeth leave each other, of which no linear picture shows much.

    The best of each in the picture; where nothing is in yet and the description is bent for it, also with all else as
    described.
    """
    before = picture.posterior()
    best: dict[Key, Ranked] = {}
    for start in picture.starts:
        if start.term.contact:
            odds = picture.posterior([start]).log_evidence - before.log_evidence + prior(start.term)
            if odds > 0.0 and (start.term.key not in best or odds > best[start.term.key][0]):
                best[start.term.key] = (odds, start)
    ranked = sorted(best.values(), key=lambda r: -r[0])[:FITTED]
    out: list[tuple[Term, Values]] = [(start.term, start.jumps[0]) for _, start in ranked]
    if not picture.fit.terms and picture.fit.prior_penalty > BENT:
        gaps = {s.term.key: s.term for s in picture.starts if s.term.traits.gap}
        out += [job for term in gaps.values() for job in as_described(picture.problem, term)]
    return out


def elsewhere(state: State) -> None:
    """Play in that gear pair in which its lost motion costs least."""
    problem = state.problem
    for term in [t for t in state.fit.terms if t.traits.gap]:
        fit = state.fit
        own = {p.name: fit.values[p.name] for p in term.parameters}
        others = in_other_meshes(problem, fit, Rival(term, 0.0, own))
        fits = [in_place(problem, fit, term, r.term, [own_of(term, r.term, r.values)]) for r in others]
        state.fit = min([fit, *(f for f in fits if f)], key=lambda f: f.cost)


def prune(state: State, *, every: bool = False) -> None:
    """Take away what the score does not want, the worst first; what every axis has only with `every`, or at none."""
    while state.fit.terms:
        problem, fit = state.problem, state.fit

        def without(term: Term, problem: Problem = problem, fit: Fit = fit) -> Fit | None:
            if not term.contact and log_odds(problem, term, wald(fit, term), fit) > SURE:
                return None
            rest = tuple(t for t in fit.terms if t is not term)
            less = problem.fit(rest, fit.values, held=fit.sensitivities)
            if log_odds(problem, term, less.cost - fit.cost, fit) > SURE:
                return less
            return problem.fit(rest, less.values, held=less.sensitivities, to_end=True)

        less = dict(zip((t.key for t in fit.terms), each(without, fit.terms), strict=True))
        gains = {t.key: wald(fit, t) if (f := less[t.key]) is None else f.cost - fit.cost for t in fit.terms}
        odds = {
            t.key: log_odds(problem, t, gains[t.key], fit) if beyond(t, fit) > -math.inf else -math.inf
            for t in fit.terms
        }
        asked = [t for t in fit.terms if every or not t.traits.in_every_axis or odds[t.key] == -math.inf]
        worst = min(asked, key=lambda t: odds[t.key], default=None)
        if worst is None or odds[worst.key] > 0.0:
            state.gains, state.odds = gains, odds
            return
        rest = tuple(t for t in fit.terms if t is not worst)
        begin = less[worst.key] or fit
        state.fit = problem.fit(rest, begin.values, held=begin.sensitivities, to_end=True)
    state.gains, state.odds = {}, {}


def cost(problem: Problem, fit: Fit) -> float:
    """Minus twice the log evidence of a fit, under one noise, but for what is alike for all models."""
    return fit.cost + 2.0 * sum(occam(problem, t, fit) - prior(t) for t in fit.terms)


def selection_of(state: State, base: Fit) -> Selection:
    """What is in, each mechanism with its rivals in its place and its probability among them.

    The same mechanism at another place is no other name; what every axis has is in nobody's place.
    """
    problem, fit = state.problem, state.fit
    found = tuple(t for t in fit.terms if t.named and t.mechanism != AS_NEW and beyond(t, fit) > 0.0)
    picture = LinearPicture.of(problem, fit, candidates(problem, fit, dented=False) if found else [])
    standings = {}
    probabilities = {}
    for term in found:
        excess = overdispersion(problem.measurement, fit, term)
        others = instead_of(picture, term)[:RIVALS]
        rivals = [(odds / excess, start) for odds, start in others]
        standings[term.key] = comparison(picture, term, rivals, state.gains[term.key])
        against = sum(math.exp(min(-odds, 50.0)) for odds, s in rivals if s.term.mechanism != term.mechanism)
        probabilities[term.key] = 1.0 / (1.0 + math.exp(min(-state.odds[term.key], 50.0)) + against)
    return Selection(problem, base, fit, state.gains, {}, (), found, standings, probabilities)


def comparison(picture: LinearPicture, term: Term, rivals: Sequence[Ranked], gain: float) -> ModelComparison:
    """A term beside its named rivals, their log odds as standard errors between two models."""
    fit, gone = picture.fit, picture.without(term)
    plain = tuple(t for t in fit.terms if t.named)
    named = [(odds, start) for odds, start in rivals if start.term.named]
    models = [
        Model((*(t for t in plain if t is not term), s.term), picture.values(s, gone.posterior([s]))) for _, s in named
    ]
    apart = tuple((s.term, math.copysign(math.sqrt(2.0 * abs(odds)), odds)) for odds, s in named)
    return ModelComparison(gain, gain / fit.misfit, 0.0, apart, Model(plain, fit.values), tuple(models))
