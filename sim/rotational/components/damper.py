"""Damper: linear rotational damper."""

from dataclasses import dataclass

from sim.errors import number
from sim.rotational.component import Branch, Variables
from sim.rotational.components.compliant import Compliant


@dataclass(frozen=True)
class Damper(Compliant):
    """tau = d w_rel; d damping [N.m.s/rad]."""

    d: float

    def __post_init__(self) -> None:
        super().__post_init__()
        number("Damper.d", self.d, "N.m.s/rad", at_least=0)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = self.d * v.w_rel
        return (self.piece(v, tau, tau),)
