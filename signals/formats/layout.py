"""The layout of a table of text, recognised from its beginning: rows above the values, delimiter, decimal sign."""

import csv
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile

from signals.columns.units import are_units, unit_of
from signals.errors import TelemetryError

DELIMITERS = (";", "\t", ",", " ")
"""In this order: a comma may be a decimal sign where another of them parts the columns, and a blank part of a name."""
ALIKE_ROWS = 5
"""Rows of as many cells, all numbers or times, by which values are told from what stands above them."""
NUMBER = re.compile(r"\s*[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?\s*|\s*(nan|inf|-inf|null)?\s*", re.IGNORECASE)
NEW_LINE = re.compile(r"\r\n|\r|\n")
CLOCK = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*")


@dataclass(frozen=True)
class Layout:
    """The layout of a table of text.

    Args:
        first: rows above the first row of values.
        names: of the columns; their numbers from 1 where nothing stands above the values.
        units: what stands below the names in a row of units; else nothing.
        times: places of the columns, from 0, whose first value is a time of ISO 8601.
        delimiter: between columns.
        decimal: point or comma.
    """

    first: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    times: frozenset[int]
    delimiter: str
    decimal: str


@dataclass(frozen=True)
class Wanted:
    """What is said of a layout; None is recognised. Names and values stand somewhere below `skip_rows`."""

    header: bool | None = None
    delimiter: str | None = None
    decimal: str | None = None
    skip_rows: int = 0


def recognised(start: str, wanted: Wanted) -> Layout:
    """Return the layout of a table from its beginning, of which the last line may be cut off.

    Raises:
        TelemetryError: if there are no rows of values, naming the line of a channel map that would say where they are.
    """
    lines = NEW_LINE.split(start)[:-1]
    for are_values in (_are_all_values, _have_numbers):
        for delimiter in (wanted.delimiter,) if wanted.delimiter else DELIMITERS:
            rows = [_cells(line, delimiter) for line in lines]
            first = _first_values(rows, wanted, are_values)
            if first is not None and (len(rows[first]) > 1 or wanted.delimiter):
                decimal = wanted.decimal or ("," if delimiter != "," and _has_commas(rows[first:]) else ".")
                times = frozenset(place for place, cell in enumerate(rows[first]) if CLOCK.fullmatch(cell))
                return Layout(first, *_header(rows, first, wanted), times, delimiter, decimal)
    raise TelemetryError(
        "no rows of numbers are recognised in this table; say in a channel map where they are, such as skip_rows = 14, "
        'delimiter = ";", decimal = ","'
    )


def _cells(line: str, delimiter: str) -> list[str]:
    return next(csv.reader(io.StringIO(line), delimiter=delimiter), [])


def _first_values(
    rows: Sequence[Sequence[str]], wanted: Wanted, are_values: Callable[[Sequence[Sequence[str]]], bool]
) -> int | None:
    """The first of several rows of as many cells that are values."""
    for first in range(wanted.skip_rows, len(rows)):
        block = rows[first : first + ALIKE_ROWS]
        width = len(block[0])
        if width and len(block) == ALIKE_ROWS and all(len(row) == width for row in block) and are_values(block):
            return first
    return None


def _are_all_values(block: Sequence[Sequence[str]]) -> bool:
    """Whether every cell is a number, a time or empty, and no row is blank."""
    return all(any(cell.strip() for cell in row) and all(map(_is_value, row)) for row in block)


def _have_numbers(block: Sequence[Sequence[str]]) -> bool:
    """Whether some columns are numbers or times throughout, beside others of text, such as a state in words."""
    return sum(all(map(_is_value, column)) for column in zip(*block, strict=True)) > 1


def _is_value(cell: str) -> bool:
    return bool(NUMBER.fullmatch(cell) or CLOCK.fullmatch(cell))


def _has_commas(rows: Sequence[Sequence[str]]) -> bool:
    return any("," in cell for row in rows for cell in row)


def _header(rows: Sequence[Sequence[str]], first: int, wanted: Wanted) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names right above the values, their numbers where none stand there; and units in a row between."""
    width = len(rows[first])
    above = () if wanted.header is False else reversed(rows[wanted.skip_rows : first])
    headers = [tuple([*row, ""][:width]) for row in takewhile(lambda row: _is_above(row, rows[first]), above)]
    if len(headers) > 1 and are_units(headers[0]):
        return headers[1], headers[0]
    if len(headers) > 1 and any(map(_is_unit_below, headers[0], headers[1])):
        pairs = [(above, cell) if unit_of(cell) else (cell, "") for cell, above in zip(*headers[:2], strict=True)]
        return tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)
    return headers[0] if headers else tuple(str(number) for number in range(1, width + 1)), ()


def _is_unit_below(cell: str, above: str) -> bool:
    """Whether a cell of the row above the values is the unit of a name above it, beside others that are names."""
    return unit_of(cell) is not None and above.strip().isalpha() and unit_of(above) is None


def _is_above(row: Sequence[str], values: Sequence[str]) -> bool:
    """Whether a row has as many cells as the values below it, but for a delimiter behind the last of either."""
    more = len(row) - len(values)
    return more == 0 or (more == 1 and not row[-1].strip()) or (more == -1 and not values[-1].strip())
