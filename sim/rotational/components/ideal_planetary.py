"""IdealPlanetary: sun, carrier and ring without inertia, loss or play."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Row, Variables


@dataclass(frozen=True)
class IdealPlanetary(Component):
    """(1 + ratio) phi_carrier = phi_sun + ratio phi_ring; ratio is teeth of the ring over teeth of the sun."""

    ratio: float

    flanges: ClassVar[tuple[str, ...]] = ("sun", "carrier", "ring")
    units: ClassVar[Mapping[str, str]] = {"sun.tau": "N.m", "carrier.tau": "N.m", "ring.tau": "N.m"}

    def __post_init__(self) -> None:
        number("IdealPlanetary.ratio", self.ratio, "", above=0)

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return ((1 + self.ratio) * v.phi("carrier") - v.phi("sun") - self.ratio * v.phi("ring"),)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        sun = v.unknown(0)
        torques = {"sun": sun, "carrier": -(1 + self.ratio) * sun, "ring": self.ratio * sun}
        return (Branch(torques=torques, channels={f"{name}.tau": tau for name, tau in torques.items()}),)
