"""Telemetry: named channels of an axis over one clock."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.reading.limited_pool import PAPERS, refusals_as
from signals.reading.plain_file import open_plain

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
        "known_torque_nm": "N m",
    }
)
"""Channels that are known, and their units. A linear axis has N and m where N m and rad stand."""

TIME = "time_s"
MINIMUM_ROWS = 100
LARGEST_LOST_SHARE = 0.1
MOST_COLUMNS = 10_000
LONGEST_MAP = 1 << 16
LONGEST_NAME = 200
"""Characters of a column's name that are kept where it is no channel."""


@dataclass(frozen=True, eq=False)
class Telemetry:
    """Channels of one measurement over one clock.

    Args:
        time_s: strictly ascending times, shape (n,) [s].
        channels: values by channel name, each of shape (n,), all finite; units in `CHANNELS`.
        lost: for a channel with missing values, where they were (True), shape (n,); `channels` holds the
            straight line between the neighbours there.
        ignored: columns of the file that are no known channel.
        recognised: the channel map that reading it amounted to, where columns were recognised by other names than the
            channels' own; else empty.
        first_s: what the clock of the table says at the first sample, where `time_s` is 0 [s].
    """

    time_s: NDArray[np.float64]
    channels: Mapping[str, NDArray[np.float64]]
    lost: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    recognised: str = ""
    first_s: float = 0.0

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


@dataclass(frozen=True)
class TelemetryLimits:
    """What reading one table may cost and yield.

    Args:
        seconds: time on the clock [s].
        cpu_seconds: processor time [s].
        memory_bytes: address space of the process that reads [byte].
        cells: values of time and known channels together [1]; as many as the largest upload holds uncompressed.
    """

    seconds: float = 60.0
    cpu_seconds: float = 30.0
    memory_bytes: int = 1 << 30
    cells: int = (200 << 20) // 8


LIMITS = TelemetryLimits()
TASK, COLUMNS_TASK = "signals.reading.telemetry_worker:read", "signals.reading.telemetry_worker:columns"
JOINTS_TASK = "signals.reading.telemetry_worker:joint_columns"


@dataclass(frozen=True)
class Recognition:
    """What is recognised of a table by the names and units of its columns.

    Args:
        map: lines of a channel map, with `...` where something has to be filled in; empty where the channels have their
            own names.
        open: what has to be filled in, in words; empty where the map reads the table as it is.
        columns: what each looks like, where that was asked for: `name`, and of one that holds numbers the `first`,
            `low`, `high`, its course `y` from 0 to 1, and whether it `rises` all the time, as a clock, or `moves`;
            and the place of the column that it is the `speed_of`.
    """

    map: str
    open: str
    columns: Sequence[Mapping[str, Any]] = ()


def read_telemetry(path: Path, limits: TelemetryLimits = LIMITS, *, channels: str | None = None) -> Telemetry:
    """Read a table of one of `signals.formats.READERS`, in the limited process.

    Columns are told by their names and units, where these leave no doubt (`recognised`).
    `channels`: text of a channel map, by which the table may be named, measured and laid out otherwise (see
    `signals.columns.channel_map`); rows at either end in which a channel is missing are then left out.

    Missing values (empty cells or NaN) become `lost` samples, filled along a straight line, as long as
    they are few. Columns that are no known channel are not looked at, and named in `ignored`.

    Raises:
        TelemetryError: if the table cannot be read; time or every known channel is missing, stands twice or is in
            doubt (with the lines of a channel map that would read it); the clock has missing values or does not run
            forwards; there are fewer than 100 rows or more than the limits allow; a value is infinite or no number;
            more than a tenth of a channel is missing; or reading takes more time or memory than the limits allow.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    return telemetry_of(*_read(path, channels, limits, send=True))


def telemetry_of(content: bytearray, found: Mapping[str, Any]) -> Telemetry:
    """Return what `signals.reading.telemetry_worker.read` sent, and said of it, as telemetry."""
    rows, names = int(found["rows"]), list(found["channels"])
    buffer, place = memoryview(content), 0

    def taken(kind: type[np.generic]) -> NDArray[Any]:
        nonlocal place
        width = rows * np.dtype(kind).itemsize
        place += width
        return np.frombuffer(buffer[place - width : place], dtype=kind)

    time_s = taken(np.float64)
    values, lost = {}, {}
    for name in names:
        values[name] = taken(np.float64)
        if name in found["lost"]:
            lost[name] = taken(np.bool_)
    told = found["recognised"], float(found["first_s"])
    return Telemetry(time_s, MappingProxyType(values), MappingProxyType(lost), tuple(found["ignored"]), *told)


def check_telemetry(path: Path, limits: TelemetryLimits = LIMITS, *, channels: str | None = None) -> None:
    """Read a table as `read_telemetry` does, and raise what that raises, without taking its values in."""
    _read(path, channels, limits, send=False)


@refusals_as(TelemetryError, "reading the table was given up ({})")
def recognise_columns(path: Path, limits: TelemetryLimits = LIMITS) -> Recognition:
    """Return what is recognised of a table by the names and units of its columns, and what these look like.

    Raises:
        TelemetryError: if it is no table.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    open_plain(path).close()
    largest = MOST_COLUMNS * (LONGEST_NAME + 100)
    _, found = PAPERS.perform(COLUMNS_TASK, {"path": str(path.absolute())}, asdict(limits), largest)
    return Recognition(**found)


@refusals_as(TelemetryError, "reading the table was given up ({})")
def recognise_joint_columns(
    path: Path,
    joints: Sequence[tuple[str, float | None]],
    given: Mapping[str, object],
    limits: TelemetryLimits = LIMITS,
) -> Recognition:
    """Return which columns of a robot's log are which channels of its joints (`signals.columns.joint_columns`).

    `joints`: name and gear ratio of each, in the robot's order; `given`: what a map without columns says.

    Raises:
        TelemetryError: if it is no table.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    open_plain(path).close()
    request = {"path": str(path.absolute()), "joints": [list(joint) for joint in joints], "given": given}
    _, found = PAPERS.perform(JOINTS_TASK, request, asdict(limits), LONGEST_MAP)
    return Recognition(**found)


@refusals_as(TelemetryError, "reading the table was given up ({}); export it again, with the known channels alone")
def _read(
    path: Path, channels: str | None, limits: TelemetryLimits, *, send: bool
) -> tuple[bytearray, Mapping[str, Any]]:
    open_plain(path).close()
    largest = MOST_COLUMNS * (12 * LONGEST_NAME + 4) + (9 * limits.cells if send else 0)
    request = {"path": str(path.absolute()), "send": send, "channels": channels}
    return PAPERS.perform(TASK, request, asdict(limits), largest)
