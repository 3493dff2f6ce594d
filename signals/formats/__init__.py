"""Readers of telemetry tables: a function per format, a line in the catalogue. They run in the limited process."""

from collections.abc import Callable, Mapping
from pathlib import Path

from signals.formats.comma_separated import open_comma_separated
from signals.formats.layout import Wanted
from signals.formats.logs import open_codesys, open_matlab, open_mcap, open_parquet, open_tdms
from signals.formats.open_table import OpenTable

Reader = Callable[[Path, Wanted | None], OpenTable]

READERS: Mapping[bytes, Reader] = {
    b"PAR1": open_parquet,
    b"\x89MCAP0\r\n": open_mcap,
    b"MATLAB 5.0 MAT-file": open_matlab,
    b"TDSm": open_tdms,
    b"[key]; [value]": open_codesys,
    b"": open_comma_separated,
}
"""What a file begins with to its reader; the first that fits. What begins like no other is text.

Names and endings of all of them stand in `signals.columns.table_kinds`."""


def reader_of(start: bytes) -> Reader:
    """Return the reader of a file that begins so."""
    return next(reader for magic, reader in READERS.items() if start.startswith(magic))
