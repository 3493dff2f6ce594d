"""IdealGear: a gear without inertia, loss or play."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import ParameterError, number
from sim.rotational.component import Branch, Component, Row, Variables


def gear_ratio(name: str, value: object) -> float:
    """Return a transmission ratio phi_a/phi_b: finite and not 0; negative where the gear reverses."""
    ratio = number(name, value, "")
    if ratio == 0:
        raise ParameterError(f"{name}: must not be 0 (it is phi_a/phi_b), got {value}")
    return ratio


@dataclass(frozen=True)
class IdealGear(Component):
    """phi_a - phi_support = ratio (phi_b - phi_support), 0 = ratio tau_a + tau_b."""

    ratio: float

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = {
        "phi_a": "rad",
        "phi_b": "rad",
        "flange_a.tau": "N.m",
        "flange_b.tau": "N.m",
    }

    def __post_init__(self) -> None:
        gear_ratio("IdealGear.ratio", self.ratio)

    @property
    def unknowns(self) -> int:
        return 1

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (_relative(v, "flange_a") - self.ratio * _relative(v, "flange_b"),)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau_a = v.unknown(0)
        tau_b = -self.ratio * tau_a
        return (
            Branch(
                torques={"flange_a": tau_a, "flange_b": tau_b, "support": -tau_a - tau_b},
                channels={
                    "phi_a": _relative(v, "flange_a"),
                    "phi_b": _relative(v, "flange_b"),
                    "flange_a.tau": tau_a,
                    "flange_b.tau": tau_b,
                },
            ),
        )


def _relative(v: Variables, flange: str) -> Row:
    return v.phi(flange) - v.phi("support")
