"""Telemetry: named channels of an axis over one clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from casebase.signals.errors import TelemetryError

if TYPE_CHECKING:
    import pyarrow as pa

CHANNELS: Mapping[str, str] = MappingProxyType(
    {
        "motor_torque_nm": "N m",
        "motor_position_rad": "rad",
        "motor_speed_rad_s": "rad/s",
        "load_position_rad": "rad",
        "load_speed_rad_s": "rad/s",
        "shaft_torque_nm": "N m",
        "reference_position_rad": "rad",
        "temperature_degc": "Cel",
    }
)
"""Channels that are known, and their units. A linear axis has N and m where N m and rad stand."""

MINIMUM_ROWS = 100
LARGEST_LOST_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Telemetry:
    """Channels of one measurement over one clock.

    Args:
        time_s: strictly ascending times, shape (n,) [s].
        channels: values by channel name, each of shape (n,), all finite; units in `CHANNELS`.
        lost: for a channel with missing values, where they were (True), shape (n,); `channels` holds the
            straight line between the neighbours there.
        ignored: columns of the file that are no known channel.
    """

    time_s: NDArray[np.float64]
    channels: Mapping[str, NDArray[np.float64]]
    lost: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()

    def __getitem__(self, channel: str) -> NDArray[np.float64]:
        """Return one channel, shape (n,)."""
        return self.channels[channel]

    def __contains__(self, channel: object) -> bool:
        return channel in self.channels

    @property
    def rows(self) -> int:
        """Number of samples."""
        return int(self.time_s.size)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time_s[-1] - self.time_s[0])

    @cached_property
    def interval_s(self) -> float:
        """Median time between samples [s]; a gap in the clock is a larger step."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second, from the median interval [Hz]."""
        return 1.0 / self.interval_s

    def units(self) -> dict[str, str]:
        """Return the unit of each channel present."""
        return {name: CHANNELS[name] for name in self.channels}


def read_telemetry(path: Path) -> Telemetry:
    """Read a CSV or Parquet table with a header and a column `time_s`.

    Missing values (empty cells or NaN) become `lost` samples, filled along a straight line, as long as
    they are few. Columns that are no known channel are not looked at, and named in `ignored`.

    Raises:
        TelemetryError: if the table cannot be read; `time_s` or every known channel is missing, or stands
            twice; the clock has missing values or does not run forwards; there are fewer than 100 rows; a
            value is infinite or no number; or more than a tenth of a channel is missing.
    """
    from casebase.signals.formats import READERS  # pyarrow is slow to import, and who only hears needs none

    table = READERS[_format(path)](path)
    table = table.rename_columns([name.strip().lstrip("\ufeff") for name in table.column_names])
    if "time_s" not in table.column_names:
        raise TelemetryError(f"no column time_s (time in seconds) in the table; it has {_listed(table.column_names)}")
    known = [name for name in CHANNELS if name in table.column_names]
    if not known:
        raise TelemetryError(
            f"no known channel in the table; it has {_listed(table.column_names)}, "
            f"and would need one of {_listed(CHANNELS)}"
        )
    time_s = _numbers(table, "time_s")
    _check_clock(time_s)
    channels, lost = {}, {}
    for name in known:
        channels[name], missing = _filled(name, time_s, _numbers(table, name))
        if missing is not None:
            lost[name] = missing
    ignored = tuple(name for name in table.column_names if name != "time_s" and name not in CHANNELS)
    return Telemetry(time_s, MappingProxyType(channels), MappingProxyType(lost), ignored)


def _format(path: Path) -> str:
    with path.open("rb") as file:
        start = file.read(4)
    if not start:
        raise TelemetryError("the telemetry file is empty; a CSV or Parquet table with a header is needed")
    return "parquet" if start == b"PAR1" else "csv"


def _numbers(table: pa.Table, name: str) -> NDArray[np.float64]:
    if table.column_names.count(name) > 1:
        raise TelemetryError(f"the column {name} stands twice in the table; one of them must go")
    import pyarrow as pa

    column = table.column(name)
    try:
        values = column.cast(pa.float64()).to_numpy()
    except pa.ArrowException as error:
        raise TelemetryError(f"the column {name} holds something that is no number: {error}") from error
    return np.array(values, dtype=np.float64)


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
