"""Curves: numbers that depend on one row of the state, otherwise than by a factor; what is not affine has them."""

from dataclasses import dataclass
from enum import IntEnum

Table = tuple[tuple[float, ...], ...]


class Shape(IntEnum):
    """What a curve makes of s; the compiled formulas stand in `sim.runge_kutta.kernel.curve`."""

    TABLE = 0
    """Second column over the first at max(s, 0): straight between rows, and through the last two beyond them."""
    RECIPROCAL = 1
    """One over the second column."""
    DRIVER = 2
    """Of a loss table: torque at flange_a above which, rolling forward, flange_a drives."""
    SQUARE = 3
    """s^2."""
    SIGNED_SQUARE = 4
    """s |s|."""
    INVERSE = 5
    """1 / max(|s|, 1)."""
    EXP = 6
    """tanh(50 s), a smooth sign."""
    SINE = 7
    """sin(pi s / 2) up to 1, a smooth sign."""
    COSINE = 8
    """sign(s) (1 - cos(pi s / 2)) up to 1."""
    LINEAR = 9
    """s up to 1."""
    EDDY = 10
    """2 s / (1 + s^2) (Kloss)."""


@dataclass(frozen=True)
class Curve:
    """A shape with its table, rows of numbers; `positive` names what must be above zero, empty where nothing must."""

    shape: Shape
    table: Table = ()
    positive: str = ""
