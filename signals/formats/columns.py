"""Tables of formats that hold each column as an array by itself, not all of one length."""

from collections import Counter
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.formats.open_table import OpenTable, Rows


@dataclass(frozen=True, eq=False)
class Column:
    """One column: its name, the unit that the file says (or nothing), and its values, shape (n,), NaN where missing."""

    name: str
    unit: str
    values: NDArray[np.float64]


def table_of(columns: Sequence[Column], kind: str) -> OpenTable:
    """Return the table of the columns that have as many values as most of them; of two such lengths the longer.

    `kind`: what the file is, in words.

    Raises:
        TelemetryError: if there are none.
    """
    rows = common_length([one.values.size for one in columns], kind)
    return in_memory([one for one in columns if one.values.size == rows])


def common_length(lengths: Sequence[int], kind: str) -> int:
    """Return the length that most columns have; of two such lengths the longer one.

    Raises:
        TelemetryError: if there are no columns of more than one value.
    """
    counted = Counter(length for length in lengths if length > 1)
    if not counted:
        raise TelemetryError(f"{kind} holds no columns of numbers: every channel has to be an array of its own")
    return max(counted, key=lambda length: (counted[length], length))


def in_memory(columns: Sequence[Column]) -> OpenTable:
    """Return the table of columns of one length."""

    def rows(places: Sequence[int], _: Container[int]) -> Iterator[Rows]:
        yield tuple(columns[place].values for place in places)

    return OpenTable(tuple(one.name for one in columns), rows, tuple(one.unit for one in columns))
