"""Rigid parts: Inertia and Mass, Fixed, and Disc, a shaft without inertia."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import UNITS, Branch, Component, Range, Row, Variables, WithStarts


class RigidBody(WithStarts):
    """Inertia times acceleration is what both flanges give (torque, or force); they move as one."""

    effort: ClassVar[str] = "tau"
    unknowns: ClassVar[int] = 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def own_motion(self, v: Variables) -> tuple[Row, Row]:
        return v.phi("flange_a"), v.w("flange_a")

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        motion, of_b = (*self.own_motion(v), v.a("flange_a")), v.unknown(0)
        of_a = self.inertia * motion[2] - of_b
        efforts = {f"flange_a.{self.effort}": of_a, f"flange_b.{self.effort}": of_b}
        channels = {**dict(zip(self.start_names, motion, strict=True)), **efforts}
        return (Branch(torques={"flange_a": of_a, "flange_b": of_b}, channels=channels),)


@dataclass(frozen=True)
class Inertia(RigidBody):
    """J a = tau_a + tau_b, both flanges at one angle.

    Parameters
    ----------
    J
        Moment of inertia [kg.m2].
    phi, w
        Start values [rad], [rad/s]; None: they follow from the rest, or are 0.
    a
        Modelica's start value of the acceleration: refused in words.
    """

    J: float
    phi: float | None = None
    w: float | None = None
    a: float | None = None

    start_names: ClassVar[tuple[str, str, str]] = ("phi", "w", "a")
    ranges: ClassVar[Mapping[str, Range]] = {"J": Range("kg.m2", above=0), "phi": Range("rad"), "w": Range("rad/s")}

    @property
    def inertia(self) -> float:
        return self.J


@dataclass(frozen=True)
class Mass(RigidBody):
    """m a = f_a + f_b: m [kg]; start values s [m], v [m/s], None: they follow from the rest, or are 0; a is refused."""

    m: float
    s: float | None = None
    v: float | None = None
    a: float | None = None

    start_names: ClassVar[tuple[str, str, str]] = ("s", "v", "a")
    ranges: ClassVar[Mapping[str, Range]] = {"m": Range("kg", above=0), "s": Range("m"), "v": Range("m/s")}
    effort: ClassVar[str] = "f"
    units: ClassVar[Mapping[str, str]] = {**UNITS, "a": "m/s2"}

    @property
    def inertia(self) -> float:
        return self.m


@dataclass(frozen=True)
class Fixed(Component):
    """phi = phi0 [rad]."""

    phi0: float = 0.0

    flanges: ClassVar[tuple[str, ...]] = ("flange",)
    ranges: ClassVar[Mapping[str, Range]] = {"phi0": Range("rad")}
    unknowns: ClassVar[int] = 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi("flange") - self.phi0 * v.one,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (Branch(torques={"flange": v.unknown(0)}, channels={"flange.tau": v.unknown(0)}),)


@dataclass(frozen=True)
class Disc(Component):
    """phi_b = phi_a + deltaPhi [rad], tau_a + tau_b = 0; phi is the angle midway."""

    deltaPhi: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {"deltaPhi": Range("rad")}
    unknowns: ClassVar[int] = 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel - self.deltaPhi * v.one,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.unknown(0)
        middle = 0.5 * (v.phi("flange_a") + v.phi("flange_b"))
        channels = {"phi": middle, "flange_a.tau": tau, "flange_b.tau": -tau}
        return (Branch(torques={"flange_a": tau, "flange_b": -tau}, channels=channels),)
