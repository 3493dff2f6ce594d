"""CSV: UTF-8, comma, header, decimal point."""

from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from casebase.signals.errors import TelemetryError


def read_comma_separated(path: Path) -> pa.Table:
    """Return the table of a CSV file; empty cells are missing values.

    Raises:
        TelemetryError: if it is no such table.
    """
    try:
        return csv.read_csv(path, convert_options=csv.ConvertOptions(strings_can_be_null=True))
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise TelemetryError(
            f"not a CSV table (UTF-8, comma between columns, a header, decimal point): {error}"
        ) from error
