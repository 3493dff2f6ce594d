"""Readers of telemetry tables: one file per format, one line in the catalogue. They run in the limited process."""

from collections.abc import Callable, Mapping
from pathlib import Path

from casebase.signals.formats.comma_separated import open_comma_separated
from casebase.signals.formats.layout import Wanted
from casebase.signals.formats.open_table import OpenTable
from casebase.signals.formats.parquet import open_parquet

READERS: Mapping[str, Callable[[Path, Wanted | None], OpenTable]] = {
    "csv": open_comma_separated,
    "parquet": open_parquet,
}
"""Format name to reader."""
