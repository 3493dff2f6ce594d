"""What is known beforehand of a mechanism by its name, and of structure that has none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from sim import mechanisms
from sim.mechanisms.catalogue import kind_or_any
from sim.mechanisms.mechanism import Law, Traits

OVER_SPEED, OVER_ANGLE = "friction_over_speed", "friction_over_angle"
FIXED = "fixed_frequency"
ERROR_OVER_ANGLE = "error_over_angle"
AS_NEW = "torque_over_angle"  # as new, as errors of teeth are: it enters a model, and is not spoken of

NAMELESS: Mapping[str, Traits] = MappingProxyType(
    {
        OVER_SPEED: Traits(least_share=0.003, form_left=0.2),  # a curve stands for a law that has no name
        OVER_ANGLE: Traits(least_share=0.002, form_left=0.2),
        # a difference of angles, as a gap and a spring make: what the form of these leaves lies over the angle, too
        ERROR_OVER_ANGLE: Traits(least_share=0.002, in_every_axis=True, laws=frozenset({Law.SPRING})),
        FIXED: Traits(least_share=0.002, restless=True),
        AS_NEW: Traits(),
    }
)
OVER_SPEED_AT_LOAD = 0.002  # least share of the squared residual


def mechanisms_with(trait: Callable[[Traits], bool]) -> frozenset[str]:
    """Names of the catalogue that have a trait."""
    return frozenset(name for name, kind in mechanisms.MECHANISMS.items() if trait(kind.traits))


def traits_of(mechanism: str) -> Traits:
    """Of a mechanism of the catalogue or of structure without a name."""
    return NAMELESS[mechanism] if mechanism in NAMELESS else kind_or_any(mechanism).traits
