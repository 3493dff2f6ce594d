"""Spring: linear rotational spring."""

from dataclasses import dataclass

from sim.errors import number
from sim.rotational.component import Branch, Variables
from sim.rotational.components.compliant import Compliant


@dataclass(frozen=True)
class Spring(Compliant):
    """tau = c (phi_rel - phi_rel0); c stiffness [N.m/rad], phi_rel0 unstretched angle [rad]."""

    c: float
    phi_rel0: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        number("Spring.c", self.c, "N.m/rad", above=0)
        number("Spring.phi_rel0", self.phi_rel0, "rad")

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (self.piece(v, self.c * (v.phi_rel - self.phi_rel0 * v.one), 0 * v.one),)
