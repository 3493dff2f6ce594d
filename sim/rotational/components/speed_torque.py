"""Torques that depend on the speed of their flange: linear, quadratic, inverse, of constant size."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from sim.errors import ParameterError, number
from sim.rotational.component import Branch, Component, Row, Variables
from sim.rotational.components.torque import UNITS, driving
from sim.rotational.curves import Curve, Shape

Regularization = Literal["Exp", "Sine", "CoSine", "Linear"]
REGULARIZATIONS: tuple[str, ...] = get_args(Regularization)


@dataclass(frozen=True)
class SpeedDependentTorque(Component):
    """Drives its flange with tau_nominal [N.m] at w_nominal [rad/s]; negative: brakes forward motion.

    TorqueDirection true: the same direction of torque whichever way it turns.
    """

    tau_nominal: float
    w_nominal: float
    TorqueDirection: bool = True

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = UNITS

    def __post_init__(self) -> None:
        name = type(self).__name__
        number(f"{name}.tau_nominal", self.tau_nominal, "N.m")
        number(f"{name}.w_nominal", self.w_nominal, "rad/s", above=0)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        raise NotImplementedError

    def _by_direction(self, v: Variables, forward: Row) -> tuple[Branch, ...]:
        """Return one branch per direction; `forward` is the torque forward, odd in the speed."""
        w = v.w("flange") - v.w("support")
        return (driving(v, forward, (w,)), driving(v, -forward, (-w,)))


@dataclass(frozen=True)
class LinearSpeedDependentTorque(SpeedDependentTorque):
    """tau = tau_nominal w/w_nominal, or |w|/w_nominal where TorqueDirection is true."""

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = self.tau_nominal / self.w_nominal * (v.w("flange") - v.w("support"))
        return self._by_direction(v, tau) if self.TorqueDirection else (driving(v, tau),)


@dataclass(frozen=True)
class QuadraticSpeedDependentTorque(SpeedDependentTorque):
    """tau = tau_nominal (w/w_nominal)^2, times the sign of w where TorqueDirection is false."""

    @property
    def affine(self) -> bool:
        return False

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        shape = Shape.SQUARE if self.TorqueDirection else Shape.SIGNED_SQUARE
        square = v.curve(Curve(shape), (v.w("flange") - v.w("support")) / self.w_nominal)
        return (driving(v, self.tau_nominal * square * v.one),)


@dataclass(frozen=True)
class InverseSpeedDependentTorque(SpeedDependentTorque):
    """tau = tau_nominal w_nominal/w, regularised below the speed w0 [rad/s] as in Modelica."""

    w0: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        number("InverseSpeedDependentTorque.w0", self.w0, "rad/s", above=0)

    @property
    def affine(self) -> bool:
        return False

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        row = v.w("flange") - v.w("support")
        limit = self.w0 * v.one
        slow = self.tau_nominal * (self.w_nominal * v.one if self.TorqueDirection else row) / self.w0
        size = self.tau_nominal * self.w_nominal / self.w0
        fast = size * v.curve(Curve(Shape.INVERSE), row / self.w0) * v.one
        return (
            driving(v, slow, (limit - row, limit + row)),
            driving(v, fast, (row - limit,)),
            driving(v, fast if self.TorqueDirection else -fast, (-row - limit,)),
        )


@dataclass(frozen=True)
class SignTorque(Component):
    """tau_nominal [N.m] times the sign of the speed, smoothed below w0 [rad/s] in Modelica's way `reg`."""

    tau_nominal: float
    w0: float = 0.1
    reg: Regularization = "Exp"

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = UNITS

    def __post_init__(self) -> None:
        number("SignTorque.tau_nominal", self.tau_nominal, "N.m")
        number("SignTorque.w0", self.w0, "rad/s", above=0)
        if self.reg not in REGULARIZATIONS:
            raise ParameterError(f"SignTorque.reg: must be one of {', '.join(REGULARIZATIONS)}, got {self.reg!r}")

    @property
    def affine(self) -> bool:
        return False

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        sign = v.curve(Curve(Shape[self.reg.upper()]), (v.w("flange") - v.w("support")) / self.w0)
        return (driving(v, self.tau_nominal * sign * v.one),)


@dataclass(frozen=True)
class EddyCurrentTorque(Component):
    """Brakes with 2 tau_nominal x / (1 + x^2) (Kloss), x = w/w_nominal; tau is into the flange, as Modelica has it.

    Parameters
    ----------
    tau_nominal
        Largest torque [N.m], at the speed w_nominal [rad/s] and the temperature TRef [K].
    TRef, alpha20, T
        w_nominal grows with the disc's resistance: by alpha20 [1/K], given at 293.15 K, up to the temperature T [K].
    """

    tau_nominal: float
    w_nominal: float
    TRef: float = 293.15
    alpha20: float = 0.0
    T: float = 293.15

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = {**UNITS, "lossPower": "W"}

    def __post_init__(self) -> None:
        number("EddyCurrentTorque.tau_nominal", self.tau_nominal, "N.m", at_least=0)
        number("EddyCurrentTorque.w_nominal", self.w_nominal, "rad/s", above=0)
        number("EddyCurrentTorque.alpha20", self.alpha20, "1/K", at_least=0)
        for name in ("TRef", "T"):
            number(f"EddyCurrentTorque.{name}", getattr(self, name), "K", above=0)

    @property
    def affine(self) -> bool:
        return False

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        w = v.w("flange") - v.w("support")
        at_reference = self.alpha20 / (1 + self.alpha20 * (self.TRef - 293.15))
        x = w / (self.w_nominal * (1 + at_reference * (self.T - self.TRef)))
        tau = self.tau_nominal * v.curve(Curve(Shape.EDDY), x) * v.one
        phi = v.phi("flange") - v.phi("support")
        return (
            Branch(
                torques={"flange": tau, "support": -tau},
                channels={"tau": tau, "phi": phi, "w": w},
                powers={"lossPower": (tau, w)},
            ),
        )
