"""BearingFriction: Coulomb friction of a shaft in its bearings, with stick-slip."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from sim.rotational.component import Branch, Component, Row, Variables
from sim.rotational.components.sliding import check_peak, friction_pieces, sliding_torques
from sim.rotational.components.tables import SpeedTable, speed_table


@dataclass(frozen=True)
class BearingFriction(Component):
    """phi_a = phi_b, tau_a + tau_b = tau, which opposes the speed w against the support.

    Parameters
    ----------
    tau_pos
        Rows [w, tau]: friction torque [N.m] over speed [rad/s] for w >= 0; the same, turned round, backward.
    peak
        Torque that breaks the shaft away over torque at the onset of sliding, >= 1.
    """

    tau_pos: object = ((0.0, 1.0),)
    peak: float = 1.0

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = {"phi": "rad", "w": "rad/s", "tau": "N.m", "lossPower": "W", "mode": "1"}

    def __post_init__(self) -> None:
        object.__setattr__(self, "tau_pos", speed_table("BearingFriction.tau_pos", self.tau_pos, 2).rows)
        check_peak("BearingFriction", self.peak)

    @cached_property
    def table(self) -> SpeedTable:
        return SpeedTable(self.tau_pos)  # type: ignore[arg-type]

    @property
    def unknowns(self) -> int:
        return 2

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        through, tau = v.unknown(0), v.unknown(1)
        w = v.w("flange_a") - v.w("support")
        a = v.a("flange_a") - v.a("support")
        pieces = friction_pieces(v, tau, w, a, lambda speed: sliding_torques(self.table, v, speed, v.one), self.peak)
        return tuple(
            Branch(
                torques={"flange_a": through, "flange_b": tau - through, "support": -tau},
                equations=(piece.equation,),
                holds=piece.holds,
                strict=piece.strict,
                stops=piece.stops,
                mode=piece.mode,
                channels={"phi": v.phi("flange_a") - v.phi("support"), "w": w, "tau": tau},
                powers={"lossPower": (tau, w)},
            )
            for piece in pieces
        )
