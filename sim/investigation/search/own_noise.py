"""Two models compared each under noise of its own, in the band of the motion.

Noise that is taken from a model with a cause is quiet where that cause is, and so always favours it. Above the band of
the motion most of what is left is an encoder's noise, which the model itself makes louder or quieter with every number:
there a likelihood of what is left is none of the model.
"""

from __future__ import annotations

import math

import numpy as np

from sim.investigation.estimation.estimate import Array, Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import MOTION_BAND_HZ, rewhiten
from sim.investigation.hypotheses.hypothesis import Term

Fitted = tuple[Problem, Fit]
NAMES = 40.0  # mechanisms and places among which one is looked for
DECIDED = 200.0  # log odds which no refit under other noise brings near to those of `NAMES`
BANDS = 40
FEWEST_LINES = 8  # in a band
MOSTLY = 0.5  # of the squares of what a term changes


def without(problem: Problem, fit: Fit, term: Term) -> Fit | None:
    """The model without a term; None where most of what the term changes lies above the band of the motion."""
    rest = tuple(t for t in fit.terms if t is not term)
    less = problem.fit(rest, fit.values, to_end=True)
    return None if share_in_band(problem, less.residual - fit.residual) < MOSTLY else less


def in_own_noise(problem: Problem, fit: Fit) -> Fitted:
    """A model under the noise that it leaves: taken from a fit, and once more from the fit under that."""
    return rewhiten(*rewhiten(problem, fit))


def share_in_band(problem: Problem, change: Array) -> float:
    """Of the squares of whitened rows of both channels, what lies in the band of the motion [1]."""
    m = problem.measurement
    inside = total = 0.0
    for part, rate_hz in ((change[: m.samples], m.rate_hz), (change[m.samples :], m.rate_hz / m.load_stride)):
        power = np.abs(np.fft.rfft(part)) ** 2 if part.size else np.zeros(0)
        inside += float(power[: int(MOTION_BAND_HZ / rate_hz * part.size) + 1].sum())
        total += float(power.sum())
    return inside / max(total, 1e-300)


def likelier(more: Fitted, less: Fitted) -> float:
    """Log odds of two fits, each under its own noise, by the rows of the band of the motion that count in both, and by
    what is known of their numbers."""
    a, b = more[0].measurement, less[0].measurement
    weights = (np.minimum(a.weight, b.weight), np.minimum(a.load_weight, b.load_weight))
    told = likelihood_in_band(*more, weights) - likelihood_in_band(*less, weights)
    return told - 0.5 * (more[1].prior_penalty - less[1].prior_penalty)


def likelihood_in_band(problem: Problem, fit: Fit, weights: tuple[Array, Array]) -> float:
    """Log likelihood of what a fit leaves in the band of the motion, under noise that is flat in each of some bands of
    frequency, the likeliest there is (Whittle, J. R. Stat. Soc. B 15 (1953) 125); but for a constant of the record."""
    m = problem.measurement
    channels = zip(
        problem.raw_residuals(fit.terms, fit.values),
        (weights[0], weights[1][:: m.load_stride]),
        (m.rate_hz, m.rate_hz / m.load_stride),
        strict=True,
    )
    out = 0.0
    for left, weight, rate_hz in channels:
        if left.size:
            last = int(min(MOTION_BAND_HZ / rate_hz, 0.5) * left.size)
            power = np.abs(np.fft.rfft(left * (weight > 0.5))[1:last]) ** 2
            edges = np.unique(np.geomspace(FEWEST_LINES, power.size, BANDS).astype(np.int64))
            parts = np.split(power, edges[:-1])
            out -= float(np.mean(weight > 0.5)) * sum(p.size * math.log(max(float(p.mean()), 1e-300)) for p in parts)
    return out
