"""Evidence of any set of terms, by one Gram matrix of a model's sensitivities and of what each term would change.

Every term is in the model as far as a new axis has it: with a normal distribution about none, of which the size that
no new axis exceeds is four standard deviations. One that is chosen may be twelve times as large. This is variable
selection by a spike and a slab (George and McCulloch, J. Am. Statist. Assoc. 88 (1993) 881), integrated in closed form
as the picture is linear. What is not chosen is a covariance of the model's own error, and no name comes in for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from sim.discrepancy.estimation.estimate import Array, Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.hypotheses.friction import friction_felt
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.hypotheses.nonparametric import CURVES
from sim.discrepancy.hypotheses.traits import AS_NEW as AS_NEW_CURVE
from sim.discrepancy.model.parameters import Values
from sim.discrepancy.parallel import each
from sim.discrepancy.search.model_evidence import AS_NEW, FAULT, directions, excess_of, share_as_new, told_by
from sim.discrepancy.search.score_test import start_of
from sim.torsional.model import ChainError

FORM = 0.1  # of all friction, by which no law of it is wrong over speed or angle
RIDGE = 1e-10  # of a Gram matrix of columns of unit length

Jump = Mapping[str, float]


@dataclass(frozen=True)
class Start:
    """A term from one of its starts: its columns in the picture, each per one jump.

    `as_new`, shape (jumps,): share of each jump that a new axis has, a standard deviation, 0 where none is known;
    `fault`: the same of an axis that has the mechanism; `alone`: as wide as one row tells. `begun`: share that is there
    already, as a number of the description; `instead`: columns of those numbers, whose place it takes, and `relief`:
    half of the squares by which the fit bends them.
    """

    term: Term
    jumps: tuple[Jump, ...]
    at: tuple[int, ...]
    as_new: Array
    fault: Array
    alone: Array
    begun: Array
    instead: tuple[int, ...] = ()
    relief: float = 0.0


@dataclass(frozen=True)
class Posterior:
    """With a set of starts chosen: log evidence but for what is alike for all sets, and of it what the data add; share
    of each column, shape (p,); the columns that are there."""

    log_evidence: float
    drop: float
    shares: Array
    used: NDArray[np.int64]


@dataclass(frozen=True)
class LinearPicture:
    """Whitened columns, shape (rows, p): those of the fit, then those of each start.

    `slope`: of half the cost downwards over the share of each column; `precision`: of what is known of it beforehand,
    0 where nothing is; `present`: the columns that are there whatever is chosen.
    """

    problem: Problem
    fit: Fit
    columns: Array
    gram: Array
    slope: Array
    precision: Array
    present: NDArray[np.bool_]
    starts: tuple[Start, ...]
    begun: float = 0.0  # half of the squares by which the model itself is better than that of the fit

    @staticmethod
    def of(problem: Problem, fit: Fit, terms: Sequence[Term]) -> LinearPicture:
        """Of a model and of `terms`, at all their starts that can be simulated and change anything."""
        free = ~fit.at_limit
        parameters = [p for p, moves in zip(fit.parameters, free, strict=True) if moves]
        known = np.array([p.step / p.spread for p in parameters])
        off = np.array([(fit.values[p.name] - p.expected) / p.spread for p in parameters])
        columns, starts = _columns(problem, fit, terms, len(parameters))
        columns = np.hstack([fit.jacobian[:, free], columns])
        slope = -(columns.T @ fit.residual)
        slope[: known.size] -= known * off
        precision, present = np.zeros(slope.size), np.zeros(slope.size, dtype=np.bool_)
        precision[: known.size], present[: known.size] = known**2, True
        for start in starts:
            for column, deviation in zip(start.at, start.as_new, strict=True):
                if deviation > 0.0 and not start.term.contact:
                    precision[column], present[column] = deviation**-2, True
        return LinearPicture(problem, fit, columns, columns.T @ columns, slope, precision, present, tuple(starts))

    def posterior(self, chosen: Sequence[Start] = ()) -> Posterior:
        """With `chosen` as large as a fault; where teeth leave each other, as large as its jump."""
        precision, present, slope = self.precision.copy(), self.present.copy(), self.slope
        jumped = self.begun
        for start in chosen:
            columns = list(start.at)
            if start.term.contact:
                (column,) = columns
                jumped += slope[column] - 0.5 * self.gram[column, column]
                slope = slope - self.gram[:, column]
                continue
            precision[columns], present[columns] = start.fault**-2, True
            if start.instead or start.relief:
                present[list(start.instead)] = False
                pull = np.zeros(slope.size)
                pull[columns] = start.begun / start.fault**2
                slope, jumped = slope - pull, jumped + start.relief - 0.5 * float(start.begun @ pull[columns])
        used = np.flatnonzero(present)
        length = np.sqrt(np.maximum(np.diag(self.gram)[used] + precision[used], 1e-300))
        curvature = (self.gram[np.ix_(used, used)] + np.diag(precision[used])) / np.outer(length, length)
        factor = cho_factor(curvature + RIDGE * np.eye(used.size), lower=True)
        solved = cho_solve(factor, slope[used] / length) / length
        log_det = 2.0 * float(np.sum(np.log(np.diag(factor[0]))) + np.sum(np.log(length)))
        before = np.where(precision[used] > 0.0, precision[used], np.diag(self.gram)[used])  # of the data's own units
        drop = jumped + 0.5 * float(slope[used] @ solved)
        log_evidence = drop - 0.5 * (log_det - float(np.sum(np.log(before))))
        shares = np.zeros(slope.size)
        shares[used] = solved
        shares[[start.at[0] for start in chosen if start.term.contact]] = 1.0
        return Posterior(log_evidence, drop, shares, used)

    def as_large(self, start: Start, chosen: Sequence[Start]) -> Start:
        """A start whose fault is at least as large as the data have it beside what is chosen: none is too large to be
        believed (George and Foster, Biometrika 87 (2000) 731)."""
        if start.term.contact:
            return start
        loose = self.posterior([*chosen, replace(start, fault=start.alone)])
        return replace(start, fault=np.maximum(start.fault, np.abs(start.begun + loose.shares[list(start.at)])))

    def overdispersion(self, start: Start, chosen: Sequence[Start], posterior: Posterior) -> float:
        """As `model_evidence.overdispersion`, of the score of a start in the model with all that is `chosen`."""
        left = self.fit.residual + self.columns @ posterior.shares
        own = np.array(start.at)
        rest = np.setdiff1d(posterior.used, own)
        precision = self.precision.copy()
        for other in chosen:
            precision[list(other.at)] = other.fault**-2
        curvature = self.gram[np.ix_(rest, rest)] + np.diag(precision[rest])
        length = np.sqrt(np.diag(curvature))
        factor = cho_factor(curvature / np.outer(length, length) + RIDGE * np.eye(rest.size))
        absorbed = cho_solve(factor, self.gram[np.ix_(rest, own)] / length[:, None]) / length[:, None]
        pure = self.columns[:, own] - self.columns[:, rest] @ absorbed
        inner = np.asarray(np.linalg.pinv(pure.T @ pure, hermitian=True), dtype=np.float64)
        return excess_of(self.problem.measurement, pure, left, inner, self.fit.torque_rows)

    def without(self, term: Term) -> LinearPicture:
        """The same with a term of the fit put back to none, and its columns gone."""
        names = [p.name for p, limit in zip(self.fit.parameters, self.fit.at_limit, strict=True) if not limit]
        own = {p.name: p for p in term.parameters}
        back, present = np.zeros(self.slope.size), self.present.copy()
        for column, name in enumerate(names):
            if name in own:
                back[column] = (own[name].start - self.fit.values[name]) / own[name].step
                present[column] = False
        lost = float(self.slope @ back) - 0.5 * float(back @ self.gram @ back)
        return replace(self, slope=self.slope - self.gram @ back, present=present, begun=self.begun + lost)

    def values(self, start: Start, posterior: Posterior) -> dict[str, float]:
        """Numbers of the fit and those of a start as large as the picture has them."""
        term = start.term
        values = {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **self.fit.values}
        return {**values, **start_of(term, start.jumps, posterior.shares[list(start.at)], values)}

    def is_possible(self, start: Start, posterior: Posterior) -> bool:
        """Whether its numbers are such as they may be."""
        if start.term.contact:
            return True
        if start.term.positive and posterior.shares[start.at[0]] <= 0.0:
            return False
        numbers = {p.name: p for p in (*start.term.brings, *start.term.parameters)}
        for jump, column in zip(start.jumps, start.at, strict=True):
            name, value = next(iter(jump.items()))
            number = numbers[name]
            begun = self.fit.values.get(name, number.start)
            if not number.low <= begun + posterior.shares[column] * (value - begun) <= number.high:
                return False
        return True


def _columns(problem: Problem, fit: Fit, terms: Sequence[Term], first: int) -> tuple[Array, list[Start]]:
    """What each start of each term changes, shape (rows, jumps of all); their columns are counted from `first`.

    Errors of friction over speed and angle are those of friction that is there.
    """
    friction = friction_felt(problem.chain(fit.terms, fit.values), float(np.abs(problem.measurement.speed).max()))
    jobs = [(term, jumps) for term in terms for jumps in term.probes if friction or not is_curve(term)]

    def changed(job: tuple[Term, tuple[Jump, ...]]) -> Array | None:
        term, jumps = job
        values = {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **fit.values}
        try:
            made = [problem.residual((*fit.terms, term), {**values, **jump}) - fit.residual for jump in jumps]
        except ChainError:
            return None
        block = np.stack(made, axis=1)
        return block if np.isfinite(block).all() and block.any(axis=0).all() else None

    described = {p.name: p.deviation(fit.values) ** 2 for p in fit.parameters if math.isfinite(p.spread)}
    free = [p.name for p, limit in zip(fit.parameters, fit.at_limit, strict=True) if not limit]
    columns: list[Array] = []
    starts: list[Start] = []
    for (term, jumps), block in zip(jobs, each(changed, jobs), strict=True):
        if block is not None:
            curve = friction * (problem.axis.ratio if term.location == "load" else 1.0)
            new = np.array([_as_new(term, jump, fit.values, curve) for jump in jumps])
            alone = np.array([_alone(term, jump, column) for jump, column in zip(jumps, block.T, strict=True)])
            fault = np.where(new > 0.0, FAULT * new, alone)
            taken = [name for name in described if name in term.replaces]
            if taken:
                new = 0.0 * new  # the description's own numbers are as new as they are
            begun = np.array([_begun(jump, fit.values, taken) for jump in jumps])
            at = tuple(range(first, first + len(jumps)))
            instead = tuple(free.index(name) for name in taken if name in free)
            relief = 0.5 * sum(described[name] for name in taken)
            starts.append(
                Start(term, jumps, at, new / math.sqrt(directions(term)), fault, alone, begun, instead, relief)
            )
            columns.append(block)
            first += len(jumps)
    return np.hstack([np.zeros((fit.residual.size, 0)), *columns]), starts


def _as_new(term: Term, jump: Jump, values: Values, friction: float) -> float:
    """Share of a jump that is a standard deviation of what a new axis has; 0 where that is not known."""
    if is_curve(term):
        return AS_NEW * FORM * friction / abs(next(iter(jump.values())))
    return share_as_new(term, {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **values, **jump})


def _begun(jump: Jump, values: Values, taken: Sequence[str]) -> float:
    """Share of a jump that is there already where it is of a number of the description."""
    name, value = next(iter(jump.items()))
    return values[name] / (value - values[name]) if name in taken else 0.0


def is_curve(term: Term) -> bool:
    """Whether it is torque of no name over speed or angle."""
    return term.mechanism in (*CURVES, AS_NEW_CURVE) and all(math.isinf(p.spread) for p in term.parameters)


def _alone(term: Term, jump: Jump, column: Array) -> float:
    """Share of a jump by what is known of its number, else by as much as one row tells."""
    name, value = next(iter(jump.items()))
    number = next(p for p in (*term.parameters, *term.brings) if p.name == name)
    if math.isfinite(number.spread):
        return number.spread / abs(value - number.start)
    return math.sqrt(told_by(column) / float(column @ column))
