"""The files of a simulated run: tables as CSV or Parquet, changes of mode, sound."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from signals.telemetry import Telemetry
    from sim.rotational.trajectory import Event

SOUND_RATE_HZ = 8000
DECIMALS = 9


def write_table(columns: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Columns of equal length, every digit: Parquet where the name ends so, else CSV."""
    import pyarrow as pa

    table = pa.table(dict(columns))
    if path.suffix == ".parquet":
        from pyarrow import parquet

        parquet.write_table(table, path, use_dictionary=False)  # of numbers that hardly repeat
        return
    from pyarrow import csv

    csv.write_csv(table, path, csv.WriteOptions(quoting_style="none", quoting_header="none"))


def write_telemetry(telemetry: Telemetry, path: Path) -> None:
    """One row per sample, columns in SI units by the names of `signals.telemetry.CHANNELS`, to nine decimals.

    Parquet where the name ends so, else CSV.
    """
    columns = {"time_s": telemetry.time_s, **telemetry.channels}
    write_table({name: np.round(values, DECIMALS) + 0.0 for name, values in columns.items()}, path)  # no -0


def write_events(events: Iterable[Event], path: Path) -> None:
    """Changes of mode as CSV: time [s], component, the modes before and after in words."""
    rows = (f"{event.time_s!r},{event.component},{event.from_name},{event.to_name}\n" for event in events)
    path.write_text("time_s,component,from,to\n" + "".join(rows), encoding="utf-8")


def write_sound(sound: NDArray[np.float32], path: Path) -> None:
    """A WAV file of 16 bits at 8 kHz."""
    import soundfile

    soundfile.write(path, sound, SOUND_RATE_HZ, subtype="PCM_16")
