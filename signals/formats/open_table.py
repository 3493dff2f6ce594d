"""A table of a file that has been opened, but of which only the names of the columns have been read."""

import re
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError

Rows = tuple[NDArray[np.float64], ...]
FINER = re.compile(r"([.,]\d{6})\d+")
"""A fraction of a second beyond microseconds, which no clock of Python keeps."""


def seconds_of(values: Sequence[object], format_: str = "") -> NDArray[np.float64]:
    """Times of ISO 8601, or of a format of `strptime`, as seconds [s], those without a zone as UTC; NaN where none is.

    Raises:
        TelemetryError: naming the first that is none.
    """
    found = np.full(len(values), np.nan)
    for place, value in enumerate(values):
        if value is None or value == "":
            continue
        try:
            moment = value if isinstance(value, datetime) else _moment(FINER.sub(r"\1", str(value).strip()), format_)
        except (ValueError, re.error):
            kind = f"of the format {format_}" if format_ else "of ISO 8601, such as 2026-11-28T08:30:00.250Z"
            raise TelemetryError(f"{str(value)[:40]!r} is no time {kind}") from None
        found[place] = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return found


def _moment(text: str, format_: str) -> datetime:
    return datetime.strptime(text, format_) if format_ else datetime.fromisoformat(text)


@dataclass(frozen=True)
class OpenTable:
    """A table.

    Args:
        names: of the columns, as they stand in the file.
        rows: by the places of some columns, from 0, and the format of those among them that hold times (nothing for
            ISO 8601), gives their values block by block, arrays of shape (rows,) in this order; a missing value is
            NaN. Raises TelemetryError.
        units: what stands below the names in a row of units, as many as names; else nothing.
        times: places of the columns, from 0, that hold times of ISO 8601 beyond doubt.
    """

    names: tuple[str, ...]
    rows: Callable[[Sequence[int], Mapping[int, str]], Iterator[Rows]]
    units: tuple[str, ...] = ()
    times: frozenset[int] = frozenset()


@dataclass(frozen=True, eq=False)
class Column:
    """One column: its name, the unit that the file says (or nothing), and its values, shape (n,), NaN where missing."""

    name: str
    unit: str
    values: NDArray[np.float64]


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


def loaded(module: str, kind: str) -> Any:
    """Return a module of the extra `logs`.

    `kind`: what the file is, in words.

    Raises:
        TelemetryError: if it is not installed, with what installs it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise TelemetryError(
            f'this is {kind}; what reads it is not installed here: pip install "gearcase[logs]", or export it as CSV'
        ) from error
