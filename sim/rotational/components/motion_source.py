"""Position, Speed, ConstantSpeed, Accelerate and Move: flanges that are moved, whatever torque it takes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim.errors import ParameterError
from sim.rotational.component import Branch, Component, Range, Row, Signal, Start, Variables
from sim.rotational.components.signals import Constant, Pulse, Sine, Step

BESSEL_AF, BESSEL_BF = 1.3617, 0.6180
"""Coefficients of the 2nd-order Bessel filter of Position."""


@dataclass(frozen=True)
class MotionSource(Component):
    """A flange whose acceleration against the support is given."""

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    unknowns: ClassVar[int] = 1

    def acceleration(self, v: Variables) -> Row:
        """The acceleration that the flange is given: that of the signal, unless a subclass says else."""
        return v.signal(0)

    def prescribed(self, v: Variables) -> tuple[Row, ...]:
        return v.motion("flange")[:1]

    def states(self, v: Variables) -> tuple[Row, ...]:
        return self.prescribed(v)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        phi, w, a = v.motion("flange")
        tau = v.unknown(0)
        return (
            Branch(
                torques={"flange": tau, "support": -tau},
                equations=(a - self.acceleration(v),),
                channels={"phi": phi, "w": w, "a": a, "flange.tau": tau},
            ),
        )


@dataclass(frozen=True)
class Position(MotionSource):
    """The flange follows the signal's angle [rad]: exactly, or through a filter of critical frequency f_crit [Hz].

    Exact motion needs a signal that can be differentiated twice: Constant, or Sine that has begun.
    """

    phi_ref: Signal
    exact: bool = False
    f_crit: float = 50.0

    ranges: ClassVar[Mapping[str, Range]] = {"f_crit": Range("Hz", above=0)}

    def __post_init__(self) -> None:
        super().__post_init__()
        smooth = isinstance(self.phi_ref, Constant) or (isinstance(self.phi_ref, Sine) and self.phi_ref.startTime <= 0)
        if self.exact and not smooth:
            raise ParameterError(
                f"Position.phi_ref: a {type(self.phi_ref).__name__} cannot be followed exactly; "
                "give a Constant or a Sine from the start, or exact=False"
            )

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        return ((v.motion("flange")[0], self.phi_ref),) if self.exact else ()

    def starts(self, v: Variables) -> tuple[Start, ...]:
        phi, w, _ = v.motion("flange")
        begin = self.phi_ref.pieces(np.zeros(1))[0]
        angle = Start(phi, float(begin[0] + begin[1]))
        return (angle, Start(w, float(begin[2]))) if self.exact else (angle,)

    def acceleration(self, v: Variables) -> Row:
        if self.exact:
            return v.signal(0, derivative=2)
        phi, w, _ = v.motion("flange")
        w_crit = 2 * math.pi * self.f_crit
        return ((v.signal(0) - phi) * w_crit - BESSEL_AF * w) * (w_crit / BESSEL_BF)


@dataclass(frozen=True)
class Speed(MotionSource):
    """The flange follows the signal's speed [rad/s]: exactly, or through a first-order filter of f_crit [Hz]."""

    w_ref: Signal
    exact: bool = False
    f_crit: float = 50.0

    ranges: ClassVar[Mapping[str, Range]] = {"f_crit": Range("Hz", above=0)}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.exact and isinstance(self.w_ref, Step | Pulse):
            raise ParameterError(
                f"Speed.w_ref: a {type(self.w_ref).__name__} cannot be followed exactly; "
                "give a signal without steps, or exact=False"
            )

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        return ((v.motion("flange")[1], self.w_ref),) if self.exact else ()

    def starts(self, v: Variables) -> tuple[Start, ...]:
        return (Start(v.motion("flange")[1], float(self.w_ref(np.zeros(1))[0])),)

    def acceleration(self, v: Variables) -> Row:
        if self.exact:
            return v.signal(0, derivative=1)
        return (v.signal(0) - v.motion("flange")[1]) * (2 * math.pi * self.f_crit)


@dataclass(frozen=True)
class ConstantSpeed(MotionSource):
    """The flange turns with w_fixed [rad/s]."""

    w_fixed: float

    ranges: ClassVar[Mapping[str, Range]] = {"w_fixed": Range("rad/s")}

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        return ((v.motion("flange")[1], Constant(self.w_fixed)),)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        return (Start(v.motion("flange")[1], self.w_fixed),)

    def acceleration(self, v: Variables) -> Row:
        return 0 * v.one


@dataclass(frozen=True)
class Accelerate(MotionSource):
    """The flange has the signal's acceleration [rad/s2], from the start values phi [rad] and w [rad/s]."""

    a_ref: Signal
    phi: float = 0.0
    w: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {"phi": Range("rad"), "w": Range("rad/s")}

    def starts(self, v: Variables) -> tuple[Start, ...]:
        phi, w, _ = v.motion("flange")
        return (Start(phi, self.phi), Start(w, self.w))


@dataclass(frozen=True)
class Move(MotionSource):
    """The flange moves as three signals say that belong together: angle [rad], speed [rad/s], acceleration [rad/s2].

    Angle and speed count at the start; from then on they follow from the acceleration.
    """

    phi_ref: Signal
    w_ref: Signal
    a_ref: Signal

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.a_ref,)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        phi, w, _ = v.motion("flange")
        begin = np.zeros(1)
        return (Start(phi, float(self.phi_ref(begin)[0])), Start(w, float(self.w_ref(begin)[0])))
