"""What the two encoders of a new axis differ by, from its description; and where lost motion is said to be."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.description.axis import Axis
from sim.investigation.estimation.problem import MISTAKEN
from sim.investigation.kinematics.transmission_error import Amplitude, is_larger_than
from sim.investigation.model.nominal import STATED_SPREAD
from sim.investigation.search.criterion import LEAST_EFFECT
from sim.mechanisms import Backlash, Hysteresis, TimeDelay
from sim.mechanisms.catalogue import mechanism_of
from sim.mechanisms.locations import meshes
from sim.mechanisms.mechanism import Need

CLEARLY = 3.0  # times as new, which is a finding
SPREAD = math.sqrt(2.0) * STATED_SPREAD  # of friction over stiffness


@dataclass(frozen=True)
class AsNew:
    """Felt at the load [rad]: gap, what the described friction winds up in both directions together, errors.

    `found`: a gap that the description has as a mechanism, found before.
    """

    gap: float
    found: float
    windup: float
    error: float

    @staticmethod
    def of(axis: Axis, speed_rad_s: float) -> AsNew:
        """From the description alone; friction T at the load winds a spring c up by T / c, either way.

        `speed_rad_s`: the one of the load at which viscous friction is the same as dry; 0 where it is told from it.
        """
        springs = zip(axis.stages, axis.stiffness(), strict=False)
        compliance = sum(1.0 / c / axis.ratio_from(stage.name) ** 2 for stage, c in springs if c)
        gaps = [mechanism_of(known) for known in axis.mechanisms if known.name == Backlash.name]
        return AsNew(
            sum(stage.backlash_rad / axis.ratio_from(stage.name) for stage in axis.stages),
            sum(known["gap_rad"] / axis.ratio_from(known.location or "load") for known in gaps),
            2.0
            * (axis.load.coulomb_friction_n_m + axis.load.viscous_friction_n_m_s_per_rad * speed_rad_s)
            * compliance,
            max([axis.load_encoder.error_rad, *(stage.transmission_error_rad for stage in axis.stages)]),
        )

    def has_less(self, lost: Amplitude) -> bool:
        """Whether lost motion is more than as new, by its best value also than what friction winds up besides."""
        most = max(self.gap, self.found) + self.windup * (1.0 + LEAST_EFFECT * SPREAD)
        return is_larger_than(lost, self._limit, 1) and lost.value > most

    def surely_has_less(self, lost: Amplitude) -> bool:
        """The same, were friction and stiffness off by as much as makes a number of a data sheet wrong."""
        return is_larger_than(lost, self._limit + self.most_windup, 1)

    @property
    def most_windup(self) -> float:
        """Were friction and stiffness off by as much as makes a number of a data sheet wrong."""
        return self.windup * (1.0 + MISTAKEN * SPREAD)

    @property
    def least_windup(self) -> float:
        """The same, the other way round."""
        return self.windup * (1.0 - MISTAKEN * SPREAD)

    @property
    def _limit(self) -> float:
        return max(CLEARLY * self.gap, self.found)

    def is_exceeded(self, size: Amplitude) -> bool:
        """Whether an error that repeats with the angle is clearly more than as new."""
        return is_larger_than(size, CLEARLY * self.error, 2)


def place_of_gap(axis: Axis) -> str | None:
    """The mesh at the output, where play is meant that no one has placed."""
    return next(iter(meshes(axis)), None)


def like_a_gap(axis: Axis, lacks: frozenset[Need] = frozenset()) -> tuple[str, ...]:
    """What two encoders alone do not tell from play, in a motion that lacks something."""
    late = (TimeDelay.name,) if Need.SEVERAL_SPEEDS in lacks else ()
    return (*late, Hysteresis.name) if meshes(axis) else late
