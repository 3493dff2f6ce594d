"""What several recordings of one axis say together: of a name, and of a number. Closed forms only.

A name. Recordings are taken for independent given the axis, so that their log odds add up relative to the prior:

    logit(exists) = logit(prior) + sum over recordings of (logit(exists in it) - logit(prior)),
    p = exists / (1 + sum over rivals of exp(-sum over recordings of the log odds of the name against that rival)).

No recording says more than `LARGEST`, for or against: each may be misjudged. What names it is bounded by `probability`.

A number. Inverse variances add up; what was known before them counts once and not once per recording; where recordings
disagree by more than their intervals, the interval is wider by Birge's ratio (Phys. Rev. 40 (1932) 207),
sqrt(chi squared / (n - 1)), if that is above 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.investigation.acoustic.evidence import LARGEST, PRIOR_ODDS
from sim.investigation.assessment.calibration import WEIGHTS

PRIOR = math.log(PRIOR_ODDS)  # log odds of a mechanism before anything is measured
LEAST = 0.01


@dataclass(frozen=True)
class Name:
    """A mechanism at a place; `order` tells ripples apart.

    >>> str(Name("torque_ripple", "motor", 6.0))
    'torque ripple at motor (6 per turn)'
    """

    mechanism: str
    location: str | None
    order: float | None = None

    def __str__(self) -> str:
        place = f" at {self.location}" if self.location else ""
        return f"{self.mechanism.replace('_', ' ')}{place}" + (f" ({self.order:g} per turn)" if self.order else "")


@dataclass(frozen=True)
class LogOdds:
    """What one recording says of a name.

    `exists`: log odds that it adds to the prior; 0 says nothing. `against`: log odds of the name against each rival.
    """

    exists: float
    against: Mapping[Name, float] = field(default_factory=dict)


def logit(probability: float) -> float:
    return math.log(probability) - math.log1p(-probability)


def logistic(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(min(log_odds, 60.0), -60.0)))


def silent(drop: float, temperature: float) -> float:
    """Log odds from a recording that does not name a mechanism, once it had to take it as the others found it.

    `drop`: by how much that lowers its cost in squares, the size held to what the others know of it by their interval.
    Half of it is the log likelihood ratio; `temperature` below 1 since residuals are not quite white. What it cannot
    see costs it nothing and says nothing.

    >>> silent(0.0, 0.3), silent(-20.0, 0.3), silent(1000.0, 0.3)
    (0.0, -3.0, 6.0)
    """
    return max(-LARGEST, min(LARGEST, 0.5 * temperature * drop))


def existence(sayings: Iterable[LogOdds]) -> float:
    """Log odds that the effect is there with one size in all recordings, whatever its name: the sum of what each says.

    >>> logistic(existence([LogOdds(9.0), LogOdds(9.0), *[LogOdds(-9.0)] * 3])) < 0.01
    True
    """
    return PRIOR + sum(max(-LARGEST, min(LARGEST, saying.exists)) for saying in sayings)


def against(sayings: Iterable[LogOdds]) -> dict[Name, float]:
    """Log odds of the name against each rival that any recording weighed."""
    out: dict[Name, float] = {}
    for saying in sayings:
        for rival, odds in saying.against.items():
            out[rival] = out.get(rival, 0.0) + odds
    return out


def probability(exists: float, rivals: Iterable[float], own: Sequence[float]) -> float:
    """Probability of a name; `exists`, `rivals`: log odds; `own`: what each recording that names it says by itself.

    No name is surer than names have turned out to be. Half-way between errors that all recordings of an axis share
    (form of the model) and errors that each has of its own (noise), what that leaves open is divided by their number.

    >>> round(probability(logit(0.9), [], [0.9]), 6), round(probability(30.0, [], [0.95, 0.95]), 6)
    (0.9, 0.975)
    """
    named = logistic(exists) / (1.0 + sum(math.exp(-max(min(r, 60.0), -60.0)) for r in rivals))
    cap = 1.0 - (1.0 - WEIGHTS.cap) / max(len(own), 1)
    return min(max(named, LEAST), max(cap, *own, LEAST))


@dataclass(frozen=True)
class Known:
    """A number and its standard deviation; `prior_sd`: of what was known before the recording, in the same units."""

    value: float
    sd: float
    prior_sd: float = math.inf


def pooled(known: Sequence[Known], turn: float = 0.0) -> Known:
    """One number of several; `turn`: its period, for an angle on the circle.

    Each `sd` contains what was known before, which counts once:
    1 / sd^2 = sum 1 / sd_k^2 - (1 - 1/n) sum 1 / prior_sd_k^2.
    The mean is that of the values as they are: where data say little, it stays as near to what was known as they do.

    >>> both = pooled([Known(1.0, 0.1), Known(1.1, 0.1)])
    >>> round(both.value, 3), round(both.sd, 4)
    (1.05, 0.0707)
    >>> round(abs(pooled([Known(3.1, 0.1), Known(-3.1, 0.1)], 2 * math.pi).value), 6)
    3.141593
    """
    told = [k for k in known if k.sd > 0.0]
    if not told:  # exact in each: a count or a side
        values = [k.value for k in known]
        return Known(max(values, key=values.count), 0.0)
    weight = np.array([k.sd**-2.0 for k in told])
    before = (1.0 - 1.0 / len(told)) * np.array([max(k.prior_sd, k.sd) ** -2.0 for k in told])
    value = np.array([k.value for k in told])
    if turn:
        centre = value[int(np.argmax(weight))]
        value = centre + (value - centre + 0.5 * turn) % turn - 0.5 * turn
    information = float(np.sum(weight - before))
    mean = float(weight @ value / weight.sum())
    birge = math.sqrt(float(weight @ (value - mean) ** 2) / max(len(told) - 1, 1))
    if turn:
        signed = any(k.value < 0.0 for k in told)
        mean -= turn * math.floor(mean / turn + (0.5 if signed else 0.0))
    return Known(mean, max(1.0, birge) / math.sqrt(information))
