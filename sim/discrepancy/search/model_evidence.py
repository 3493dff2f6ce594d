"""One criterion: the posterior odds of a term, by Laplace's approximation under a noise whose error is seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.discrepancy.estimation.estimate import Array, Fit
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.model.parameters import Values
from sim.discrepancy.search.effect_size import magnitude

NAMES = 40.0  # mechanisms and places among which one is looked for
AS_NEW = 1.0 / 3.0  # of the size that no new axis exceeds: the standard deviation of what a new one has
FAULT = 9.0  # times that, the standard deviation of a fault's


def overdispersion(fit: Fit, term: Term) -> float:
    """Variance of the score of `term` between blocks of time over what white residuals would make of it, at least 1.

    The information sandwich of White (Econometrica 50 (1982) 1): where the model with the term leaves structure in the
    direction of the term, what it gains says so many times less.
    """
    own = _own(fit, term)
    if not own:
        return 1.0
    curved, pulls = fit._influence
    inner = np.linalg.pinv(curved[np.ix_(own, own)], hermitian=True)
    spread = pulls[:, own].T @ pulls[:, own]
    return max(1.0, float(np.trace(inner @ spread)) / len(own))


def as_new_shares(term: Term, values: Values) -> Mapping[str, float]:
    """Of each number that says how much, what a new axis has of it; 0 where the term is of no size as new."""
    start = {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **values}
    out: dict[str, float] = {}
    for group in term.probes:
        for jump in group:
            name, value = next(iter(jump.items()))
            size = magnitude(term, {**start, **{p.name: p.start for p in term.parameters}, **jump})
            first = next(p.start for p in (*term.parameters, *term.brings) if p.name == name)
            if size > 0.0 and math.isfinite(size) and term.size > 0.0:
                out[name] = AS_NEW * abs(value - first) * term.size / size
    return out


def _own(fit: Fit, term: Term) -> list[int]:
    names = {q.name for q in term.parameters}
    return [k for k, p in enumerate(fit.parameters) if p.name in names]


def occam(term: Term, fit: Fit, replaced: Mapping[str, float] = {}) -> tuple[float, float]:
    """Nats that a term pays for the width of what its numbers might have been, and log odds that a size as new explains
    them. `replaced`: what was known of numbers whose place it takes."""
    curved = fit._influence[0] * overdispersion(fit, term)
    new = as_new_shares(term, fit.values)
    paid, spike = 0.0, 0.0
    amount: list[int] = []
    for k in _own(fit, term):
        p = fit.parameters[k]
        if math.isfinite(p.spread):
            continue
        variance = max(float(curved[k, k]), 1e-300)
        wide = FAULT * new[p.name] if new.get(p.name) else 0.0
        if wide:
            amount.append(k)
            continue
        square = fit.jacobian[:, k] ** 2
        fourth = float(np.sum(square**2))
        rows = float(np.sum(square)) ** 2 / fourth if fourth else 1.0
        paid += 0.5 * math.log(max(rows, 2.0))
    if amount:
        c = curved[np.ix_(amount, amount)]
        names = [fit.parameters[k].name for k in amount]
        theta = np.array([fit.values[n] - fit.parameters[k].start for n, k in zip(names, amount, strict=True)])
        if all(n in replaced for n in names):
            theta = np.array([fit.values[n] for n in names])
        slab = np.array([FAULT * new[n] for n in names])
        sd = np.array([new[n] for n in names])
        paid += 0.5 * _logdet(np.eye(len(amount)) + np.linalg.pinv(c, hermitian=True) * np.outer(slab, slab))
        spike = _log_normal(theta, c + np.diag(sd**2)) - _log_normal(theta, c)
    for name, spread in replaced.items():
        k = next((i for i, p in enumerate(fit.parameters) if p.name == name), None)
        if k is not None and math.isfinite(spread):
            paid -= 0.5 * math.log1p(spread**2 / max(float(curved[k, k]), 1e-300))
            spike = 0.0
    return paid, max(spike, 0.0)


def _logdet(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])


def _log_normal(x: Array, covariance: Array) -> float:
    return -0.5 * float(x @ np.linalg.pinv(covariance, hermitian=True) @ x) - 0.5 * _logdet(covariance)


def prior(term: Term) -> float:
    """Log odds of a term before the data: one of all names and places, and of all at which it was looked for."""
    if term.traits.in_every_axis:
        return 0.0
    among = max(term.among, 1) * max(len(term.probes), 1)
    return -math.log(NAMES) - math.log(among)


def log_odds(term: Term, gain: float, more: Fit, replaced: Mapping[str, float] = {}) -> float:
    """Log posterior odds of the model `more` with a term to that without it, which costs `gain` squares more."""
    paid, spike = occam(term, more, replaced)
    return 0.5 * gain / overdispersion(more, term) - paid - spike + prior(term)
