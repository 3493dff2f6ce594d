"""Gearbox: no physics of its own; it connects a LossyGear and an ElastoBacklash, as Modelica's Gearbox and Gear2."""

from dataclasses import dataclass

from sim.rotational.component import Component
from sim.rotational.components.elasto_backlash import ElastoBacklash, Law
from sim.rotational.components.lossy_gear import IDEAL, LossyGear


@dataclass(frozen=True)
class Gearbox:
    """A gear with losses on the side of flange_a, then elasticity and backlash, felt at flange_b.

    Parameters
    ----------
    ratio, lossTable
        As of `LossyGear`.
    c, d, b
        Stiffness [N.m/rad], damping [N.m.s/rad], total backlash [rad], all after the reduction.
    law
        As of `ElastoBacklash`; `linear` gives Gear2 of Modelica 2.2.
    """

    ratio: float
    lossTable: object = IDEAL
    c: float = 1e5
    d: float = 0.0
    b: float = 0.0
    law: Law = "elasto"

    def __post_init__(self) -> None:
        self.parts()

    def parts(self) -> dict[str, Component]:
        """Components by name, in series from flange_a to flange_b."""
        return {
            "lossyGear": LossyGear(self.ratio, self.lossTable),
            "elastoBacklash": ElastoBacklash(c=self.c, d=self.d, b=self.b, law=self.law),
        }
