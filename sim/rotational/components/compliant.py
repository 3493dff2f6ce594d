"""Compliant components, whose torque follows their relative motion: Spring, Damper, SpringDamper."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Range, Row, Variables, WithStarts


@dataclass(frozen=True, kw_only=True)
class Compliant(WithStarts):
    """A massless component between two flanges: tau_b = tau, tau_a = -tau, states phi_rel and w_rel.

    Parameters
    ----------
    phi_rel, w_rel
        Start values of flange_b's angle and speed minus flange_a's [rad], [rad/s]; None: not given.
    a_rel
        Modelica's start value of the relative acceleration: refused in words.
    """

    phi_rel: float | None = None
    w_rel: float | None = None
    a_rel: float | None = None

    def piece(
        self, v: Variables, tau: Row, tau_loss: Row, holds: tuple[Row, ...] = (), mode: int | None = None
    ) -> Branch:
        """Return a branch with torque `tau`, of which `tau_loss` is lost to heat."""
        return Branch(
            torques={"flange_a": -tau, "flange_b": tau},
            holds=holds,
            mode=mode,
            channels={"phi_rel": v.phi_rel, "w_rel": v.w_rel, "tau": tau},
            powers={"lossPower": (tau_loss, v.w_rel)},
        )


@dataclass(frozen=True)
class Damper(Compliant):
    """tau = d w_rel; d damping [N.m.s/rad]."""

    d: float

    ranges: ClassVar[Mapping[str, Range]] = {**Compliant.ranges, "d": Range("N.m.s/rad", at_least=0)}

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = self.d * v.w_rel
        return (self.piece(v, tau, tau),)


@dataclass(frozen=True)
class Spring(Compliant):
    """tau = c (phi_rel - phi_rel0); c stiffness [N.m/rad], phi_rel0 unstretched angle [rad]."""

    c: float
    phi_rel0: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {
        **Compliant.ranges, "c": Range("N.m/rad", above=0), "phi_rel0": Range("rad")
    }  # fmt: skip

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (self.piece(v, self.c * (v.phi_rel - self.phi_rel0 * v.one), 0 * v.one),)


@dataclass(frozen=True)
class SpringDamper(Compliant):
    """tau = c (phi_rel - phi_rel0) + d w_rel; c [N.m/rad], d [N.m.s/rad], phi_rel0 [rad]."""

    c: float
    d: float
    phi_rel0: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {**Spring.ranges, **Damper.ranges}

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau_d = self.d * v.w_rel
        return (self.piece(v, self.c * (v.phi_rel - self.phi_rel0 * v.one) + tau_d, tau_d),)
