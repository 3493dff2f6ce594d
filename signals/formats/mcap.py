"""MCAP, into which ROS 2 records: joint states (`sensor_msgs/JointState`), a column per joint and quantity."""

import struct
from collections.abc import Container, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.formats.extra import loaded
from signals.formats.layout import Wanted
from signals.formats.open_table import OpenTable, Rows

KIND = "an MCAP file (a ROS 2 bag)"
BROKEN = (ValueError, KeyError, IndexError, AttributeError, OSError, RuntimeError, struct.error)
"""What decoding raises beside errors of its own; RuntimeError is that of LZ4."""
MESSAGE = "sensor_msgs/msg/JointState"
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
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
        for field in UNITS:
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
    reader = loaded("mcap.reader", KIND)
    factory = loaded("mcap_ros2.decoder", KIND).DecoderFactory
    broken = (loaded("mcap.exceptions", KIND).McapError, loaded("zstandard", KIND).ZstdError, *BROKEN)
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
            f"{KIND} that cannot be read ({error}); one that was not closed is made whole by: mcap recover"
        ) from error
    if not topics:
        listed = ", ".join(f"{topic} ({kind})" for topic, kind in list(others.items())[:12])
        raise TelemetryError(f"{KIND} without joint states ({MESSAGE}); it has {listed or 'no messages'}")
    return _table(topics)


def _table(topics: dict[str, _Topic]) -> OpenTable:
    before = {topic: f"{topic} " if len(topics) > 1 else "" for topic in topics}
    columns: list[tuple[str, str, tuple[str, tuple[str, str] | None]]] = []
    for topic, said in topics.items():
        columns.append((f"{before[topic]}time", "s", (topic, None)))
        columns += [
            (f"{before[topic]}{field}[{joint}]", UNITS[field], (topic, (joint, field))) for joint, field in said.values
        ]

    def rows(places: Sequence[int], _: Container[int]) -> Iterator[Rows]:
        chosen = [columns[place][2] for place in places]
        from_ = {topic for topic, _ in chosen}
        if len(from_) > 1:
            raise TelemetryError(f"the channels are of topics with clocks of their own: {', '.join(sorted(from_))}")
        said = topics[from_.pop()]
        kept = _messages(said, [key for _, key in chosen if key is not None])
        yield tuple(_values(said, key)[kept] for _, key in chosen)

    return OpenTable(tuple(name for name, *_ in columns), rows, tuple(unit for _, unit, _ in columns))


def _messages(said: _Topic, keys: Sequence[tuple[str, str]]) -> NDArray[np.int64]:
    """The messages that say one of these at least: others are of other joints of the same topic."""
    numbers = [said.values[key][0] for key in keys] or [list(range(len(said.times)))]
    return np.unique(np.concatenate(numbers)).astype(np.int64)


def _values(said: _Topic, key: tuple[str, str] | None) -> NDArray[np.float64]:
    """Values by message, shape (messages,), NaN where it does not say them; without a key the times [s]."""
    if key is None:
        return np.asarray(said.times) - said.times[0]
    values = np.full(len(said.times), np.nan)
    numbers, found = said.values[key]
    values[numbers] = found
    return values
