"""Apache Parquet."""

from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from casebase.signals.errors import TelemetryError

LARGEST_CELLS = 200_000_000


def read_parquet(path: Path) -> pa.Table:
    """Return the table of a Parquet file.

    Raises:
        TelemetryError: if it is no such table or unpacks to more than 200 million cells.
    """
    try:
        with parquet.ParquetFile(path) as file:
            cells = file.metadata.num_rows * file.metadata.num_columns
            if cells > LARGEST_CELLS:
                raise TelemetryError(f"the table claims {cells} cells; at most {LARGEST_CELLS} are read")
            return file.read()
    except (pa.ArrowException, OSError) as error:
        raise TelemetryError(f"not a readable Parquet table: {error}") from error
