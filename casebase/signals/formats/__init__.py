"""Readers of telemetry tables: one file per format, one line in the catalogue."""

from collections.abc import Callable, Mapping
from pathlib import Path

import pyarrow as pa

from casebase.signals.formats.comma_separated import read_comma_separated
from casebase.signals.formats.parquet import read_parquet

READERS: Mapping[str, Callable[[Path], pa.Table]] = {
    "csv": read_comma_separated,
    "parquet": read_parquet,
}
"""Format name to reader."""
