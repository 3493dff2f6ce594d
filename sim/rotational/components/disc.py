"""Disc: a rigid shaft without inertia whose ends are turned against each other."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Row, Variables


@dataclass(frozen=True)
class Disc(Component):
    """phi_b = phi_a + deltaPhi [rad], tau_a + tau_b = 0; phi is the angle midway."""

    deltaPhi: float = 0.0

    units: ClassVar[Mapping[str, str]] = {"phi": "rad", "flange_a.tau": "N.m", "flange_b.tau": "N.m"}

    def __post_init__(self) -> None:
        number("Disc.deltaPhi", self.deltaPhi, "rad")

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel - self.deltaPhi * v.one,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.unknown(0)
        middle = 0.5 * (v.phi("flange_a") + v.phi("flange_b"))
        return (
            Branch(
                torques={"flange_a": tau, "flange_b": -tau},
                channels={"phi": middle, "flange_a.tau": tau, "flange_b.tau": -tau},
            ),
        )
