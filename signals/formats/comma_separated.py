"""CSV: UTF-8 or Latin-1, comma, header, decimal point; other layouts of text where they are asked for."""

import codecs
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

import pyarrow as pa
from pyarrow import csv

from signals.columns.table_kinds import table_kinds
from signals.errors import TelemetryError
from signals.formats.layout import Layout, Wanted, recognised
from signals.formats.open_table import OpenTable, Rows, seconds_of

TABLES = f"a table: {table_kinds('CSV (a header, decimal point)')}"
OTHERS = {
    b"RIFF": "a WAV file (a sound)",
    b"fLaC": "a FLAC file (a sound)",
    b"OggS": "an Ogg file (a sound)",
    b"PK": "an archive or a spreadsheet: export the sheet as CSV",
    b"MATLAB 7.3": "a MAT file of version 7.3: save it by save('log.mat', '-v7'), which is read",
    b"\x89HDF": "an HDF5 file: export its columns as CSV or Parquet",
    b"MDF ": "an MDF file: export its channels as MAT (version 5 or 7), CSV or Parquet",
    b"SQLite format 3": "a database, such as a ROS 2 bag of old: ros2 bag convert makes an MCAP file of it",
    b"#ROSBAG": "a bag of ROS 1: rosbags-convert makes an MCAP file of it",
}
"""What is not read, by its first bytes: what it is, and what to do."""

BLOCK = 1 << 20
BEGINNING = 1 << 16
"""Bytes by which a layout is recognised [byte]."""
UTF16 = (b"\xff\xfe", b"\xfe\xff")
NO_NUMBER = re.compile(r"In CSV column #(\d+): (?:Row #(\d+): )?CSV conversion error to double: (.*)", re.DOTALL)


def open_comma_separated(path: Path, wanted: Wanted | None = None) -> OpenTable:
    """Return the table of a CSV file; empty cells are missing values.

    Without `wanted` it has a comma, a decimal point and a header on top; else its layout is recognised.

    Raises:
        TelemetryError: if it is no such table.
    """
    with path.open("rb") as file:
        start = file.read(BEGINNING)
    wide = start.startswith(UTF16)
    if b"\0" in start and not wide:  # what a parser says of such bytes cannot be read either
        kind = next((words for magic, words in OTHERS.items() if start.startswith(magic)), "a binary file")
        raise TelemetryError(f"this is {kind}. What is read is {TABLES}")
    encoding = "utf-16" if wide else "utf8" if _is_utf8(path) else "latin-1"
    layout = None
    if wanted is not None or wide:
        layout = recognised(start.decode(encoding, errors="ignore").lstrip("\ufeff"), wanted or Wanted())
        names = layout.names
    else:
        try:
            with _opened(path, encoding, None) as reader:
                names = tuple(reader.schema.names)
        except (pa.ArrowException, UnicodeDecodeError) as error:
            raise _no_table(error) from error
    rows = partial(_rows, path, encoding, layout, names)
    return OpenTable(names, rows) if layout is None else OpenTable(names, rows, layout.units, layout.times)


def _opened(
    path: Path, encoding: str, layout: Layout | None, columns: Mapping[str, pa.DataType] = MappingProxyType({})
) -> csv.CSVStreamingReader:
    """Open a table; one whose layout was recognised has the numbers of its columns for names."""
    reading = csv.ReadOptions(encoding=encoding, block_size=BLOCK, use_threads=False)
    parsing, decimal = csv.ParseOptions(), "."
    if layout is not None:
        numbers = [str(number) for number in range(len(layout.names))]
        reading = csv.ReadOptions(
            encoding=encoding, block_size=BLOCK, use_threads=False, skip_rows=layout.first, column_names=numbers
        )
        parsing, decimal = csv.ParseOptions(delimiter=layout.delimiter), layout.decimal
    converting = csv.ConvertOptions(
        strings_can_be_null=True, include_columns=list(columns), column_types=dict(columns), decimal_point=decimal
    )
    return csv.open_csv(path, read_options=reading, parse_options=parsing, convert_options=converting)


def _rows(
    path: Path,
    encoding: str,
    layout: Layout | None,
    names: Sequence[str],
    places: Sequence[int],
    times: Mapping[int, str],
) -> Iterator[Rows]:
    called = {place: names[place] if layout is None else str(place) for place in places}
    types = {called[place]: pa.string() if place in times else pa.float64() for place in places}
    try:
        with _opened(path, encoding, layout, types) as reader:
            for batch in reader:
                yield tuple(
                    seconds_of(batch.column(called[place]).to_pylist(), times[place])
                    if place in times
                    else batch.column(called[place]).to_numpy(zero_copy_only=False)
                    for place in places
                )
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
