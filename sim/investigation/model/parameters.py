"""Numbers that a fit may choose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum

UNKNOWN = 3.0  # standard deviations of a number over a first look at it
Values = Mapping[str, float]


class Owner(Enum):
    """Whose a number is."""

    DESCRIPTION = "the description's, which says it"
    MACHINE = "the machine's, of which the description says at most what is as new"
    RECORDING = "a recording's: its sensors, its contacts at rest"
    MOTION = "one motion's: where it begins and in which phase"
    MECHANISM = "a mechanism's that the description lacks"


class Stated(Enum):
    """How a data sheet states a number, which it may also have wrong altogether."""

    NO = "not"
    ROUGHLY = "as one that is known less well"
    WELL = "well"


@dataclass(frozen=True)
class Parameter:
    """One number of the model: where the fit starts, how uncertain it is, how far it may go.

    `step` is the change used for a sensitivity; `spread` the standard deviation of what is known beforehand.
    """

    name: str
    start: float
    step: float
    spread: float = math.inf
    low: float = -math.inf
    high: float = math.inf
    centre: float | None = None
    unit: str = "1"
    owner: Owner = Owner.MECHANISM
    stated: Stated = Stated.NO

    @property
    def expected(self) -> float:
        return self.start if self.centre is None else self.centre

    def deviation(self, values: Values) -> float:
        """By how many standard deviations it lies off what is known of it beforehand."""
        return abs(values[self.name] - self.expected) / self.spread

    def unknown(self) -> Parameter:
        """The same as a number that nobody has said: of its order, by the telemetry itself."""
        wide = UNKNOWN * abs(self.expected)
        return replace(
            self, spread=wide, low=0.01 * abs(self.expected), high=100.0 * abs(self.expected), stated=Stated.NO
        )

    def doubted(self, times: float) -> Parameter:
        """The same known so many times less well."""
        return replace(self, spread=times * self.spread)
