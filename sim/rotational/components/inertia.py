"""A rigid body between two flanges, and Inertia: one that turns."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Row, Start, Variables
from sim.rotational.components.start_values import check_starts


class RigidBody(Component):
    """Inertia times acceleration is what both flanges give; they move as one.

    `motion`: what position and speed are called, as start values and as channels; `effort`: what a flange gives.
    """

    motion: ClassVar[tuple[str, str]]
    effort: ClassVar[str]

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def states(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi("flange_a"),)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        given = zip((v.phi("flange_a"), v.w("flange_a")), (getattr(self, name) for name in self.motion), strict=True)
        return tuple(Start(row, value) for row, value in given if value is not None)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        position, speed = self.motion
        of_b = v.unknown(0)
        of_a = self.inertia * v.a("flange_a") - of_b
        return (
            Branch(
                torques={"flange_a": of_a, "flange_b": of_b},
                channels={
                    position: v.phi("flange_a"),
                    speed: v.w("flange_a"),
                    "a": v.a("flange_a"),
                    f"flange_a.{self.effort}": of_a,
                    f"flange_b.{self.effort}": of_b,
                },
            ),
        )


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

    motion: ClassVar[tuple[str, str]] = ("phi", "w")
    effort: ClassVar[str] = "tau"
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
