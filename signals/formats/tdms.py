"""TDMS, the files of LabVIEW: channels of groups, with units and, for waveforms, their clock."""

import struct
from collections.abc import Container, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.formats.columns import common_length
from signals.formats.extra import loaded
from signals.formats.layout import Wanted
from signals.formats.open_table import OpenTable, Rows

KIND = "a TDMS file (LabVIEW)"
BROKEN = (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, OverflowError, struct.error)
UNITS = ("unit_string", "NI_UnitDescription", "Unit")
"""Properties of a channel in which LabVIEW and its recorders say the unit."""
STEP, START = "wf_increment", "wf_start_offset"


def open_tdms(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of those channels that have as many values as most; several groups are named before theirs.

    Where every channel is a waveform of one step, its clock is the first column, `time`.

    Raises:
        TelemetryError: if it is no such file, holds no numbers, or what reads it is not installed.
    """
    reader = loaded("nptdms", KIND).TdmsFile
    try:
        file = reader.read_metadata(path)
        channels = [one for group in file.groups() for one in group.channels() if one.dtype.kind in "biufM"]
        count = common_length([len(one) for one in channels], KIND)
        channels = [one for one in channels if len(one) == count]
        several = len({one.group_name for one in channels}) > 1
        names = [f"{one.group_name}/{one.name}" if several else str(one.name) for one in channels]
        units = [next((str(one.properties[key]) for key in UNITS if one.properties.get(key)), "") for one in channels]
        steps = {(one.properties.get(STEP), one.properties.get(START, 0.0)) for one in channels}
        clock = [_clock(count, *each) for each in steps if len(steps) == 1 and each[0]]
    except TelemetryError:
        raise
    except BROKEN as error:
        raise TelemetryError(f"{KIND} that cannot be read: {error}") from error
    ahead = len(clock)

    def rows(places: Sequence[int], _: Container[int]) -> Iterator[Rows]:
        try:
            with reader.open(path) as opened:
                yield tuple(
                    clock[place] if place < ahead else _values(opened, channels[place - ahead]) for place in places
                )
        except BROKEN as error:
            raise TelemetryError(f"the TDMS file breaks off: {error}") from error

    times = frozenset(place + ahead for place, one in enumerate(channels) if one.dtype.kind == "M")
    return OpenTable(("time",) * ahead + tuple(names), rows, ("s",) * ahead + tuple(units), times)


def _clock(count: int, step: Any, start: Any) -> NDArray[np.float64]:
    return np.arange(count, dtype=np.float64) * float(step) + float(start)


def _values(opened: Any, channel: Any) -> NDArray[np.float64]:
    values = opened[channel.group_name][channel.name][:]
    if values.dtype.kind == "M":
        return np.asarray(values.astype("datetime64[ns]").astype(np.int64) * 1e-9)
    return np.asarray(values, dtype=np.float64)
