"""A table of a file that has been opened, but of which only the names of the columns have been read."""

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from casebase.signals.errors import TelemetryError

Rows = tuple[NDArray[np.float64], ...]


def seconds_of(values: Sequence[object]) -> NDArray[np.float64]:
    """Times of ISO 8601 as seconds since 1970 [s], those without a zone as UTC; NaN where there is none.

    Raises:
        TelemetryError: naming the first that is none.
    """
    found = np.full(len(values), np.nan)
    for place, value in enumerate(values):
        if value is None or value == "":
            continue
        try:
            moment = value if isinstance(value, datetime) else datetime.fromisoformat(str(value).strip())
        except ValueError:
            raise TelemetryError(
                f"{str(value)[:40]!r} is no time of ISO 8601, such as 2026-11-28T08:30:00.250Z"
            ) from None
        found[place] = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return found


@dataclass(frozen=True)
class OpenTable:
    """A table.

    Args:
        names: of the columns, as they stand in the file.
        rows: by the places of some columns, from 0, and of those among them that hold times of ISO 8601, gives their
            values block by block, arrays of shape (rows,) in this order; a missing value is NaN. Raises TelemetryError.
        units: what stands below the names in a row of units, as many as names; else nothing.
        times: places of the columns, from 0, that hold times of ISO 8601 beyond doubt.
    """

    names: tuple[str, ...]
    rows: Callable[[Sequence[int], Container[int]], Iterator[Rows]]
    units: tuple[str, ...] = ()
    times: frozenset[int] = frozenset()
