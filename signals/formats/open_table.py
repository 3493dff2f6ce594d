"""A table of a file that has been opened, but of which only the names of the columns have been read."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

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
