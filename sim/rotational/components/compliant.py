"""What all compliant components share: tau_b = tau, tau_a = -tau, states phi_rel and w_rel."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Component, Row, Start, Variables
from sim.rotational.components.start_values import check_starts


@dataclass(frozen=True, kw_only=True)
class Compliant(Component):
    """A massless component whose torque depends on the relative motion of its flanges.

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

    units: ClassVar[Mapping[str, str]] = {
        "phi_rel": "rad",
        "w_rel": "rad/s",
        "tau": "N.m",
        "lossPower": "W",
    }

    def __post_init__(self) -> None:
        check_starts(self, "phi_rel", "w_rel", "a_rel")

    def states(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        given = ((v.phi_rel, self.phi_rel), (v.w_rel, self.w_rel))
        return tuple(Start(row, value) for row, value in given if value is not None)

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
