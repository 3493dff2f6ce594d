"""Position, Speed, ConstantSpeed, Accelerate and Move: flanges that are moved, whatever torque it takes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim.errors import ParameterError, number
from sim.rotational.component import Branch, Component, Row, Signal, Start, Variables
from sim.rotational.components.signals import Constant, Pulse, Sine, Step
from sim.rotational.components.torque import is_signal

BESSEL_AF, BESSEL_BF = 1.3617, 0.6180
"""Coefficients of the 2nd-order Bessel filter of Position."""


@dataclass(frozen=True)
class MotionSource(Component):
    """A flange whose acceleration against the support is given."""

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = {
        "phi": "rad",
        "w": "rad/s",
        "a": "rad/s2",
        "flange.tau": "N.m",
    }

    @property
    def unknowns(self) -> int:
        return 1

    def phi_w_a(self, v: Variables) -> tuple[Row, Row, Row]:
        """Angle, speed and acceleration of the flange against the support."""
        return (
            v.phi("flange") - v.phi("support"),
            v.w("flange") - v.w("support"),
            v.a("flange") - v.a("support"),
        )

    def acceleration(self, v: Variables) -> Row:
        """The acceleration that the flange is given."""
        raise NotImplementedError

    def prescribed(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi("flange") - v.phi("support"),)

    def states(self, v: Variables) -> tuple[Row, ...]:
        return self.prescribed(v)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        phi, w, a = self.phi_w_a(v)
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

    def __post_init__(self) -> None:
        is_signal("Position.phi_ref", self.phi_ref)
        number("Position.f_crit", self.f_crit, "Hz", above=0)
        smooth = isinstance(self.phi_ref, Constant) or (isinstance(self.phi_ref, Sine) and self.phi_ref.startTime <= 0)
        if self.exact and not smooth:
            raise ParameterError(
                f"Position.phi_ref: a {type(self.phi_ref).__name__} cannot be followed exactly; "
                "give a Constant or a Sine from the start, or exact=False"
            )

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.phi_ref,)

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        return ((self.phi_w_a(v)[0], self.phi_ref),) if self.exact else ()

    def starts(self, v: Variables) -> tuple[Start, ...]:
        phi, w, _ = self.phi_w_a(v)
        begin = self.phi_ref.pieces(np.zeros(1))[0]
        angle = Start(phi, float(begin[0] + begin[1]))
        return (angle, Start(w, float(begin[2]))) if self.exact else (angle,)

    def acceleration(self, v: Variables) -> Row:
        if self.exact:
            return v.signal(0, derivative=2)
        phi, w, _ = self.phi_w_a(v)
        w_crit = 2 * math.pi * self.f_crit
        return ((v.signal(0) - phi) * w_crit - BESSEL_AF * w) * (w_crit / BESSEL_BF)


@dataclass(frozen=True)
class Speed(MotionSource):
    """The flange follows the signal's speed [rad/s]: exactly, or through a first-order filter of f_crit [Hz]."""

    w_ref: Signal
    exact: bool = False
    f_crit: float = 50.0

    def __post_init__(self) -> None:
        is_signal("Speed.w_ref", self.w_ref)
        number("Speed.f_crit", self.f_crit, "Hz", above=0)
        if self.exact and isinstance(self.w_ref, Step | Pulse):
            raise ParameterError(
                f"Speed.w_ref: a {type(self.w_ref).__name__} cannot be followed exactly; "
                "give a signal without steps, or exact=False"
            )

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.w_ref,)

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        return ((self.phi_w_a(v)[1], self.w_ref),) if self.exact else ()

    def starts(self, v: Variables) -> tuple[Start, ...]:
        return (Start(self.phi_w_a(v)[1], float(self.w_ref(np.zeros(1))[0])),)

    def acceleration(self, v: Variables) -> Row:
        if self.exact:
            return v.signal(0, derivative=1)
        return (v.signal(0) - self.phi_w_a(v)[1]) * (2 * math.pi * self.f_crit)


@dataclass(frozen=True)
class ConstantSpeed(MotionSource):
    """The flange turns with w_fixed [rad/s]."""

    w_fixed: float

    def __post_init__(self) -> None:
        number("ConstantSpeed.w_fixed", self.w_fixed, "rad/s")

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        return ((self.phi_w_a(v)[1], Constant(self.w_fixed)),)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        return (Start(self.phi_w_a(v)[1], self.w_fixed),)

    def acceleration(self, v: Variables) -> Row:
        return 0 * v.one


@dataclass(frozen=True)
class Accelerate(MotionSource):
    """The flange has the signal's acceleration [rad/s2], from the start values phi [rad] and w [rad/s]."""

    a_ref: Signal
    phi: float = 0.0
    w: float = 0.0

    def __post_init__(self) -> None:
        is_signal("Accelerate.a_ref", self.a_ref)
        number("Accelerate.phi", self.phi, "rad")
        number("Accelerate.w", self.w, "rad/s")

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.a_ref,)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        phi, w, _ = self.phi_w_a(v)
        return (Start(phi, self.phi), Start(w, self.w))

    def acceleration(self, v: Variables) -> Row:
        return v.signal(0)


@dataclass(frozen=True)
class Move(MotionSource):
    """The flange moves as three signals say that belong together: angle [rad], speed [rad/s], acceleration [rad/s2].

    Angle and speed count at the start; from then on they follow from the acceleration.
    """

    phi_ref: Signal
    w_ref: Signal
    a_ref: Signal

    def __post_init__(self) -> None:
        for name in ("phi_ref", "w_ref", "a_ref"):
            is_signal(f"Move.{name}", getattr(self, name))

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.a_ref,)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        phi, w, _ = self.phi_w_a(v)
        begin = np.zeros(1)
        return (Start(phi, float(self.phi_ref(begin)[0])), Start(w, float(self.w_ref(begin)[0])))

    def acceleration(self, v: Variables) -> Row:
        return v.signal(0)
