"""Coulomb friction: stuck, sliding forward or backward, and free when nothing presses (Modelica's PartialFriction)."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.errors import number
from sim.rotational.component import BACKWARD, FORWARD, FREE, STUCK, Row, Variables
from sim.rotational.components.tables import SpeedTable


@dataclass(frozen=True)
class Piece:
    """One branch of friction: its mode, the row that is zero, and the conditions of a `Branch`."""

    mode: int
    equation: Row
    holds: tuple[Row, ...]
    strict: tuple[Row, ...] = ()
    stops: tuple[Row, ...] = ()


def friction_pieces(
    v: Variables,
    tau: Row,
    speed: Row,
    acceleration: Row,
    torque_at: Callable[[Row], Row],
    peak: float,
    pressing: Row | None = None,
) -> tuple[Piece, ...]:
    """Return the branches of a friction torque `tau` against `speed`.

    `torque_at` gives the sliding torque as a row for a row |w|; stuck, the torque may reach `peak` times the one at
    standstill. Stuck stands before sliding: where both are possible, a shaft that came to rest stays at rest.
    """
    limit = peak * torque_at(0 * v.one)
    pressed = () if pressing is None else (pressing,)
    free = () if pressing is None else (Piece(FREE, tau, (-pressing,)),)
    return (
        *free,
        Piece(STUCK, acceleration, (limit - tau, limit + tau), pressed, stops=(speed,)),
        Piece(FORWARD, tau - torque_at(speed), (), (speed, *pressed)),
        Piece(BACKWARD, tau + torque_at(-speed), (), (-speed, *pressed)),
    )


def table_row(table: SpeedTable, v: Variables, speed: Row) -> Row:
    """Return the value of a straight table at the row |w|, as a row."""
    return float(table.at(0.0)[0]) * v.one + float(table.slopes()[0]) * speed


def check_peak(name: str, peak: object) -> float:
    """Return the ratio of the largest torque at rest to the one at the onset of sliding."""
    return number(f"{name}.peak", peak, "", at_least=1)
