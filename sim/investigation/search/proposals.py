"""Terms that may come in: proposed by the residual, screened, refitted by simulation."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from sim.description.transmission import link_stiffness
from sim.investigation.data.excitation import excitation_of
from sim.investigation.estimation.estimate import Fit, Raw, Start
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import BENT
from sim.investigation.hypotheses.catalogue import terms_of
from sim.investigation.hypotheses.gear_mesh import tooth_damage
from sim.investigation.hypotheses.hypothesis import AS_NEW_FACTOR, Key, Term, mechanisms_with
from sim.investigation.hypotheses.identifiability import missing_at
from sim.investigation.parallel import each
from sim.investigation.search.criterion import (
    evidence,
    is_relevant,
    least_gain,
)
from sim.investigation.search.effect_size import effect_size, magnitude
from sim.investigation.search.residual_proposals import changed_gain, nameless_terms, ripples, waves
from sim.investigation.search.score_test import Screened, screen
from sim.investigation.search.tooth_scan import ToothPosition, scan
from sim.mechanisms import MECHANISMS
from sim.mechanisms.mechanism import LEAST_GAIN, Need

MOST_TRIES, FEW_TRIES = 7, 3  # starts of candidates that are fitted in one round; where time is short
DEPTHS = (0.03, 0.1, 0.3)  # of the working twist, where a dent is looked for
SHIFTS = np.linspace(-1.0, 1.0, 11)  # pitches around the place that the scan proposes
CLOSE = 2  # best candidates of which those that are far from linear are refitted in full
LEFT = 0.1  # depth of a dent over the working twist
OTHER_DENTS = ((2.0, 0.5), (0.7, 1.3))  # times as deep and as wide: where its bottom is left, a fit may begin there
GROWTH = 5.0  # standard deviations by which a size may grow while its fit is finished: of 45 at -3 or less none did
FAR_MOVED = 500.0  # drop of squares at which all other numbers move far, too
LINEAR, FAR_FROM_LINEAR = 0.1, 0.03  # of the best promise: less is no rival
FAINT, FAINT_TRIES = 8.0, 4  # squares from which what noise may hide is looked at, and how many of them
LIKE_NEW = 0.5  # of the size that matters: what the linear picture makes less of is as new


@dataclass(frozen=True)
class Rival:
    """A term that was refitted in place of another or on top of the rest, and what it gained.

    `beyond`: standard deviations by which it is larger than what does not matter or is as new; `finished`: its fit on
    top of the rest, where that was finished.
    """

    term: Term
    gain: float
    values: Mapping[str, float]
    effect_size: float = math.inf
    finished: Fit | None = field(default=None, repr=False, compare=False)


Tried = tuple[Rival, Mapping[str, Raw]]
Job = tuple[Term, Mapping[str, float]]


def try_terms(
    problem: Problem, fit: Fit, only: Collection[str] | None = None, least: float = 0.0, tries: int = MOST_TRIES
) -> list[Rival]:
    """Candidates by what they gain once refitted, best first; what has no name is linear, its promise is its gain.

    `only`: mechanisms that are asked for, default all. `least`: squares that a mechanism must promise to be fitted;
    `tries`: starts of them that are.
    """
    dented = only is None or not mechanisms_with(lambda t: t.dent).isdisjoint(only)
    candidates = candidates_of(problem, fit, only, dented=dented)
    screened = screen(problem, fit, candidates)
    straight = [Rival(t, gain, {**fit.values, **start}) for gain, t, start in screened if not t.named]
    straight.sort(key=lambda r: -evidence(r.term, r.gain, fit.residual.size))
    jobs = _promising(screened, least, tries)
    refits = each(lambda job: _tried(fit, job[0], _refitted(problem, fit, *job)), jobs)
    curve = max((r.gain for r in straight), default=0.0) if problem.measurement.doubts.size else 0.0
    rivals = _with_finished(problem, fit, [t for t in refits if t], curve)
    best: dict[Key, Rival] = {}
    for r in [*rivals, *straight]:
        best.setdefault(r.term.key, r)
    return sorted(best.values(), key=lambda r: (-r.gain, str(r.term.key)))


def candidates_of(problem: Problem, fit: Fit, only: Collection[str] | None, *, dented: bool) -> list[Term]:
    """Terms that are not in yet; what has no name is among them where all are asked for."""
    present = {term.key for term in fit.terms}
    candidates = list(terms_of(problem.axis, problem.measurement, problem.chain(fit.terms, fit.values)))
    if dented:
        candidates += damage_terms(problem, fit.terms, fit.values)
    if only is None:
        candidates += [*nameless_terms(problem, fit), *ripples(problem, fit), *waves(problem, fit)]
        candidates += changed_gain(problem, fit)
    return [t for t in candidates if t.key not in present and (only is None or t.mechanism in only)]


def _promising(screened: Sequence[Screened], least: float, tries: int) -> list[Job]:
    """Mechanisms that are worth a fit by what they promise, each with its start; most of it first."""
    jobs: list[Job] = []
    begun: dict[Key, int] = {}
    for promised, term, start in screened:
        if len(jobs) == tries:
            break
        rival = (FAR_FROM_LINEAR if term.nonlinear else LINEAR) * screened[0][0]
        if not term.named or promised < max(rival, least_gain(term), least):
            continue
        if begun.get(term.key, 0) < (2 if (term.nonlinear or term.brings) and tries == MOST_TRIES else 1):
            begun[term.key] = begun.get(term.key, 0) + 1
            jobs.append((term, start))
    return jobs


def _with_finished(problem: Problem, fit: Fit, tried: list[Tried], curve: float) -> list[Rival]:
    """What was tried, best first, those fitted to their end that may be first and are not far below what matters.

    Sensitivities change where contact is lost, where the rest moves far, and where friction comes in that may hold at
    rest. `curve`: the most that something without a name gains, which is linear and at its best at once: a mechanism
    that gains less is compared with it once it is at its best, too. Asked of a robot's joints alone: in a log of one
    joint (UR10e) Stribeck friction came in so where the model without it is likelier by 73 nats, each in its own noise.
    """
    tried.sort(key=lambda t: (-t[0].gain, str(t[0].term.key)))
    far = [
        place
        for place, (r, _) in enumerate(tried[:CLOSE])
        if r.gain > 0.3 * tried[0][0].gain
        and (r.term.nonlinear or r.term.traits.in_every_axis or r.gain > FAR_MOVED or r.gain < curve)
        and is_relevant(r.term, r.effect_size + GROWTH)
    ]
    near = [tried[place] for place in far]
    finished = each(lambda t: settled(problem, (*fit.terms, t[0].term), t[0].values, t[1]), near)
    rivals = [t[0] for t in tried]
    for place, anew in zip(far, finished, strict=True):
        rivals[place] = _rival(fit, rivals[place].term, anew, finished=anew)
    return sorted(rivals, key=lambda r: (-r.gain, str(r.term.key)))


def faint(problem: Problem, fit: Fit) -> list[Rival]:
    """Mechanisms, teeth in contact, of which noise may hide the most; fitted to their end, best first.

    Noise that is taken from a fit without a cause holds what that cause does. One that gains nothing in its own fit
    ended in a worse valley, and all that is held against it there looks worse still.
    """
    present = {term.key for term in fit.terms}
    candidates = [
        t
        for t in terms_of(problem.axis, problem.measurement, problem.chain(fit.terms, fit.values))
        if t.key not in present and not t.contact and not t.traits.like_noise
    ]
    jobs: dict[Key, tuple[Term, Start]] = {}
    for promised, term, start in screen(problem, fit, candidates):
        if promised >= FAINT and len(jobs) < FAINT_TRIES and magnitude(term, start) > LIKE_NEW * term.size:
            jobs.setdefault(term.key, (term, ({**fit.values, **start}, fit.sensitivities)))
    fits = each(lambda job: problem.best((*fit.terms, job[0]), [job[1]]), jobs.values())
    rivals = [_rival(fit, more.terms[-1], more, finished=more) for more in fits if more]
    return sorted((r for r in rivals if r.gain > FAINT), key=lambda r: (-r.gain, str(r.term.key)))


def _rival(fit: Fit, term: Term, more: Fit, finished: Fit | None = None) -> Rival:
    return Rival(term, fit.cost - more.cost, more.values, effect_size(term, more), finished)


def _tried(fit: Fit, term: Term, more: Fit | None) -> Tried | None:
    """What is left to know of a fit with `term`, and what to go on from: fits of all candidates at once are large."""
    return None if more is None else (_rival(fit, term, more), more.sensitivities)


def settled(
    problem: Problem, terms: Sequence[Term], values: Mapping[str, float], held: Mapping[str, Raw] = MappingProxyType({})
) -> Fit:
    """A finished fit, or one that starts from what is described where that is better.

    Numbers that were bent to stand for a missing mechanism may keep a fit in a valley of their own; a dent that teeth
    leave before its bottom may be deeper and narrower as well, or shallower and wider.
    """
    fit = problem.fit(terms, values, held=held, to_end=True)
    starts: list[Start] = [(fit.own, {})] if fit.prior_penalty > BENT else []
    for term in terms:
        if term.traits.dent:
            starts += [({**fit.own, **other}, {}) for other in _other_dents(term, fit.own)]
    rough = any(t.contact for t in terms)
    other = problem.best(terms, starts, to_end=rough)
    if other is None or other.cost >= fit.cost:
        return fit
    return other if rough else problem.fit(terms, other.values, held=other.sensitivities, to_end=True)


def _other_dents(term: Term, values: Mapping[str, float]) -> list[dict[str, float]]:
    """Numbers of dents that leave contact about as long as the one found, where its bottom is left."""
    depth, *_, form = term.parameters
    if values[depth.name] <= LEFT * depth.high:
        return []
    return [_reshaped(term, values, deeper, wider, form.start) for deeper, wider in OTHER_DENTS]


def _reshaped(term: Term, values: Mapping[str, float], deeper: float, wider: float, bulge: float) -> dict[str, float]:
    """Numbers of a dent so many times as deep and as wide, of another form."""
    depth, _, width, form = (p.name for p in term.parameters)
    return {depth: deeper * values[depth], width: wider * values[width], form: bulge}


def _refitted(problem: Problem, fit: Fit, term: Term, start: Mapping[str, float]) -> Fit | None:
    """The model with one more term, or None where it cannot be simulated; from what is described where `fit` bends it.

    What is bent stands for the term, and moves back too slowly. A jump as large as the linear picture says may lead to
    where no step is any better: then from none of it. Friction that was left out: from both, by sensitivities of its
    own, as all others hang on it.
    """
    terms = (*fit.terms, term)
    values = {**fit.values, **start}
    if term.traits.in_every_axis:
        return problem.best(terms, [(values, {}), (fit.values, {})])
    starts: list[Start] = [(values, fit.sensitivities)]
    if fit.prior_penalty > BENT:
        starts.append(({p.name: values[p.name] for t in terms for p in t.parameters if p.name in values}, {}))
    best = problem.best(terms, starts, to_end=False)
    if term.contact or (best and best.cost < fit.cost):
        return best
    return problem.best(terms, [(fit.values, fit.sensitivities)], to_end=False)


def damage_terms(problem: Problem, terms: Sequence[Term], values: Mapping[str, float]) -> list[Term]:
    """Tooth damage where the scan along the wheels proposes it on top of a model, one place of each gear pair."""
    seen = excitation_of(problem.measurement)
    blind = frozenset[Need]().union(*(kind.shown_by for kind in MECHANISMS.values() if kind.traits.dent))
    stages = enumerate(problem.axis.stages)
    teeth = {
        k: s.driven_teeth for k, s in stages if s.driven_teeth and not blind & missing_at(problem.axis, seen, s.name)
    }
    if not teeth:
        return []
    best: dict[int, ToothPosition] = {}
    for place in sorted(scan(problem, terms, values, teeth), key=lambda p: -p.gain):
        best.setdefault(place.link, place)
    least = max(LEAST_GAIN, LINEAR * max((place.gain for place in best.values()), default=0.0))
    return [_damage_term(problem, place) for place in best.values() if place.gain >= least]


def _damage_term(problem: Problem, place: ToothPosition) -> Term:
    """A dent at a place, to be tried on a grid around it: contact lost makes it far from linear."""
    stage = problem.axis.stages[place.link]
    pitch = 2.0 * math.pi / (stage.driven_teeth or 1)
    level = problem.measurement.torque_rms
    ratio = problem.axis.ratio / problem.axis.ratio_from(stage.name)
    twist = level * ratio / link_stiffness(problem.axis, place.link)
    seen = 0.003 if problem.guided else 0.01  # of the twist, which is measured or not
    size = AS_NEW_FACTOR * max(stage.transmission_error_rad, seen * twist)

    starts = [(place.angle_rad + shift * pitch, share * twist) for share in DEPTHS for shift in SHIFTS]
    return tooth_damage(
        stage.name, place.link, stage.driven_teeth or 1, place.flank, place.angle_rad, starts, size, twist
    )
