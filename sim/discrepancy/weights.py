"""Numbers of `sim.discrepancy.weighing.probability`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Weights:
    """Log odds are `bias` + `slope` ln(share / 1 %) - `left` ln(1 + structure left / a tenth of what was taken away).

    `overdispersion` of differences between models; `cap`: (right + 1) / (claims + 2) of the better founded half
    of claims, Laplace's rule of succession.
    """

    bias: float
    slope: float
    left: float
    overdispersion: float
    cap: float


# `python -m tests.hidden_effects.calibrate` prints this line; so far 52 of its 70 scenarios, 16 of 19 names right
WEIGHTS = Weights(bias=2.28, slope=0.9, left=1.96, overdispersion=2.21, cap=0.909)
