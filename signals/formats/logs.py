"""Logs of programs that write no CSV: Parquet, CODESYS, MATLAB, LabVIEW (TDMS), ROS 2 (MCAP)."""

import re
import struct
import zlib
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from signals.errors import TelemetryError
from signals.formats.layout import Wanted
from signals.formats.open_table import Column, OpenTable, Rows, common_length, in_memory, loaded, seconds_of

ROWS_AT_A_TIME = 1 << 16


def open_parquet(path: Path, wanted: Wanted | None = None) -> OpenTable:
    """Return the table of a Parquet file.

    Raises:
        TelemetryError: if it is no such table.
    """
    try:
        file = parquet.ParquetFile(path)
        names = tuple(file.schema_arrow.names)
    except (pa.ArrowException, OSError) as error:
        raise TelemetryError(f"not a readable Parquet table: {error}") from error

    def rows(places: Sequence[int], times: Mapping[int, str]) -> Iterator[Rows]:
        columns = [names[place] for place in places]
        try:
            for batch in file.iter_batches(ROWS_AT_A_TIME, columns=columns, use_threads=False):
                yield tuple(
                    seconds_of(batch.column(names[place]).to_pylist(), times[place])
                    if place in times
                    else _numbers(names[place], batch.column(names[place]))
                    for place in places
                )
        except (pa.ArrowException, OSError) as error:
            raise TelemetryError(f"the Parquet table breaks off: {error}") from error

    times = frozenset(place for place, each in enumerate(file.schema_arrow.types) if pa.types.is_timestamp(each))
    return OpenTable(names, rows, times=times)


def _numbers(name: str, column: pa.Array) -> NDArray[np.float64]:
    try:
        numbers: NDArray[np.float64] = column.cast(pa.float64()).to_numpy(zero_copy_only=False)
    except pa.ArrowException as error:
        raise TelemetryError(f"the column {name} holds something that is no number: {error}") from error
    return numbers


CODESYS = "a trace of CODESYS"
VARIABLE = re.compile(r"\d+\.Variable; *(.*)")
PAIR = re.compile(r"(?:\d+\.Data)?; *([-+.\deE]+); *([-+.\deE]+)")


def open_codesys(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of the variables by their names, over the stamps of the first, `time`, whose unit no key says.

    Raises:
        TelemetryError: if there are no variables with values.
    """
    names: list[str] = []
    pairs: list[list[tuple[float, float]]] = []
    for line in _lines_of(path):
        if match := VARIABLE.fullmatch(line):
            names.append(match[1].strip())
            pairs.append([])
        elif pairs and (match := PAIR.fullmatch(line)):
            try:
                pairs[-1].append((float(match[1]), float(match[2])))
            except ValueError:
                raise TelemetryError(f"{CODESYS}: {line[:60]!r} holds something that is no number") from None
    blocks = [(name, np.array(block)) for name, block in zip(names, pairs, strict=True) if len(block) > 1]
    if not blocks:
        raise TelemetryError(
            f"{CODESYS} without values; save it while it holds some, or export its variables as a table"
        )
    times = blocks[0][1][:, 0]
    if any(np.diff(block[:, 0]).min() < 0.0 for _, block in blocks):
        raise TelemetryError(f"{CODESYS} whose stamps do not run forwards")
    columns = [Column(name, "", np.interp(times, block[:, 0], block[:, 1])) for name, block in blocks]
    return in_memory([Column("time", "", times), *columns])


def _lines_of(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            yield line.strip()


MATLAB = "the MAT file"
DEEPEST = 8
"""Structures within structures that are looked into."""


def open_matlab(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of a MAT file: `q`, a field as `log.q`, the columns of a matrix as `q[1]`, `q[2]`.

    Objects (timeseries, table, timetable) are no arrays and are left out.

    Raises:
        TelemetryError: if it is no such file or holds no columns of numbers.
    """
    from scipy import io  # of all formats this one alone pays for it

    try:
        variables = io.loadmat(path)
    except (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, NotImplementedError, zlib.error) as error:
        raise TelemetryError(f"{MATLAB} cannot be read: {error}") from error
    except io.matlab.MatReadError as error:
        raise TelemetryError(f"{MATLAB} cannot be read: {error}") from error
    arrays = [
        each
        for name, value in variables.items()
        if not name.startswith("__")
        for each in _matlab_arrays(name, value, DEEPEST)
    ]
    try:
        rows = common_length([max(array.shape) for _, array in arrays], MATLAB)
    except TelemetryError as error:
        raise TelemetryError(
            f"{error}; a timeseries, a table or a timetable is none: save its numbers, such as t = x.Time, q = x.Data"
        ) from None
    return in_memory([column for name, array in arrays for column in _matlab_columns(name, array, rows)])


def _matlab_arrays(name: str, value: Any, deep: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Arrays of numbers with at most two dimensions, below their names."""
    if not isinstance(value, np.ndarray) or value.size == 0:
        return
    if value.dtype.names:
        if value.size == 1 and deep:
            for field in value.dtype.names:
                yield from _matlab_arrays(f"{name}.{field}", value[field].flat[0], deep - 1)
    elif value.dtype.kind in "biuf" and (array := np.squeeze(value)).ndim in (1, 2):
        yield name, array.astype(np.float64)


def _matlab_columns(name: str, array: NDArray[np.float64], rows: int) -> Iterator[Column]:
    """The columns of an array, whichever way it lies, if it has so many rows."""
    if array.ndim == 1 and array.size == rows:
        yield Column(name, "", array)
    elif array.ndim == 2 and rows in array.shape:
        table = array if array.shape[0] == rows else array.T
        for place in range(table.shape[1]):
            yield Column(f"{name}[{place + 1}]", "", np.ascontiguousarray(table[:, place]))


TDMS = "a TDMS file (LabVIEW)"
BROKEN_TDMS = (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, OverflowError, struct.error)
UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "Unit")
"""Properties of a channel in which LabVIEW and its recorders say the unit."""
STEP, START = "wf_increment", "wf_start_offset"


def open_tdms(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of those channels that have as many values as most; several groups are named before theirs.

    Where every channel is a waveform of one step, its clock is the first column, `time`.

    Raises:
        TelemetryError: if it is no such file, holds no numbers, or what reads it is not installed.
    """
    reader = loaded("nptdms", TDMS).TdmsFile
    try:
        file = reader.read_metadata(path)
        channels = [one for group in file.groups() for one in group.channels() if one.dtype.kind in "biufM"]
        count = common_length([len(one) for one in channels], TDMS)
        channels = [one for one in channels if len(one) == count]
        several = len({one.group_name for one in channels}) > 1
        names = [f"{one.group_name}/{one.name}" if several else str(one.name) for one in channels]
        units = [
            next((str(one.properties[key]) for key in UNIT_PROPERTIES if one.properties.get(key)), "")
            for one in channels
        ]
        steps = {(one.properties.get(STEP), one.properties.get(START, 0.0)) for one in channels}
        clock = [_tdms_clock(count, *each) for each in steps if len(steps) == 1 and each[0]]
    except TelemetryError:
        raise
    except BROKEN_TDMS as error:
        raise TelemetryError(f"{TDMS} that cannot be read: {error}") from error
    ahead = len(clock)

    def rows(places: Sequence[int], _: Container[int]) -> Iterator[Rows]:
        try:
            with reader.open(path) as opened:
                yield tuple(
                    clock[place] if place < ahead else _tdms_values(opened, channels[place - ahead]) for place in places
                )
        except BROKEN_TDMS as error:
            raise TelemetryError(f"the TDMS file breaks off: {error}") from error

    times = frozenset(place + ahead for place, one in enumerate(channels) if one.dtype.kind == "M")
    return OpenTable(("time",) * ahead + tuple(names), rows, ("s",) * ahead + tuple(units), times)


def _tdms_clock(count: int, step: Any, start: Any) -> NDArray[np.float64]:
    return np.arange(count, dtype=np.float64) * float(step) + float(start)


def _tdms_values(opened: Any, channel: Any) -> NDArray[np.float64]:
    values = opened[channel.group_name][channel.name][:]
    if values.dtype.kind == "M":
        return np.asarray(values.astype("datetime64[ns]").astype(np.int64) * 1e-9)
    return np.asarray(values, dtype=np.float64)


MCAP = "an MCAP file (a ROS 2 bag)"
BROKEN_MCAP = (ValueError, KeyError, IndexError, AttributeError, OSError, RuntimeError, struct.error)
"""What decoding raises beside errors of its own; RuntimeError is that of LZ4."""
MESSAGE = "sensor_msgs/msg/JointState"
UNITS_OF_JOINTS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
"""By field of the message: its unit, as REP 103 has it."""


class _Topic:
    """What one topic says: times, and values by field and joint, each with the number of its message."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.values: dict[tuple[str, str], tuple[list[int], list[float]]] = {}

    def take(self, message: Any, logged_ns: int) -> None:
        stamp = message.header.stamp
        seconds = stamp.sec + 1e-9 * stamp.nanosec
        number = len(self.times)
        self.times.append(seconds if seconds else 1e-9 * logged_ns)
        for field in UNITS_OF_JOINTS:
            for joint, value in zip(message.name, getattr(message, field), strict=False):
                numbers, values = self.values.setdefault((joint, field), ([], []))
                numbers.append(number)
                values.append(value)


def open_mcap(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of the joint states: `time` from the first message on, `position[elbow]` and so on.

    Of several topics each has its own clock and its name before its columns'.

    Raises:
        TelemetryError: if it is no such file, holds no joint states, or what reads it is not installed.
    """
    reader = loaded("mcap.reader", MCAP)
    factory = loaded("mcap_ros2.decoder", MCAP).DecoderFactory
    broken = (loaded("mcap.exceptions", MCAP).McapError, loaded("zstandard", MCAP).ZstdError, *BROKEN_MCAP)
    topics: dict[str, _Topic] = {}
    others: dict[str, str] = {}
    try:
        with path.open("rb") as file:
            opened = reader.make_reader(file, decoder_factories=[factory()])
            summary = opened.get_summary()
            for channel in () if summary is None else summary.channels.values():
                others[channel.topic] = summary.schemas[channel.schema_id].name if channel.schema_id else "no type"
            wanted = [topic for topic, kind in others.items() if kind == MESSAGE]
            for one in opened.iter_decoded_messages(topics=wanted, log_time_order=False) if wanted else ():
                topics.setdefault(one.channel.topic, _Topic()).take(one.decoded_message, one.message.log_time)
    except broken as error:
        raise TelemetryError(
            f"{MCAP} that cannot be read ({error}); one that was not closed is made whole by: mcap recover"
        ) from error
    if not topics:
        listed = ", ".join(f"{topic} ({kind})" for topic, kind in list(others.items())[:12])
        raise TelemetryError(f"{MCAP} without joint states ({MESSAGE}); it has {listed or 'no messages'}")
    return _topics_table(topics)


def _topics_table(topics: dict[str, _Topic]) -> OpenTable:
    before = {topic: f"{topic} " if len(topics) > 1 else "" for topic in topics}
    columns: list[tuple[str, str, tuple[str, tuple[str, str] | None]]] = []
    for topic, said in topics.items():
        columns.append((f"{before[topic]}time", "s", (topic, None)))
        columns += [
            (f"{before[topic]}{field}[{joint}]", UNITS_OF_JOINTS[field], (topic, (joint, field)))
            for joint, field in said.values
        ]

    def rows(places: Sequence[int], _: Container[int]) -> Iterator[Rows]:
        chosen = [columns[place][2] for place in places]
        from_ = {topic for topic, _ in chosen}
        if len(from_) > 1:
            raise TelemetryError(f"the channels are of topics with clocks of their own: {', '.join(sorted(from_))}")
        said = topics[from_.pop()]
        kept = _topic_messages(said, [key for _, key in chosen if key is not None])
        yield tuple(_topic_values(said, key)[kept] for _, key in chosen)

    return OpenTable(tuple(name for name, *_ in columns), rows, tuple(unit for _, unit, _ in columns))


def _topic_messages(said: _Topic, keys: Sequence[tuple[str, str]]) -> NDArray[np.int64]:
    """The messages that say one of these at least: others are of other joints of the same topic."""
    numbers = [said.values[key][0] for key in keys] or [list(range(len(said.times)))]
    return np.unique(np.concatenate(numbers)).astype(np.int64)


def _topic_values(said: _Topic, key: tuple[str, str] | None) -> NDArray[np.float64]:
    """Values by message, shape (messages,), NaN where it does not say them; without a key the times [s]."""
    if key is None:
        return np.asarray(said.times) - said.times[0]
    values = np.full(len(said.times), np.nan)
    numbers, found = said.values[key]
    values[numbers] = found
    return values
