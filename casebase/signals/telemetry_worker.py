"""Telemetry tables, read in the limited process: known columns alone, so many values and no more."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from casebase.signals.errors import TelemetryError
from casebase.signals.formats import READERS
from casebase.signals.formats.open_table import OpenTable
from casebase.signals.limited_worker import RefusedError, Send
from casebase.signals.telemetry import CHANNELS, LARGEST_LOST_SHARE, LONGEST_NAME, MINIMUM_ROWS, MOST_COLUMNS

TIME = "time_s"


def read(request: Mapping[str, Any], limits: Mapping[str, float], send: Send) -> Mapping[str, Any]:
    """Task: read and check a table; send times, channels (float64) and where a channel is lost (bool), if asked for."""
    try:
        return _read(Path(request["path"]), int(limits["cells"]), send if request["send"] else lambda _: None)
    except TelemetryError as error:
        words = "".join(each if each.isprintable() else " " for each in str(error))
        raise RefusedError("telemetry", words[:2000]) from error


def _read(path: Path, cells: int, send: Send) -> Mapping[str, Any]:
    table = READERS[_format(path)](path)
    if len(table.names) > MOST_COLUMNS:
        raise TelemetryError(
            f"the table has {len(table.names)} columns; at most {MOST_COLUMNS} are read: leave out those that are "
            "no channel"
        )
    names = [name.strip().lstrip("\ufeff") for name in table.names]
    if TIME not in names:
        raise TelemetryError(f"no column time_s (time in seconds) in the table; it has {_listed(names)}")
    known = [name for name in CHANNELS if name in names]
    if not known:
        raise TelemetryError(
            f"no known channel in the table; it has {_listed(names)}, and would need one of {_listed(CHANNELS)}"
        )
    for name in (TIME, *known):
        if names.count(name) > 1:
            raise TelemetryError(f"the column {name} stands twice in the table; one of them must go")
    time_s, *values = _values(table, [table.names[names.index(name)] for name in (TIME, *known)], cells)
    _check_clock(time_s)
    lost = []
    send(time_s.data)
    for name, channel in zip(known, values, strict=True):
        filled, missing = _filled(name, time_s, channel)
        send(np.ascontiguousarray(filled).data)
        if missing is not None:
            lost.append(name)
            send(missing.data)
    ignored = [name[:LONGEST_NAME] for name in names if name != TIME and name not in CHANNELS]
    return {"rows": time_s.size, "channels": known, "lost": lost, "ignored": ignored}


def _values(table: OpenTable, columns: Sequence[str], cells: int) -> list[NDArray[np.float64]]:
    blocks: list[tuple[NDArray[np.float64], ...]] = []
    count = 0
    for rows in table.rows(columns):
        count += len(columns) * rows[0].size
        if count > cells:
            raise TelemetryError(
                f"the table has more than {cells // len(columns)} rows of {len(columns)} known columns; at most "
                f"{cells} values are read: cut it, or log every second sample"
            )
        blocks.append(rows)
    if not blocks:
        return [np.empty(0)] * len(columns)
    return [np.concatenate([block[place] for block in blocks]) for place in range(len(columns))]


def _format(path: Path) -> str:
    with path.open("rb") as file:
        start = file.read(4)
    if not start:
        raise TelemetryError("the telemetry file is empty; a CSV or Parquet table with a header is needed")
    return "parquet" if start == b"PAR1" else "csv"


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    shown = [name if len(name) <= 40 else name[:40] + "..." for name in names[:12]]
    return ", ".join(shown) + (", ..." if len(names) > 12 else "")


def _check_clock(time_s: NDArray[np.float64]) -> None:
    if time_s.size < MINIMUM_ROWS:
        raise TelemetryError(f"{time_s.size} rows are too few to say anything; at least {MINIMUM_ROWS} are needed")
    broken = np.flatnonzero(~np.isfinite(time_s))
    if broken.size:
        raise TelemetryError(f"time_s is missing or not finite in row {broken[0] + 1}; every row needs its time")
    backwards = np.flatnonzero(np.diff(time_s) <= 0)
    if backwards.size:
        row = int(backwards[0]) + 1
        raise TelemetryError(
            f"time_s does not run forwards: {time_s[row - 1]:.9g} s in row {row}, then {time_s[row]:.9g} s "
            f"({backwards.size} such places); sort the rows and remove doubles"
        )


def _filled(
    name: str, time_s: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        raise TelemetryError(f"{name} is infinite in row {infinite[0] + 1}; every value must be a finite number")
    missing = np.isnan(values)
    count = int(np.count_nonzero(missing))
    if count == 0:
        return values, None
    if count > LARGEST_LOST_SHARE * values.size:
        raise TelemetryError(
            f"{name} is missing or NaN in {count} of {values.size} rows; at most a tenth may be missing, "
            "or leave the column out"
        )
    whole = ~missing
    return np.interp(time_s, time_s[whole], values[whole]), missing
