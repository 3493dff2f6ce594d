"""Tables over speed: straight between rows, and through the last two rows beyond them (Modelica's CombiTable1D)."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import ParameterError, number
from sim.rotational.component import Row, Variables

Array = NDArray[np.float64]


class Line(NamedTuple):
    """A straight piece of a table, between the speeds `low` and `high` [rad/s]: each value is level + slope |w|."""

    low: float
    high: float
    levels: Array
    slopes: Array

    def holds(self, v: Variables, turns: Row) -> tuple[Row, ...]:
        """Rows that are >= 0 while the speed `turns` lies on this piece."""
        above = (turns - self.low * v.one,) if self.low > 0 else ()
        return (*above, self.high * v.one - turns) if self.high < inf else above


@dataclass(frozen=True)
class SpeedTable:
    """Rows of |w| [rad/s] and values; one row is a constant. Built by `speed_table`, hashable."""

    rows: tuple[tuple[float, ...], ...]

    @cached_property
    def lines(self) -> tuple[Line, ...]:
        """Straight pieces from standstill on; the first and the last reach beyond the rows."""
        table = np.array(self.rows)
        if self.constant:
            return (Line(0.0, inf, table[0, 1:], 0.0 * table[0, 1:]),)
        slopes = np.diff(table[:, 1:], axis=0) / np.diff(table[:, 0])[:, None]
        bends = [i for i in range(1, len(slopes)) if not np.allclose(slopes[i], slopes[i - 1], rtol=1e-12, atol=0)]
        edges = [0.0, *table[bends, 0].tolist(), inf]
        return tuple(
            Line(low, high, table[i, 1:] - slopes[i] * table[i, 0], slopes[i])
            for i, (low, high) in zip([0, *bends], pairwise(edges), strict=True)
        )

    @property
    def at_rest(self) -> Array:
        """Values at standstill, shape (columns - 1,)."""
        return self.lines[0].levels

    @cached_property
    def constant(self) -> bool:
        """Whether no value depends on the speed."""
        return all(row[1:] == self.rows[0][1:] for row in self.rows)


def speed_table(name: str, rows: object, columns: int) -> SpeedTable:
    """Return a checked table of `columns` columns; the first, |w|, begins at 0 or above and ascends.

    Raises
    ------
    ParameterError
        naming the row and column that is wrong.
    """
    table = [rows] if _is_row(rows) else rows
    if not isinstance(table, list | tuple | np.ndarray) or len(table) == 0:
        raise ParameterError(f"{name}: must be rows of {columns} numbers, got {rows!r}")
    checked: list[tuple[float, ...]] = []
    for i, row in enumerate(table):
        if not isinstance(row, list | tuple | np.ndarray) or len(row) != columns:
            raise ParameterError(f"{name}: row {i} must have {columns} numbers, got {row!r}")
        checked.append(tuple(number(f"{name}[{i}][{j}]", x, "", at_least=0) for j, x in enumerate(row)))
        if i and checked[i][0] <= checked[i - 1][0]:
            raise ParameterError(f"{name}[{i}][0]: speeds must ascend, got {checked[i][0]:g} rad/s")
    return SpeedTable(tuple(checked))


def _is_row(rows: object) -> bool:
    return isinstance(rows, list | tuple | np.ndarray) and len(rows) > 0 and np.ndim(rows[0]) == 0
