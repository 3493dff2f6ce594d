"""What might be missing: one term is one mechanism at one place, with the numbers that a fit may choose."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sim import mechanisms
from sim.chain.model import Chain
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.model.parameters import Parameter, Values
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


Array = NDArray[np.float64]
Apply = Callable[[Chain, Values], Chain]
AddTorque = Callable[[Measurement, Values], Array]
Respond = Callable[[NDArray[np.complex128], Values], NDArray[np.complex128]]
Report = Callable[[Values], Mapping[str, float]]


def unchanged(chain: Chain, values: Values) -> Chain:
    return chain


@dataclass(frozen=True)
class Key:
    """A mechanism, or structure without a name, at one place."""

    mechanism: str
    location: str | None

    def __str__(self) -> str:
        return f"{self.mechanism}@{self.location}"


@dataclass(frozen=True)
class Term:
    """`apply` changes the chain; `torque` and `load_torque` are what to add outside of it at motor and load [N m].

    `response`: what the latter takes per angle and inertia of the load [1/s^2] at places on the imaginary axis [rad/s],
    where it hangs on the load's motion as measured, noise and all.

    `named` is False for structure that competes with the mechanisms and has no name of its own.

    `probes`: starts worth trying; each is a group of columns, a column being the values to jump to. `report` turns
    the fitted numbers into the parameters of the mechanism; `positive`: the first number cannot be below 0;
    `nonlinear`: the rest of the model moves far when it comes in; `contact`: teeth leave each other by it, and no
    linear picture reaches beyond a probe. `as_new_too`: it is worth a place also of a size as new, as nothing that is
    always fitted stands for it.
    """

    mechanism: str
    location: str | None
    parameters: tuple[Parameter, ...]
    probes: tuple[tuple[Mapping[str, float], ...], ...]
    report: Report
    apply: Apply = unchanged
    torque: AddTorque | None = None
    load_torque: AddTorque | None = None
    response: Respond | None = None
    named: bool = True
    positive: bool = False
    nonlinear: bool = False
    contact: bool = False
    replaces: tuple[str, ...] = ()
    brings: tuple[Parameter, ...] = ()  # what the description would have if it had the like; several share them
    shape: tuple[str, ...] = ()  # parameters that say where it acts and not how much
    size: float = 0.0  # below this it does not matter in practice
    among: int = 0  # candidates of its kind among which it was picked by the data
    frequency_hz: float | None = None  # of a term that is one line
    magnitude: Callable[[Values], float] | None = None  # what is held against `size`; default the first number reported
    as_new_too: bool = False
    least_share: float | None = None  # of the squared residual that it must gain; default that of its mechanism

    @property
    def key(self) -> Key:
        return Key(self.mechanism, self.location)

    @property
    def traits(self) -> Traits:
        return traits_of(self.mechanism)


ENCODER_ERROR = ("load_encoder.error_sine_rad", "load_encoder.error_cosine_rad")
AS_NEW_FACTOR = 3.0  # more than this above as new is a finding


def parameter_key(mechanism: str, location: str | None, parameter: str) -> str:
    """How a parameter of a mechanism at its place is called."""
    return f"{mechanism}@{location}.{parameter}"


def cosine_and_sine(prefix: str, step: float, unit: str) -> tuple[Parameter, Parameter]:
    """Both parameters of an oscillation of which neither size nor phase is known, at none of it."""
    return Parameter(f"{prefix}.sine", 0.0, step, unit=unit), Parameter(f"{prefix}.cosine", 0.0, step, unit=unit)


def cosine_and_sine_probe(prefix: str, step: float) -> tuple[tuple[Mapping[str, float], ...], ...]:
    """The step by which such an oscillation is tried; its phase follows from the fit."""
    return (({f"{prefix}.sine": step}, {f"{prefix}.cosine": step}),)


def amplitude(pair: Sequence[Parameter], name: str, phase: str) -> Report:
    """A report of size and phase [rad] from both parameters."""
    sine, cosine = (p.name for p in pair)

    def report(values: Values) -> dict[str, float]:
        return {name: math.hypot(values[sine], values[cosine]), phase: math.atan2(values[cosine], values[sine])}

    return report
