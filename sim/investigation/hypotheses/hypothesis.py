"""What might be missing: one term is one mechanism at one place, with the numbers that a fit may choose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.chain.model import Chain
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.hypotheses.traits import traits_of
from sim.investigation.model.parameters import Parameter, Values
from sim.mechanisms.mechanism import Traits

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
