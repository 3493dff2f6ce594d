"""What a finding from sound is, and how evidence of several looks and recordings becomes one probability."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from sim.investigation.acoustic.operating_states import Course
from sim.investigation.unexplained import Unexplained

REPORTED = 0.5  # probability from which a fault is reported
FALSE_ALARM = 0.005
"""Probability that noise alone makes a candidate [1]."""
PRIOR_ODDS = 1.0 / 10.0
"""Odds of each mechanism before anything is heard [1]: one axis in eleven that somebody listens to has it."""
SILENT = 0.4
"""Likelihood ratio of a recording without a sign: three in five faults of the sizes that matter are heard [1]."""


@dataclass(frozen=True)
class Tail:
    """How often good gearboxes reach a score: `share` of them exceed `start`, fewer by e per `scale` beyond."""

    start: float
    scale: float
    share: float = 0.05

    def p_value(self, score: float) -> float:
        """Chance that a gearbox in good order scores as high; 1 below the tail."""
        return self.share * math.exp(-(score - self.start) / self.scale) if score > self.start else 1.0


@dataclass(frozen=True)
class AcousticFinding:
    """A finding from sound; `parameters`: name to value, low, high.

    `elsewhere`: where it would sound the same. `p_values`: one per recording, None where it could not be looked for.
    """

    mechanism: str
    location: str | None
    probability: float
    parameters: Mapping[str, tuple[float, float, float]]
    explanation: str
    indistinguishable_from: tuple[str, ...] = field(default=())
    elsewhere: tuple[str, ...] = ()
    p_values: tuple[float | None, ...] = ()


LARGEST = 6.0  # of a logarithm of odds: no recording is worth more than 400 to 1


def log_ratio(p_value: float) -> float:
    """Logarithm of the likelihood ratio that a p-value is worth at most: 1 / (-e p ln p).

    Sellke, Bayarri and Berger, Calibration of p values, American Statistician 55 (2001) 62; `SILENT` where p says
    nothing.

    >>> round(log_ratio(0.005), 1), log_ratio(0.9) == math.log(SILENT)
    (2.6, True)
    """
    if p_value >= math.exp(-1.0):
        return math.log(SILENT)
    p = max(p_value, 1e-300)
    return min(-1.0 - math.log(p) - math.log(-math.log(p)), LARGEST)


def probability(p_values: Iterable[float | None]) -> float:
    """Posterior of a mechanism from one p-value per recording of the same axis, 0.01 to 0.99.

    A recording without a sign speaks against the mechanism, so that many nulls do not add up to an alarm; one in which
    it could not be looked for (None) says nothing.

    >>> probability([1e-4]) > 0.9 > probability([1e-4, 1.0, 1.0]) > 0.5 > probability([0.02])
    True
    >>> probability([0.05] + [1.0] * 9)
    0.01
    """
    total = math.log(PRIOR_ODDS) + sum(log_ratio(p) for p in p_values if p is not None)
    return min(max(1.0 / (1.0 + math.exp(-max(min(total, 50.0), -50.0))), 0.01), 0.99)


@dataclass(frozen=True, eq=False)
class AcousticResult:
    """Findings, candidates that were rejected with their probability, remarks, what to measure next.

    `examined`: mechanisms that the recordings let be looked for; `not_examined`: all others, to the reason. `names`:
    of the recordings, one per course. `as_new`: what they were compared with. `left`: what no
    part of the sound's model explains.
    """

    heard: tuple[AcousticFinding, ...]
    rejected: tuple[tuple[str, float], ...]
    remarks: tuple[str, ...]
    next_measurement: str
    courses: tuple[Course, ...]
    examined: tuple[str, ...]
    not_examined: Mapping[str, str]
    names: tuple[str, ...]
    as_new: tuple[Course, ...] = ()
    left: Unexplained | None = None
