"""One criterion: the posterior odds of a term in a fitted model, by Laplace's approximation.

A gain says less where the model with the term still leaves structure in the direction of the term: by the information
sandwich of White (Econometrica 50 (1982) 1), over clusters of rows (Liang and Zeger, Biometrika 73 (1986) 13) that a
wrong form errs in alike: of one time, of one angle of the load, of one speed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_array

from sim.discrepancy.data.preprocessing import Measurement
from sim.discrepancy.estimation.estimate import Array, Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.model.parameters import Values
from sim.discrepancy.search.effect_size import magnitude

AS_NEW = 0.25  # of the size that no new axis exceeds: the standard deviation of what a new one has
FAULT = 12.0  # times that: the standard deviation of a fault's
CLUSTERS = 40  # of each kind
NAMES = 40.0  # mechanisms and places among which one is looked for


def log_odds(problem: Problem, term: Term, gain: float, more: Fit) -> float:
    """Of the model `more` with a term to one without it, or with it as new, that costs `gain` squares more."""
    excess = overdispersion(problem.measurement, more, term)
    return (
        0.5 * gain / excess
        - occam(problem, term, more, excess)
        - as_new(problem, term, more, gain, excess)
        + prior(term)
    )


def prior(term: Term) -> float:
    """Log odds before the data: one of all names and places, and of all starts at which it was looked for. What every
    axis has is as likely as not."""
    if term.traits.in_every_axis:
        return 0.0
    return -math.log(NAMES * max(term.among, 1) * directions(term))


def directions(term: Term) -> int:
    """Starts of a term that are not the same one forwards and backwards."""
    return len({frozenset((name, abs(x)) for jump in jumps for name, x in jump.items()) for jumps in term.probes}) or 1


def overdispersion(m: Measurement, fit: Fit, term: Term) -> float:
    """By how much the score of a term varies more between clusters than white residuals would make it, at least 1."""
    own = _own(fit, term)
    if not own:
        return 1.0
    curved = fit.influence[0]
    steps = np.array([p.step for p in fit.parameters])
    pure = (fit.jacobian / steps) @ curved[:, own]
    return excess_of(m, pure, fit.residual, _inverse(curved[np.ix_(own, own)]), fit.torque_rows)


def excess_of(m: Measurement, directions: Array, residual: Array, inner: Array, torque_rows: int) -> float:
    """Variance of the scores of `directions` (rows, k) of clusters of rows over what white residuals make of it, at
    least 1; the largest over kinds of clusters. `inner`, shape (k, k): weighs them."""
    products = directions * residual[:, None]
    out = 1.0
    for sums in clusters(m, residual.size, torque_rows):
        scores = sums @ products
        out = max(out, float(np.einsum("ci,ij,cj->", scores, inner, scores)) / directions.shape[1])
    return out


def clusters(m: Measurement, rows: int, torque_rows: int) -> list[csr_array]:
    """Sums over the rows of one time, one angle of the load, one speed; each of shape (clusters, rows)."""
    out = []
    for state in (m.time_s, m.angle, m.speed):
        # alike wide, and not of as many rows each: noise would sort them
        edges = np.linspace(state.min(), state.max(), CLUSTERS + 1)[1:-1]
        labels = [np.searchsorted(edges, part) for part in (state, state[:: m.load_stride])]
        label = np.concatenate([labels[0], labels[1][: rows - torque_rows]])
        out.append(csr_array((np.ones(rows), (label, np.arange(rows))), shape=(CLUSTERS, rows)))
    return out


def occam(problem: Problem, term: Term, fit: Fit, excess: float = 1.0) -> float:
    """Nats by which the numbers of a term might have been elsewhere: half the log of how much wider they were before
    the data, less the same of those of the description whose place they take. A number of no known size is as wide as
    one row tells (Kass and Wasserman, J. Am. Statist. Assoc. 90 (1995) 928)."""
    sizes = sizes_as_new(term, fit.values)
    widths = {}
    paid = 0.0
    for k in _own(fit, term):
        number = fit.parameters[k]
        if math.isfinite(number.spread):
            widths[k] = number.spread
        elif number.name in sizes:
            widths[k] = max(abs(fit.values[number.name] - number.start), FAULT * sizes[number.name])
        else:
            paid += 0.5 * math.log(max(told_by(fit.jacobian[:, k]), 2.0))
    if widths:
        wide = np.array(list(widths.values()))
        known = _inverse(_covariance(fit, list(widths), excess))
        paid += 0.5 * _log_det(np.eye(wide.size) + known * np.outer(wide, wide))
    taken = {p.name: p.spread for p in problem.base() if p.name in term.replaces and math.isfinite(p.spread)}
    for k, p in enumerate(fit.parameters):
        if p.name in taken:
            paid -= 0.5 * math.log1p(taken[p.name] ** 2 / max(float(_covariance(fit, [k], excess)[0, 0]), 1e-300))
    return paid


def as_new(problem: Problem, term: Term, fit: Fit, gain: float, excess: float) -> float:
    """Log odds of a size as new to none at all, at least 0; the description's own numbers are as new as they are.

    By the curvature; where teeth leave each other, which has none to rely on, by that of a parabola that gains `gain`
    squares between none and what was found.
    """
    sizes = sizes_as_new(term, fit.values)
    sized = [k for k in _own(fit, term) if fit.parameters[k].name in sizes]
    taken = {p.name for p in problem.base()} & set(term.replaces)
    if not sized or taken:
        return 0.0
    numbers = [fit.parameters[k] for k in sized]
    at = np.array([fit.values[p.name] - p.start for p in numbers])
    covariance = np.outer(at, at) * excess / max(gain, 1.0) if term.contact else _covariance(fit, sized, excess)
    new = np.diag([sizes[p.name] ** 2 for p in numbers])
    return max(0.0, _log_normal(at, covariance + new) - _log_normal(at, covariance))


def sizes_as_new(term: Term, values: Values) -> Mapping[str, float]:
    """Standard deviation of each number that says how much, in an axis as new and of the shape as found; none of what
    has no size as new."""
    begun = {p.name: p.start for p in (*term.brings, *term.parameters)}
    shape = {name: values[name] for name in term.shape if name in values}
    out: dict[str, float] = {}
    for jump in (jump for jumps in term.probes for jump in jumps):
        name, value = next(iter(jump.items()))
        share = share_as_new(term, {**values, **begun, **jump, **shape})
        if share > 0.0:
            out[name] = abs(value - begun[name]) * share
    return out


def share_as_new(term: Term, values: Values) -> float:
    """Standard deviation of a size as new over that at `values`, 0 where either is not known."""
    size = magnitude(term, values)
    return AS_NEW * term.size / size if 0.0 < size < math.inf else 0.0


def wald(fit: Fit, term: Term) -> float:
    """Squares that a term gains by the curvature where it is (Trans. Am. Math. Soc. 54 (1943) 426)."""
    own = _own(fit, term)
    far = np.array([fit.values[fit.parameters[k].name] - fit.parameters[k].expected for k in own])
    return float(far @ _inverse(_covariance(fit, own, 1.0)) @ far)


def told_by(column: Array) -> float:
    """Rows that tell of a number, by the participation ratio of its column (rows,)."""
    square = column**2
    fourth = float(square @ square)
    return float(square.sum()) ** 2 / fourth if fourth else 1.0


def _own(fit: Fit, term: Term) -> list[int]:
    names = {p.name for p in term.parameters}
    return [k for k, p in enumerate(fit.parameters) if p.name in names]


def _covariance(fit: Fit, places: list[int], excess: float) -> Array:
    return np.asarray(excess * fit.influence[0][np.ix_(places, places)])


def _log_det(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])


def _log_normal(x: Array, covariance: Array) -> float:
    return -0.5 * (float(x @ _inverse(covariance) @ x) + _log_det(covariance))


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.pinv(matrix, hermitian=True), dtype=np.float64)
