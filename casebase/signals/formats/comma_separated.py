"""CSV: UTF-8 or Latin-1, comma, header, decimal point."""

import codecs
import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from casebase.signals.errors import TelemetryError
from casebase.signals.formats.open_table import OpenTable, Rows

MAGIC = {
    b"RIFF": "a WAV file (a sound)",
    b"fLaC": "a FLAC file (a sound)",
    b"OggS": "an Ogg file (a sound)",
    b"PK": "an archive or a spreadsheet",
    b"\xff\xfe": "text in UTF-16",
}

BLOCK = 1 << 20
NO_NUMBER = re.compile(r"In CSV column #(\d+): (?:Row #(\d+): )?CSV conversion error to double: (.*)", re.DOTALL)


def open_comma_separated(path: Path) -> OpenTable:
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
    encoding = "utf8" if _is_utf8(path) else "latin-1"
    try:
        with _opened(path, encoding) as reader:
            names = tuple(reader.schema.names)
    except (pa.ArrowException, UnicodeDecodeError) as error:
        raise _no_table(error) from error
    return OpenTable(names, partial(_rows, path, encoding, names))


def _opened(path: Path, encoding: str, columns: Sequence[str] = ()) -> csv.CSVStreamingReader:
    reading = csv.ReadOptions(encoding=encoding, block_size=BLOCK, use_threads=False)
    types = dict.fromkeys(columns, pa.float64())
    converting = csv.ConvertOptions(strings_can_be_null=True, include_columns=list(columns), column_types=types)
    return csv.open_csv(path, read_options=reading, convert_options=converting)


def _rows(path: Path, encoding: str, names: Sequence[str], wanted: Sequence[str]) -> Iterator[Rows]:
    try:
        with _opened(path, encoding, wanted) as reader:
            for batch in reader:
                yield tuple(batch.column(name).to_numpy(zero_copy_only=False) for name in wanted)
    except (pa.ArrowException, UnicodeDecodeError) as error:
        if match := NO_NUMBER.search(str(error)):
            where = f" in row {match[2]}" if match[2] else ""
            column = names[int(match[1])].strip()
            raise TelemetryError(f"the column {column} holds something that is no number{where}: {match[3]}") from error
        raise _no_table(error) from error


def _no_table(error: Exception) -> TelemetryError:
    return TelemetryError(f"not a CSV table (UTF-8, comma between columns, a header, decimal point): {error}")


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
