"""Which terms the data ask for, by one score: the evidence of the model with them.

All terms are ranked at once in the linear picture; the best set of it, and by itself what no linear picture shows, are
fitted by simulation; what the score does not want is taken away again. Until nothing raises it.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.discrepancy.data.controller_law import DriveLaw
from sim.discrepancy.data.preprocessing import MOTION_CUT_HZ, STANDSTILL_SHARE, gaussian_kernel
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import BENT, look_closely, multistart, rewhiten
from sim.discrepancy.estimation.whitening import LONG, Noise
from sim.discrepancy.hypotheses.hypothesis import Key, Term
from sim.discrepancy.hypotheses.traits import AS_NEW
from sim.discrepancy.model.parameters import Values
from sim.discrepancy.parallel import each
from sim.discrepancy.search.comparison import Model, ModelComparison
from sim.discrepancy.search.effect_size import beyond
from sim.discrepancy.search.linear_picture import LinearPicture, Start, is_curve
from sim.discrepancy.search.model_evidence import as_new, log_odds, occam, overdispersion, prior, wald
from sim.discrepancy.search.proposals import as_described, candidates_of, settled
from sim.discrepancy.search.search import Selection, is_said

Progress = Callable[[str, float], None]
ROUNDS = 8
MOST_TERMS = 8
AT_ONCE = 4  # terms that come in together
LOOKED_AT = 10  # starts whose overdispersion is looked at, the most promising first
FITTED = 3  # terms of one kind that no linear picture shows, fitted in one round
RIVALS = 3
SURE = 100.0  # log odds by the curvature alone, beyond which no fit without a term is asked
NONLINEAR = -5.0  # log odds in the linear picture from which what is far from linear is fitted
SAY = bool(os.environ.get("SAY"))


def say(*a: object) -> None:
    if SAY:
        print(*a, file=sys.stderr, flush=True)


Ranked = tuple[float, Start]


@dataclass
class State:
    """The model so far, with what each term gains and its log odds."""

    problem: Problem
    fit: Fit
    gains: Mapping[Key, float] = field(default_factory=dict)
    odds: Mapping[Key, float] = field(default_factory=dict)


def select(problem: Problem, base: Fit, progress: Progress, law: DriveLaw | None = None) -> Selection:
    """The model of most evidence, begun with short noise, ended with slow noise and the rows at rest."""
    state = State(*with_friction(problem, base))
    while advance(state, in_band=True):
        progress("candidates in the band of the motion", 0.2)
    for step in range(ROUNDS):
        progress(f"candidates, round {step + 1}", 0.25 + 0.07 * step)
        if advance(state):
            continue
        if state.problem.memory == LONG:
            break
        state.problem, state.fit = look_closely(state.problem, state.fit)
    if state.problem.memory != LONG:
        state.problem, state.fit = look_closely(state.problem, state.fit)
    prune(state, every=True)
    return selection_of(state, base)


def advance(state: State, *, in_band: bool = False) -> bool:
    """Let in or exchange what raises the evidence most; whether anything did.

    `in_band`: of every frequency of the motion alike. Noise that is taken without a large cause holds it.
    """
    problem, fit = in_the_band(state.problem, state.fit) if in_band else (state.problem, state.fit)
    picture = LinearPicture.of(problem, fit, candidates_of(problem, fit, None, dented=True))
    jobs = moves(problem, picture)
    say("columns", picture.columns.shape, "runs", problem.runs.count, "moves", [[str(t.key) for t in terms] for terms, _ in jobs])

    tried = []
    for terms, values in jobs:
        held = {} if any(t.contact for t in terms) else fit.sensitivities
        rough = problem.best(terms, [(values, held)], to_end=False)
        tried += [rough] if rough else []
    say("  refits", [([str(t.key) for t in f.terms], round(cost(problem, f))) for f in tried], "now", round(cost(problem, fit)))
    best = min(tried, key=lambda f: cost(problem, f), default=None)
    if best is None:
        return False
    best = settled(problem, best.terms, best.values, best.sensitivities)
    if cost(problem, best) >= cost(problem, fit):
        return False
    more = State(*multistart(*rewhiten(problem, best)))
    prune(more)
    say("  now", [(str(k), round(o, 1), round(more.gains[k])) for k, o in more.odds.items()], "runs", problem.runs.count)
    if {t.key for t in more.fit.terms} == {t.key for t in fit.terms} or len(more.fit.terms) > MOST_TERMS:
        return False
    m = more.problem.measurement
    if more.problem.has_contact_loss(more.fit.terms) and (m.rests or m.standstill < STANDSTILL_SHARE):
        more.problem, more.fit = rewhiten(more.problem.down_to(STANDSTILL_SHARE), more.fit)
    state.problem, state.fit, state.gains, state.odds = more.problem, more.fit, more.gains, more.odds
    return True


def in_the_band(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Under noise that is as loud as what a fit leaves in the band of the motion, and white in it."""
    m = problem.measurement
    taps = []
    for left, rate_hz in zip(
        problem.raw_residuals(fit.terms, fit.values), (m.rate_hz, m.rate_hz / m.load_stride), strict=True
    ):
        cut_hz = min(MOTION_CUT_HZ, 0.1 * rate_hz)
        kernel = gaussian_kernel(cut_hz, rate_hz, 0)
        level = float(np.std(np.convolve(left, kernel, "same"))) if left.size else 0.0
        alike = math.sqrt(0.5 * rate_hz / cut_hz)  # rows that the kernel makes one
        taps.append(kernel / (level * alike) if level else np.ones(1))
    plain = problem.with_noise(Noise(taps[0], taps[1]))
    return plain, plain.fit(fit.terms, fit.values, to_end=True)


def moves(problem: Problem, picture: LinearPicture) -> list[tuple[tuple[Term, ...], Values]]:
    """Models to fit, each with its numbers to begin with."""
    fit = picture.fit
    chosen, ranked = best_set(picture)
    out: list[tuple[tuple[Term, ...], Values]] = []
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
    least = NONLINEAR if chosen else 0.5 * NONLINEAR
    bent = [s for odds, s in ranked if s.term.nonlinear and odds > least and s not in chosen]
    out += [((*fit.terms, s.term), picture.values(s, picture.posterior([s]))) for s in bent[:FITTED]]
    out += [((*fit.terms, t), {**fit.values, **v}) for t, v in loosening(problem, picture, chosen)]
    return out


def best_set(picture: LinearPicture) -> tuple[list[Start], list[Ranked]]:
    """Starts whose evidence together is the largest, one after the other; and how each stood alone, best first."""
    chosen: list[Start] = []
    alone: list[Ranked] = []
    while len(chosen) < AT_ONCE:
        ranked = ranking(picture, chosen)
        alone = alone or ranked
        say("  ranked", [(str(s.term.key), round(o, 1)) for o, s in ranked[:6]])
        if not ranked or ranked[0][0] <= 0.0:
            break
        chosen.append(ranked[0][1])
    return chosen, alone


def ranking(picture: LinearPicture, chosen: Sequence[Start]) -> list[Ranked]:
    """Log odds of each start in contact on top of what is chosen, best first; two starts of a term at most."""
    before = picture.posterior(chosen).log_evidence
    present = {s.term.key for s in chosen}
    promising = []
    for start in picture.starts:
        if start.term.key not in present and not start.term.contact:
            start = picture.as_large(start, chosen)
            with_it = picture.posterior([*chosen, start])
            if picture.is_possible(start, with_it):
                promising.append((with_it.log_evidence - before + prior(start.term), start, with_it))
    promising.sort(key=lambda p: -p[0])
    looked_at: dict[Key, int] = {}
    out = []
    for odds, start, with_it in promising:
        looked_at[start.term.key] = looked_at.get(start.term.key, 0) + 1
        if looked_at[start.term.key] <= 2 and len(out) < LOOKED_AT:
            excess = picture.overdispersion(start, [*chosen, start], with_it)
            out.append((odds - (1.0 - 1.0 / excess) * max(with_it.drop - picture.posterior(chosen).drop, 0.0), start))
    return sorted(out, key=lambda r: -r[0])


def with_friction(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """With what every axis has and this description leaves out, friction above all, whatever else there may be."""
    terms = tuple(t for t in candidates_of(problem, fit, None, dented=False) if t.traits.in_every_axis)
    if not terms:
        return problem, fit
    return multistart(*rewhiten(problem, problem.fit(terms, fit.values, to_end=True)))


def exchanges(picture: LinearPicture) -> list[tuple[tuple[Term, ...], Values]]:
    """Another term in the place of each that is in, where the picture gives it more evidence."""
    out = []
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
        if start.term.contact or (is_curve(start.term) and (term.traits.in_every_axis or start.term.mechanism == AS_NEW)):
            continue
        start = gone.as_large(start, ())
        other = gone.posterior([start])
        if gone.is_possible(start, other):
            odds = own - (other.log_evidence + prior(start.term))
            if start.term.key not in best or odds < best[start.term.key][0]:
                best[start.term.key] = (odds, start)
    return sorted(best.values(), key=lambda r: r[0])


def loosening(
    problem: Problem, picture: LinearPicture, chosen: Sequence[Start]
) -> list[tuple[Term, Mapping[str, float]]]:
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
    out = [(start.term, dict(start.jumps[0])) for _, start in ranked]
    if not picture.fit.terms and (picture.fit.prior_penalty > BENT):
        gaps = {s.term.key: s.term for s in picture.starts if s.term.traits.gap}
        out += [job for term in gaps.values() for job in as_described(problem, term)]
    return out


def prune(state: State, *, every: bool = False) -> None:
    """Take away what the score does not want, the worst first; what every axis has only with `every`."""
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
        asked = [t for t in fit.terms if every or not t.traits.in_every_axis]
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
    """What is in, each mechanism with its rivals in its place and its probability among them."""
    problem, fit = state.problem, state.fit
    found = tuple(t for t in fit.terms if t.named and is_said(t, fit))
    standings: dict[Key, ModelComparison] = {}
    sure: dict[Key, float] = {}
    picture = LinearPicture.of(problem, fit, candidates_of(problem, fit, None, dented=False)) if found else None
    plain = tuple(t for t in fit.terms if t.named)
    for term in found if picture else ():
        assert picture is not None
        excess = overdispersion(problem.measurement, fit, term)
        ranked = [(odds / excess, start) for odds, start in instead_of(picture, term)[:RIVALS]]
        say("rivals of", str(term.key), [(str(s.term.key), round(o, 1)) for o, s in ranked])
        gone = picture.without(term)
        named = [(odds, s) for odds, s in ranked if s.term.named]
        models = [
            Model((*(t for t in plain if t is not term), s.term), picture.values(s, gone.posterior([s])))
            for _, s in named
        ]
        gain = state.gains[term.key]
        rivals = tuple((s.term, math.copysign(math.sqrt(2.0 * abs(odds)), odds)) for odds, s in named)
        standings[term.key] = ModelComparison(
            gain, gain / fit.misfit, 0.0, rivals, Model(plain, fit.values), tuple(models)
        )
        against = sum(math.exp(min(-odds, 50.0)) for odds, _ in ranked)
        sure[term.key] = 1.0 / (1.0 + math.exp(min(-state.odds[term.key], 50.0)) + against)
    say("end", [(str(k), round(o, 1), round(state.gains[k])) for k, o in state.odds.items()], sure.values(), problem.runs.count)
    return Selection(problem, base, fit, state.gains, {}, (), found, standings, sure)
