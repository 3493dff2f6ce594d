"""Coulomb friction: stuck, sliding forward or backward, and free when nothing presses (Modelica's PartialFriction)."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from sim.errors import number
from sim.laws import friction
from sim.rotational.component import BACKWARD, FORWARD, FREE, STUCK, Branch, Component, Row, Variables
from sim.rotational.components.tables import SpeedTable


@dataclass(frozen=True)
class Piece:
    """One branch of friction: its mode, the row that is zero, and the conditions of a `Branch`."""

    mode: int
    equation: Row
    holds: tuple[Row, ...]
    strict: tuple[Row, ...] = ()
    stops: tuple[Row, ...] = ()


class Sliding(NamedTuple):
    """A piece of the torque of sliding friction, and the rows that are >= 0 while the speed lies on it."""

    torque: Row
    holds: tuple[Row, ...]


def friction_pieces(
    v: Variables,
    tau: Row,
    speed: Row,
    acceleration: Row,
    torques_at: Callable[[Row], list[Sliding]],
    peak: float,
    pressing: Row | None = None,
) -> tuple[Piece, ...]:
    """Return the branches of a friction torque `tau` against `speed`.

    `torques_at` gives, for a row |w|, the pieces of the sliding torque; stuck, the torque may reach `peak` times the
    one at standstill. Stuck stands before sliding: where both are possible, a shaft that came to rest stays at rest.
    """
    limit = peak * torques_at(0 * v.one)[0].torque
    pressed = () if pressing is None else (pressing,)
    free = () if pressing is None else (Piece(FREE, tau, (-pressing,)),)
    sliding = [
        Piece(way, tau - way * one.torque, one.holds, (way * speed, *pressed))
        for way in (FORWARD, BACKWARD)
        for one in torques_at(way * speed)
    ]
    return (*free, Piece(STUCK, acceleration, (limit - tau, limit + tau), pressed, stops=(speed,)), *sliding)


def sliding_torques(table: SpeedTable, v: Variables, speed: Row, factor: Row, gain: float = 1.0) -> list[Sliding]:
    """Return the pieces of the first column at the row |w|, times `factor`; what rises with the speed times `gain`."""
    out = []
    for line in table.lines:
        level, slope = float(line.levels[0]), float(line.slopes[0])
        at_rest, at_one = (friction(level, level, slope, slope, 0.0, 1.0, 2.0, 0.0, w, 1.0, 0.0) for w in (0.0, 1.0))
        out.append(Sliding(at_rest * factor + (at_one - at_rest) * gain * speed, line.holds(v, speed)))
    return out


class SupportFriction(Component):
    """Friction of a shaft against its support: phi_a = phi_b, tau_a + tau_b = tau."""

    peak: float

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = {"phi": "rad", "w": "rad/s", "tau": "N.m", "lossPower": "W", "mode": "1"}

    @property
    def unknowns(self) -> int:
        return 2

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    @abstractmethod
    def torques_at(self, v: Variables, speed: Row) -> list[Sliding]:
        """Return the pieces of the sliding torque at the row |w|."""

    def pressing(self, v: Variables) -> Row | None:
        """Return the normal force times geometry [N.m] that a signal sets; None where friction is always there."""
        return None

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        through, tau, pressing = v.unknown(0), v.unknown(1), self.pressing(v)
        phi, w, a = (row("flange_a") - row("support") for row in (v.phi, v.w, v.a))
        pieces = friction_pieces(v, tau, w, a, lambda speed: self.torques_at(v, speed), self.peak, pressing)
        return tuple(
            Branch(
                torques={"flange_a": through, "flange_b": tau - through, "support": -tau},
                equations=(piece.equation,),
                holds=piece.holds,
                strict=piece.strict,
                stops=piece.stops,
                mode=piece.mode,
                channels={"phi": phi, "w": w, "tau": tau, **self.more_channels(v)},
                powers={"lossPower": (tau, w)},
            )
            for piece in pieces
        )

    def more_channels(self, v: Variables) -> Mapping[str, Row]:
        """Return channels that only this kind has."""
        return {}


def check_peak(name: str, peak: object) -> float:
    """Return the ratio of the largest torque at rest to the one at the onset of sliding."""
    return number(f"{name}.peak", peak, "", at_least=1)
