"""Brake: friction of a shaft against its support under a normal force that a signal sets."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Row, Variables
from sim.rotational.components.clutch import Pressed
from sim.rotational.components.sliding import SupportFriction


@dataclass(frozen=True, kw_only=True)
class Brake(Pressed, SupportFriction):
    """phi_a = phi_b, tau_a + tau_b = tau, friction against the support; parameters as of a clutch."""

    units: ClassVar[Mapping[str, str]] = {**SupportFriction.units, "fn": "N"}

    def more_channels(self, v: Variables) -> Mapping[str, Row]:
        return {"fn": self.fn_max * v.signal(0)}
