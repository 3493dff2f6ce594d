"""Tables over speed: straight between rows, and through the last two rows beyond them (Modelica's CombiTable1D)."""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.errors import ParameterError, number


@dataclass(frozen=True)
class SpeedTable:
    """Rows of |w| [rad/s] and values; one row is a constant. Built by `speed_table`, hashable."""

    rows: tuple[tuple[float, ...], ...]

    @cached_property
    def _speeds(self) -> list[float]:
        return [row[0] for row in self.rows]

    def at(self, w: float) -> NDArray[np.float64]:
        """Values at the speed |w|, shape (columns - 1,)."""
        return np.array(self.values(w))

    def values(self, w: float) -> list[float]:
        """Values at the speed |w|."""
        rows = self.rows
        if len(rows) == 1:
            return list(rows[0][1:])
        i = min(max(bisect_right(self._speeds, abs(w)) - 1, 0), len(rows) - 2)
        lower, upper = rows[i], rows[i + 1]
        share = (abs(w) - lower[0]) / (upper[0] - lower[0])
        return [low + share * (high - low) for low, high in zip(lower[1:], upper[1:], strict=True)]

    def slopes(self) -> NDArray[np.float64]:
        """Change of each value per rad/s of a straight table, shape (columns - 1,)."""
        return self.at(1.0) - self.at(0.0)

    @cached_property
    def straight(self) -> bool:
        """Whether all rows lie on one straight line, in every column."""
        table = np.array(self.rows)
        if len(table) <= 2:
            return True
        first = table[0] + np.outer((table[:, 0] - table[0, 0]) / (table[1, 0] - table[0, 0]), table[1] - table[0])
        return bool(np.allclose(first, table, rtol=1e-13, atol=0))

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


def straight_table(name: str, rows: object, columns: int) -> SpeedTable:
    """Return a checked table whose rows lie on one straight line.

    Raises
    ------
    ParameterError
        where a column bends: the law would change with the speed in another way than the exact solution has it.
    """
    table = speed_table(name, rows, columns)
    if not table.straight:
        raise ParameterError(f"{name}: the rows must lie on one straight line over the speed; no bent table is solved")
    return table


def _is_row(rows: object) -> bool:
    return isinstance(rows, list | tuple | np.ndarray) and len(rows) > 0 and np.ndim(rows[0]) == 0
