"""Inertia: a rigid shaft that turns."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Row, Start, Variables
from sim.rotational.components.start_values import check_starts


@dataclass(frozen=True)
class Inertia(Component):
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

    units: ClassVar[Mapping[str, str]] = {
        "phi": "rad",
        "w": "rad/s",
        "a": "rad/s2",
        "flange_a.tau": "N.m",
        "flange_b.tau": "N.m",
    }

    def __post_init__(self) -> None:
        number("Inertia.J", self.J, "kg.m2", above=0)
        check_starts(self, "phi", "w", "a")

    @property
    def inertia(self) -> float:
        return self.J

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def states(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi("flange_a"),)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        given = ((v.phi("flange_a"), self.phi), (v.w("flange_a"), self.w))
        return tuple(Start(row, value) for row, value in given if value is not None)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau_b = v.unknown(0)
        tau_a = self.J * v.a("flange_a") - tau_b
        return (
            Branch(
                torques={"flange_a": tau_a, "flange_b": tau_b},
                channels={
                    "phi": v.phi("flange_a"),
                    "w": v.w("flange_a"),
                    "a": v.a("flange_a"),
                    "flange_a.tau": tau_a,
                    "flange_b.tau": tau_b,
                },
            ),
        )
