"""CSV: UTF-8 or Latin-1, comma, header, decimal point."""

import codecs
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from casebase.signals.errors import TelemetryError

MAGIC = {
    b"RIFF": "a WAV file (a sound)",
    b"fLaC": "a FLAC file (a sound)",
    b"OggS": "an Ogg file (a sound)",
    b"PK": "an archive or a spreadsheet",
    b"\xff\xfe": "text in UTF-16",
}

BLOCK = 1 << 20


def read_comma_separated(path: Path) -> pa.Table:
    """Return the table of a CSV file; empty cells are missing values.

    Raises:
        TelemetryError: if it is no such table.
    """
    with path.open("rb") as file:
        start = file.read(4096)
    if b"\0" in start:  # what a parser says of such bytes cannot be read either
        kind = next((words for magic, words in MAGIC.items() if start.startswith(magic)), "a binary file")
        raise TelemetryError(
            f"this is {kind}, not a CSV table (UTF-8, comma between columns, a header, decimal point) or Parquet"
        )
    try:
        reading = csv.ReadOptions(encoding="utf8" if _is_utf8(path) else "latin-1")
        return csv.read_csv(path, read_options=reading, convert_options=csv.ConvertOptions(strings_can_be_null=True))
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise TelemetryError(
            f"not a CSV table (UTF-8, comma between columns, a header, decimal point): {error}"
        ) from error


def _is_utf8(path: Path) -> bool:
    """Whether a text is UTF-8; if not, a control of old wrote it in Latin-1, such as a header with °C."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        with path.open("rb") as file:
            while block := file.read(BLOCK):
                decoder.decode(block)
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return False
    return True
