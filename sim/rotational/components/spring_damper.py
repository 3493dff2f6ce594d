"""SpringDamper: spring and damper in parallel."""

from dataclasses import dataclass

from sim.errors import number
from sim.rotational.component import Branch, Variables
from sim.rotational.components.compliant import Compliant


@dataclass(frozen=True)
class SpringDamper(Compliant):
    """tau = c (phi_rel - phi_rel0) + d w_rel; c [N.m/rad], d [N.m.s/rad], phi_rel0 [rad]."""

    c: float
    d: float
    phi_rel0: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        number("SpringDamper.c", self.c, "N.m/rad", above=0)
        number("SpringDamper.d", self.d, "N.m.s/rad", at_least=0)
        number("SpringDamper.phi_rel0", self.phi_rel0, "rad")

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau_d = self.d * v.w_rel
        return (self.piece(v, self.c * (v.phi_rel - self.phi_rel0 * v.one) + tau_d, tau_d),)
