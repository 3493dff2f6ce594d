"""Forward and backward by one score, in the linear picture, refitted by simulation."""

from __future__ import annotations

import itertools
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from sim.discrepancy.data.controller_law import DriveLaw
from sim.discrepancy.data.preprocessing import STANDSTILL_SHARE
from sim.discrepancy.estimation.estimate import Array, Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import BENT, look_closely, multistart, rewhiten
from sim.discrepancy.estimation.whitening import LONG
from sim.discrepancy.hypotheses.friction import friction_felt
from sim.discrepancy.hypotheses.hypothesis import Key, Term
from sim.discrepancy.hypotheses.nonparametric import CURVES
from sim.discrepancy.parallel import each
from sim.discrepancy.hypotheses.traits import AS_NEW as AS_NEW_CURVE
from sim.discrepancy.search.comparison import Model, ModelComparison
from sim.discrepancy.search.effect_size import beyond, magnitude
from sim.discrepancy.search.model_evidence import AS_NEW, FAULT, log_odds, occam, overdispersion, prior
from sim.discrepancy.search.proposals import Rival, _candidates, as_described, settled
from sim.discrepancy.search.score_test import _start
from sim.discrepancy.search.search import BEYOND, Selection, is_said
from sim.torsional.model import ChainError

Progress = Callable[[str, float], None]
ROUNDS = 8
MOST = 4
PAIRED = 8
CHECKED = 10
SURE = 100.0
NEARLY, SHARE = -5.0, 0.1
FORM = 0.1  # of all friction: no law of it is truer over speed and angle
BLOCKS = 40
SAY = bool(os.environ.get("SAY"))


def say(*a: object) -> None:
    if SAY:
        print(*a, file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Atom:
    """One start of one term: its columns in the picture."""

    term: Term
    group: tuple[Mapping[str, float], ...]
    at: tuple[int, ...]
    as_new: Array  # share of each jump that a new axis has
    slab: Array  # standard deviation of each share


@dataclass
class Picture:
    """All columns, whitened; those of the model first, then those of each atom."""

    columns: Array
    residual: Array
    precision: Array  # of the model's own
    pull: Array
    atoms: list[Atom]
    values: Mapping[str, float]
    torque_rows: int

    def __post_init__(self) -> None:
        self.gram = self.columns.T @ self.columns
        self.slope = -(self.columns.T @ self.residual)
        self.slope[: self.pull.size] -= self.pull
        own = self.precision.size
        self.own = own
        self.spike = np.zeros(self.gram.shape[0])
        self.spike[:own] = self.precision
        self.always = np.zeros(self.gram.shape[0], dtype=bool)
        self.always[:own] = True
        for atom in self.atoms:
            if atom.term.contact:
                continue
            for k, sd in zip(atom.at, atom.as_new, strict=True):
                if sd > 0.0:
                    self.spike[k] = 1.0 / sd**2
                    self.always[k] = True

    def evidence(self, chosen: Sequence[Atom]) -> tuple[float, Array, float, list[int]]:
        """Log evidence without priors of names; shares of all columns."""
        precision, there = self.spike.copy(), self.always.copy()
        slope, constant = self.slope, 0.0
        for atom in chosen:
            if atom.term.contact:
                k = atom.at[0]
                slope = slope - self.gram[:, k]
                constant -= 0.5 * (self.gram[k, k] - 2.0 * self.slope[k])
                there[k] = False
                continue
            for k, sd in zip(atom.at, atom.slab, strict=True):
                precision[k], there[k] = 1.0 / sd**2, True
        use = np.flatnonzero(there)
        scale = np.sqrt(np.maximum(np.diag(self.gram)[use] + precision[use], 1e-300))
        matrix = (self.gram[np.ix_(use, use)] + np.diag(precision[use])) / np.outer(scale, scale)
        factor = cho_factor(matrix + 1e-10 * np.eye(use.size), lower=True)
        solved = cho_solve(factor, slope[use] / scale) / scale
        square = float(slope[use] @ solved)
        logdet = 2.0 * float(np.sum(np.log(np.diag(factor[0])))) + 2.0 * float(np.sum(np.log(scale)))
        known = precision[use] > 0.0
        logdet -= sum(math.log(self.gram[k, k]) for k in use if precision[k] <= 0.0)
        occam = -0.5 * logdet + 0.5 * float(np.sum(np.log(precision[use][known])))
        shares = np.zeros(self.gram.shape[0])
        shares[use] = solved
        for atom in chosen:
            if atom.term.contact:
                shares[atom.at[0]] = 1.0
        return 0.5 * square + constant, shares, occam, list(use)

    def spread(self, atom: Atom, chosen: Sequence[Atom], shares: Array, use: list[int]) -> float:
        """Variance of the score of an atom between blocks of time over what white residuals make, at least 1."""
        left = self.residual + self.columns @ shares
        rest = [k for k in use if k not in atom.at]
        block = self.columns[:, list(atom.at)]
        precision = self.spike[rest].copy()
        for other in chosen:
            for k, sd in zip(other.at, other.slab, strict=True):
                if k in rest:
                    precision[rest.index(k)] = 1.0 / sd**2
        inner = self.gram[np.ix_(rest, rest)] + np.diag(precision)
        scale = np.sqrt(np.diag(inner))
        factor = cho_factor(inner / np.outer(scale, scale) + 1e-10 * np.eye(len(rest)))
        share = cho_solve(factor, self.gram[np.ix_(rest, list(atom.at))] / scale[:, None]) / scale[:, None]
        pure = block - self.columns[:, rest] @ share
        cuts = self._cuts()
        scores = np.array([pure[part].T @ left[part] for part in cuts])
        info = pure.T @ pure
        scores = scores - scores.mean(axis=0)
        seen = scores.T @ scores
        out = float(np.trace(np.linalg.pinv(info, hermitian=True) @ seen)) / len(atom.at)
        return max(1.0, out)

    def instead(self, fit: Fit, term: Term, atom: Atom) -> tuple[float, Array]:
        """Log odds of the model with `term`, which is in, to that with `atom` in its place; shares with the atom."""
        names = [p.name for p, follows in zip(fit.parameters, ~fit.at_limit, strict=True) if follows]
        own = [k for k, name in enumerate(names) if name in {q.name for q in term.parameters}]
        steps = {p.name: p.step for p in fit.parameters}
        start = {p.name: p.start for p in fit.parameters}
        back = np.zeros(self.gram.shape[0])
        for k in own:
            back[k] = (start[names[k]] - fit.values[names[k]]) / steps[names[k]]
        gone = Picture.__new__(Picture)
        gone.__dict__.update(self.__dict__)
        gone.slope = self.slope - self.gram @ back
        gone.always = self.always.copy()
        gone.always[own] = False
        here = self.evidence(())
        gain, shares, occam, _ = gone.evidence([atom])
        far = -0.5 * float(back @ self.gram @ back) + float(back @ self.slope)
        with_term = here[0] + here[2] - occam_of(term, fit)
        with_atom = gain + far + occam
        return with_term - with_atom + prior(term) - prior(atom.term), shares

    def _cuts(self) -> list[Array]:
        first = np.linspace(0, self.torque_rows, BLOCKS + 1).astype(int)
        second = np.linspace(self.torque_rows, self.residual.size, BLOCKS + 1).astype(int)
        return [
            np.concatenate([np.arange(first[k], first[k + 1]), np.arange(second[k], second[k + 1])])
            for k in range(BLOCKS)
        ]


def picture(problem: Problem, fit: Fit) -> Picture:
    terms = _candidates(problem, fit, None, dented=True)
    jobs = [(term, group) for term in terms for group in term.probes]

    def changed(job: tuple[Term, tuple[Mapping[str, float], ...]]) -> list[Array] | None:
        term, group = job
        values = {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **fit.values}
        out = []
        for jump in group:
            try:
                column = problem.residual((*fit.terms, term), {**values, **jump}) - fit.residual
            except ChainError:
                return None
            if not np.isfinite(column).all() or not column.any():
                return None
            out.append(column)
        return out

    made = each(changed, jobs)
    top = float(np.abs(problem.measurement.speed).max())
    friction = friction_felt(problem.chain(fit.terms, fit.values), top)
    follows = ~fit.at_limit
    own = np.array([p.step / p.spread for p in fit.parameters])[follows]
    offset = np.array([(fit.values[p.name] - p.expected) / p.spread for p in fit.parameters])[follows]
    columns = [fit.jacobian[:, follows]]
    atoms: list[Atom] = []
    at = int(follows.sum())
    for (term, group), cols in zip(jobs, made, strict=True):
        if cols is None or (term.mechanism in CURVES and not friction):
            continue
        values = {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **fit.values}
        new, slab = [], []
        limits = {p.name: p for p in term.parameters}
        for jump, column in zip(group, cols, strict=True):
            size = magnitude(term, {**values, **jump})
            sd = AS_NEW * term.size / size / math.sqrt(len(term.probes)) if size > 0.0 and math.isfinite(size) else 0.0
            if term.mechanism in CURVES:
                scale = friction * (problem.axis.ratio if term.location == "load" else 1.0)
                sd = AS_NEW * FORM * scale / abs(next(iter(jump.values())))
            square = column**2
            fault = FAULT * sd * math.sqrt(len(term.probes))
            norm = float(square.sum())
            rows = norm**2 / float(np.sum(square**2))
            wide = math.sqrt(rows / norm)
            name, value = next(iter(jump.items()))
            p = limits.get(name)
            if p is not None and math.isfinite(p.spread):
                wide = p.spread / abs(value - values[name])
            new.append(sd)
            slab.append(fault or wide)
            columns.append(column[:, None])
        atoms.append(Atom(term, group, tuple(range(at, at + len(cols))), np.array(new), np.array(slab)))
        at += len(cols)
    return Picture(
        np.hstack(columns), fit.residual, own**2, own * offset, atoms, fit.values, fit.torque_rows
    )


@dataclass(frozen=True)
class Choice:
    atoms: tuple[Atom, ...]
    score: float


def within(atom: Atom, shares: Array, values: Mapping[str, float]) -> bool:
    """Whether the numbers of a linear picture are such as they may be."""
    if atom.term.contact:
        return True
    if atom.term.positive and shares[atom.at[0]] <= 0.0:
        return False
    numbers = {q.name: q for q in (*atom.term.brings, *atom.term.parameters)}
    for jump, k in zip(atom.group, atom.at, strict=True):
        name, value = next(iter(jump.items()))
        start = values.get(name, numbers[name].start)
        if not numbers[name].low <= start + shares[k] * (value - start) <= numbers[name].high:
            return False
    return True


def score(p: Picture, chosen: Sequence[Atom], zero: tuple[float, float]) -> tuple[float, float, float, Array, list[int]]:
    square, shares, occam, use = p.evidence(chosen)
    gain = square - zero[0]
    paid = occam - zero[1]
    names = sum(prior(a.term) for a in chosen)
    if not all(within(a, shares, p.values) for a in chosen):
        return -math.inf, gain, paid, shares, use
    return gain + paid + names, gain, paid + names, shares, use


def contacts(p: Picture) -> list[tuple[float, Atom]]:
    """Atoms by which teeth leave each other, each alone, best first; of each term the best."""
    square, _, occam, _ = p.evidence(())
    zero = (square, occam)
    out: dict[Key, tuple[float, Atom]] = {}
    for atom in p.atoms:
        if atom.term.contact:
            s, gain, paid, shares, use = score(p, [atom], zero)
            if s > 0.0 and (atom.term.key not in out or out[atom.term.key][0] < s):
                out[atom.term.key] = (s, atom)
    best = sorted(out.values(), key=lambda o: -o[0])
    say("  contacts", [(str(a.term.key), round(float(s), 1)) for s, a in best[:4]])
    return best


def choose(p: Picture) -> tuple[list[Atom], list[tuple[float, Atom]]]:
    """The set of atoms of the highest score; singles by score."""
    square, _, occam, _ = p.evidence(())
    zero = (square, occam)
    best: list[Atom] = []
    best_score = 0.0
    singles: list[tuple[float, Atom]] = []
    while len(best) < MOST:
        present = {a.term.key for a in best}
        tried = []
        for atom in p.atoms:
            if atom.term.key in present or atom.term.contact:
                continue
            s, gain, paid, shares, use = score(p, [*best, atom], zero)
            tried.append((s, gain, paid, atom, shares, use))
        tried.sort(key=lambda t: -t[0])
        checked = []
        names: dict[Key, int] = {}
        for s, gain, paid, atom, shares, use in tried:
            if len(checked) == CHECKED:
                break
            if names.get(atom.term.key, 0) >= 2:
                continue
            names[atom.term.key] = names.get(atom.term.key, 0) + 1
            phi = p.spread(atom, [*best, atom], shares, use)
            before = best_score
            now = s - before if best else s
            more = gain - (score(p, best, zero)[1] if best else 0.0)
            checked.append((now - more * (1.0 - 1.0 / phi), atom, phi, more))
        checked.sort(key=lambda c: -c[0])
        if os.environ.get("WATCH"):
            w = os.environ["WATCH"]
            say("   watch", [(str(t[3].term.key), round(float(t[0]), 1), round(2*float(t[1]), 1), round(float(t[2]), 1), t[3].as_new, t[3].slab, t[4][list(t[3].at)]) for t in tried if w in str(t[3].term.key)])
        say("  singles", [(str(a.term.key), round(s, 1), "phi", round(f, 2), "gain", round(2 * g)) for s, a, f, g in checked[:6]])
        if not best:
            singles = [(s, a) for s, a, _, _ in checked]
        if checked and checked[0][0] > 0.0:
            best.append(checked[0][1])
            best_score = score(p, best, zero)[0]
            continue
        break
    return best, singles


@dataclass
class State:
    problem: Problem
    fit: Fit
    rivals: Mapping[Key, tuple[Rival, ...]] = field(default_factory=dict)
    odds: Mapping[Key, float] = field(default_factory=dict)
    gains: Mapping[Key, float] = field(default_factory=dict)


def select(problem: Problem, base: Fit, progress: Progress, law: DriveLaw | None = None) -> Selection:
    state = State(problem, base)
    say("runs", problem.runs.count, "bent", round(base.prior_penalty), "misfit", base.misfit / base.residual.size, base.residual.size)
    for step in range(ROUNDS):
        progress(f"candidates, round {step + 1}", 0.25 + 0.07 * step)
        if advance(state):
            continue
        if state.problem.memory == LONG:
            break
        state.problem, state.fit = look_closely(state.problem, state.fit)
        say("long", state.fit.misfit / state.fit.residual.size)
    if state.problem.memory != LONG:
        state.problem, state.fit = look_closely(state.problem, state.fit)
    prune(state, finally_=True)
    return selection(state, base)


def advance(state: State) -> bool:
    problem, fit = state.problem, state.fit
    p = picture(problem, fit)
    say("columns", p.columns.shape, "runs", problem.runs.count)
    best, singles = choose(p)
    shares = p.evidence(best)[1]
    start: dict[str, float] = dict(fit.values)
    for atom in best:
        values = {**{q.name: q.start for q in (*atom.term.brings, *atom.term.parameters)}, **fit.values}
        start |= values | _start(atom.term, atom.group, shares[list(atom.at)], values)
    if any(a.term.traits.in_every_axis for a in best):
        for atom in p.atoms:
            if atom.term.traits.in_every_axis and atom.term.key not in {a.term.key for a in best}:
                best.append(atom)
                start |= {q.name: q.start for q in (*atom.term.brings, *atom.term.parameters) if q.name not in start}
    say("chosen", [str(a.term.key) for a in best])
    jobs = [((*fit.terms, *(a.term for a in best)), start, fit.sensitivities)] if best else []
    strongest = max((s for s, _ in singles), default=0.0)
    for s, a in [o for o in singles if o[1].term.nonlinear and o[1].term.key not in {b.term.key for b in best}][:2]:
        if s > (NEARLY if best else 0.5 * NEARLY):
            begin = {**{q.name: q.start for q in (*a.term.brings, *a.term.parameters)}, **fit.values}
            begin |= _start(a.term, a.group, p.evidence([a])[1][list(a.at)], begin)
            jobs.append(((*fit.terms, a.term), begin, fit.sensitivities))
    jobs += [((*fit.terms, t), {**fit.values, **s}, {}) for t, s in loosening(problem, fit, p, singles)]
    tried = []
    for terms, begin, held in jobs:
        try:
            tried.append(settled(problem, terms, begin, held))
        except ChainError:
            continue
    if not tried:
        return False
    more = min(tried, key=lambda f: paid(f))
    if paid(more) >= paid(fit):
        return False
    say("  refits", [([str(t.key) for t in f.terms], round(paid(f))) for f in tried], "without", round(paid(fit)), "runs", problem.runs.count)
    wider, more = multistart(*rewhiten(problem, more))
    keep = State(wider, more, dict(state.rivals))
    prune(keep)
    old = {t.key for t in fit.terms}
    new = [t for t in more.terms if t.key in keep.odds and t.key not in old]
    say("  now", [(str(k), round(o, 1), round(keep.gains[k])) for k, o in keep.odds.items()], "runs", problem.runs.count)
    if not new:
        return False
    m = keep.problem.measurement
    if keep.problem.has_contact_loss(keep.fit.terms) and (m.rests or m.standstill < STANDSTILL_SHARE):
        keep.problem, keep.fit = rewhiten(keep.problem.down_to(STANDSTILL_SHARE), keep.fit)
    state.problem, state.fit, state.odds, state.gains = keep.problem, keep.fit, keep.odds, keep.gains
    short = []
    for s, atom in singles:
        values = {**{q.name: q.start for q in (*atom.term.brings, *atom.term.parameters)}, **fit.values}
        values = values | _start(atom.term, atom.group, p.evidence([atom])[1][list(atom.at)], values)
        short.append(Rival(atom.term, 2.0 * max(s, 0.0), values))
    state.rivals = {**state.rivals, **{t.key: tuple(short) for t in new}}
    return True


def replaced(problem: Problem, term: Term) -> Mapping[str, float]:
    """What is known beforehand of the numbers whose place a term takes."""
    return {p.name: p.spread for p in problem.base() if p.name in term.replaces}


def wald(fit: Fit, term: Term) -> float:
    """Squares that a term gains by the curvature where it is."""
    own = [k for k, p in enumerate(fit.parameters) if p.name in {q.name for q in term.parameters}]
    curved = fit._influence[0][np.ix_(own, own)]
    far = np.array([fit.values[fit.parameters[k].name] - fit.parameters[k].expected for k in own])
    return float(far @ np.linalg.pinv(curved, hermitian=True) @ far)


def paid(fit: Fit) -> float:
    """Squares and what the terms pay."""
    return fit.cost + 2.0 * sum(occam(t, fit)[0] - prior(t) for t in fit.terms)


def loosening(problem: Problem, fit: Fit, p: Picture, singles: Sequence[tuple[float, Atom]]) -> list[tuple[Term, Mapping[str, float]]]:
    """Terms by which teeth leave each other, which no linear picture shows well."""
    most = max((s for s, _ in singles), default=0.0)
    out = [(a.term, dict(a.group[0])) for s, a in contacts(p) if s > SHARE * most][:3]
    if not fit.terms and (fit.prior_penalty > BENT or fit.misfit > 2.0 * fit.residual.size):
        gaps = {a.term.key: a.term for a in p.atoms if a.term.traits.gap}
        out += [job for t in gaps.values() for job in as_described(problem, t)]
    return out


def prune(state: State, *, finally_: bool = False) -> None:
    """Take away what the score does not want, the worst first; what every axis has goes last."""
    while state.fit.terms:
        problem, fit = state.problem, state.fit

        def without(term: Term, problem: Problem = problem, fit: Fit = fit) -> Fit | float:
            rest = tuple(t for t in fit.terms if t is not term)
            known = wald(fit, term)
            if not term.contact and log_odds(term, known, fit, replaced(problem, term)) > SURE:
                return known
            less = problem.fit(rest, fit.values, 3, held=fit.sensitivities)
            if less.cost - fit.cost > 0.1 * fit.misfit:
                return less
            return problem.fit(rest, less.values, held=less.sensitivities, to_end=True)

        less = dict(zip((t.key for t in fit.terms), each(without, fit.terms), strict=True))
        gains = {key: x if isinstance(x, float) else x.cost - fit.cost for key, x in less.items()}
        odds = {
            t.key: log_odds(t, gains[t.key], fit, replaced(problem, t)) if beyond(t, fit) > -math.inf else -math.inf
            for t in fit.terms
        }
        mine = [t for t in fit.terms if finally_ or not t.traits.in_every_axis]
        worst = min(mine or fit.terms, key=lambda t: odds[t.key])
        if not mine or odds[worst.key] > 0.0:
            state.odds, state.gains = odds, gains
            return
        rest = less[worst.key]
        if isinstance(rest, float):
            rest = problem.fit(tuple(t for t in fit.terms if t is not worst), fit.values, held=fit.sensitivities)
        state.fit = problem.fit(rest.terms, rest.values, held=rest.sensitivities, to_end=True)
    state.odds, state.gains = {}, {}


def occam_of(term: Term, fit: Fit) -> float:
    return occam(term, fit)[0]


def selection(state: State, base: Fit) -> Selection:
    problem, fit = state.problem, state.fit
    found = tuple(t for t in fit.terms if t.named and is_said(t, fit))
    standing: dict[Key, ModelComparison] = {}
    sure: dict[Key, float] = {}
    p = picture(problem, fit) if found else None
    for term in found:
        assert p is not None
        phi = overdispersion(fit, term)
        best: dict[Key, tuple[float, Atom, Array]] = {}
        for atom in p.atoms:
            if atom.term.contact and not term.contact:
                continue
            if not atom.term.named and atom.term.mechanism == AS_NEW_CURVE:
                continue
            odds, shares = p.instead(fit, term, atom)
            if not math.isfinite(odds) or not within(atom, shares, p.values):
                continue
            if atom.term.key not in best or odds < best[atom.term.key][0]:
                best[atom.term.key] = (odds, atom, shares)
        ranked = sorted(best.values(), key=lambda b: b[0])[:3]
        say("rivals of", str(term.key), [(str(a.term.key), round(o / phi, 1)) for o, a, _ in ranked])
        rivals, models = [], []
        plain = tuple(t for t in fit.terms if t.named)
        for odds, atom, shares in [r for r in ranked if r[1].term.named]:
            values = {**{q.name: q.start for q in (*atom.term.brings, *atom.term.parameters)}, **fit.values}
            values |= _start(atom.term, atom.group, shares[list(atom.at)], values)
            terms = (*(t for t in plain if t is not term), atom.term)
            rivals.append((atom.term, math.copysign(math.sqrt(2.0 * abs(odds / phi)), odds)))
            models.append(Model(terms, values))
        standing[term.key] = ModelComparison(
            state.gains[term.key], state.gains[term.key] / fit.misfit, 0.0, tuple(rivals), Model(plain, fit.values), tuple(models)
        )
        against = sum(math.exp(-min(max(o / phi, -50.0), 50.0)) for o, _, _ in ranked)
        sure[term.key] = 1.0 / (1.0 + math.exp(-min(state.odds[term.key], 50.0)) + against)
    say("end", [(str(k), round(o, 1), round(state.gains[k])) for k, o in state.odds.items()], sure.values(), problem.runs.count)
    chosen = Selection(problem, base, fit, state.gains, state.rivals, (), found, standing)
    object.__setattr__(chosen, "sure", sure)
    return chosen
