"""Intervals of 90 % of what was estimated, widened by what the form of a model is off by."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from sim.investigation.data.preprocessing import Measurement
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.parameters import Owner, Values
from sim.investigation.results import Estimate
from sim.investigation.search.effect_size import deviations
from sim.mechanisms.catalogue import kind_of
from sim.mechanisms.mechanism import SIZE_SHARE

NINETY = 1.645
INFLATION = 3.0  # of deviations, so that intervals hold on the calibration seeds
NO_SIZE = ("angle_rad", "phase_rad", "second_phase_rad", "flank", "form", "order", "frequency_hz", "exponent")
BESIDES = {  # units of what is said of a fault or of a sound beside the parameters of its mechanism
    "slip_rad": "rad", "time_s": "s", "torque_n_m": "N m", "angle_from_middle_rad": "rad",
}  # fmt: skip


def term_estimates(
    fit: Fit, term: Term, m: Measurement, numbers: Values, known: Collection[str] = ()
) -> tuple[Estimate, ...]:
    """Reported `numbers` with the intervals of `fit`, no wider than a parameter may be; a frequency is not known better
    than the record is long, nor an order of the motor than its way is: over that the next one gains or loses a turn.
    `known`: parameters that are taken as they are.
    """
    duration_s, turns = float(m.time_s[-1]), float(np.ptp(m.angle)) / (2.0 * math.pi)
    spread = deviations(fit, term, term.report, known)
    limits = {p.name: (p.low, p.high) for p in term.parameters}
    out = []
    for name, value in numbers.items():
        half = NINETY * inflation(fit, m) * spread[name]
        if name not in NO_SIZE:
            half = max(half, term.traits.size_open * abs(value))
        if name == "frequency_hz":
            half = max(half, 1.0 / duration_s)
        if name == "order" and term.location == "motor":
            half = max(half, 1.0 / turns)
        low, high = limits.get(f"{term.key}.{name}", (-math.inf, math.inf))
        ends = float(max(value - half, low)), float(min(value + half, high))
        out.append(Estimate(name, float(value), unit_of(term.mechanism, name), *ends))
    return tuple(out)


def inflation(fit: Fit, m: Measurement) -> float:
    """Widen intervals by what the residual has beyond white noise (form of the model, slow noise).

    By no more where the known torque is doubted, as of a robot's joint: its doubts are among what is fitted, and noise
    of any colour among the deviations.
    """
    return (1.0 if m.doubts.size else INFLATION) * math.sqrt(max(1.0, fit.misfit / fit.residual.size))


def estimates(problem: Problem, fit: Fit) -> tuple[Estimate, ...]:
    deviations = fit.deviations()
    scale = inflation(fit, problem.measurement)
    out = []
    for p in fit.parameters:
        if p.owner is not Owner.DESCRIPTION:
            continue
        half = NINETY * deviations[p.name] * scale
        # a law of friction that is described is as open as one that was found
        if problem.measurement.doubts.size and "_friction_" in p.name:
            half = max(half, SIZE_SHARE * abs(fit.values[p.name]))
        out.append(
            Estimate(
                p.name,
                fit.values[p.name],
                p.unit,
                fit.values[p.name] - half,
                fit.values[p.name] + half,
                None if p.name in problem.unknown else p.expected,
            )
        )
    return tuple(out)


def unit_of(mechanism: str, name: str) -> str:
    """Unit of a number of a finding."""
    units = {p.name: p.unit for p in kind_of(mechanism).parameters}
    return units[name] if name in units else BESIDES[name]
