"""Fixed: a flange that stands still."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Row, Variables


@dataclass(frozen=True)
class Fixed(Component):
    """phi = phi0 [rad]."""

    phi0: float = 0.0

    flanges: ClassVar[tuple[str, ...]] = ("flange",)
    units: ClassVar[Mapping[str, str]] = {"flange.tau": "N.m"}

    def __post_init__(self) -> None:
        number("Fixed.phi0", self.phi0, "rad")

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi("flange") - self.phi0 * v.one,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (Branch(torques={"flange": v.unknown(0)}, channels={"flange.tau": v.unknown(0)}),)
