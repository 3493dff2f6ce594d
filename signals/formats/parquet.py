"""Apache Parquet."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from signals.errors import TelemetryError
from signals.formats.layout import Wanted
from signals.formats.open_table import OpenTable, Rows, seconds_of

ROWS_AT_A_TIME = 1 << 16


def open_parquet(path: Path, wanted: Wanted | None = None) -> OpenTable:
    """Return the table of a Parquet file.

    Raises:
        TelemetryError: if it is no such table.
    """
    try:
        file = parquet.ParquetFile(path)
        names = tuple(file.schema_arrow.names)
    except (pa.ArrowException, OSError) as error:
        raise TelemetryError(f"not a readable Parquet table: {error}") from error

    def rows(places: Sequence[int], times: Mapping[int, str]) -> Iterator[Rows]:
        columns = [names[place] for place in places]
        try:
            for batch in file.iter_batches(ROWS_AT_A_TIME, columns=columns, use_threads=False):
                yield tuple(
                    seconds_of(batch.column(names[place]).to_pylist(), times[place])
                    if place in times
                    else _numbers(names[place], batch.column(names[place]))
                    for place in places
                )
        except (pa.ArrowException, OSError) as error:
            raise TelemetryError(f"the Parquet table breaks off: {error}") from error

    times = frozenset(place for place, each in enumerate(file.schema_arrow.types) if pa.types.is_timestamp(each))
    return OpenTable(names, rows, times=times)


def _numbers(name: str, column: pa.Array) -> NDArray[np.float64]:
    try:
        numbers: NDArray[np.float64] = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
    except pa.ArrowException as error:
        raise TelemetryError(f"the column {name} holds something that is no number: {error}") from error
    return numbers
