"""Brake: friction of a shaft against its support under a normal force that a signal sets."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Row, Variables
from sim.rotational.components.clutch import Pressed
from sim.rotational.components.sliding import friction_pieces


@dataclass(frozen=True, kw_only=True)
class Brake(Pressed):
    """phi_a = phi_b, tau_a + tau_b = tau, friction against the support; parameters as of a clutch."""

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = {
        "phi": "rad",
        "w": "rad/s",
        "tau": "N.m",
        "fn": "N",
        "lossPower": "W",
        "mode": "1",
    }

    @property
    def unknowns(self) -> int:
        return 2

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        through, tau = v.unknown(0), v.unknown(1)
        w = v.w("flange_a") - v.w("support")
        a = v.a("flange_a") - v.a("support")
        pieces = friction_pieces(v, tau, w, a, lambda speed: self.torques_at(v, speed), self.peak, self.pressing(v))
        phi = v.phi("flange_a") - v.phi("support")
        return tuple(
            Branch(
                torques={"flange_a": through, "flange_b": tau - through, "support": -tau},
                equations=(piece.equation,),
                holds=piece.holds,
                strict=piece.strict,
                stops=piece.stops,
                mode=piece.mode,
                channels={"phi": phi, "w": w, "tau": tau, "fn": self.fn_max * v.signal(0)},
                powers={"lossPower": (tau, w)},
            )
            for piece in pieces
        )
