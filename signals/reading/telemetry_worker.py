"""Telemetry tables, read in the limited process: known columns alone, so many values and no more."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.columns.channel_map import ChannelMap, Source, channel_map_of, layout_of
from signals.columns.clock import stamps_from_zero
from signals.columns.joint_columns import recognise_joints
from signals.columns.joint_maps import LoggedJoint
from signals.columns.recognition import BLANK, recognise
from signals.columns.units import FORMAT, ISO8601
from signals.errors import TelemetryError
from signals.formats import Reader, reader_of
from signals.formats.comma_separated import TABLES, open_comma_separated
from signals.formats.layout import Wanted
from signals.formats.open_table import OpenTable
from signals.reading.limited_worker import RefusedError, Send
from signals.telemetry import CHANNELS, LARGEST_LOST_SHARE, LONGEST_NAME, MINIMUM_ROWS, MOST_COLUMNS, TIME

BEGINNING = 128
"""Bytes by which a format is told [byte]."""
LONGEST_REFUSAL = 8000
"""Characters of a refusal, the lines of a channel map among them."""
COLUMN = re.compile(r'column = ("(?:[^"\\]|\\.)*"|\d+)')
"""Columns of a map that was recognised."""
MOST_SHOWN = 40
"""Columns that a refusal lists: four axes of ten channels."""
DAY_S = 86_400.0
DATED = re.compile("%[dDjxcsFuUwWaA]")
"""Of a format: it has a day, and not only the time of one."""
DRAWN = 100
"""Intervals of the course of a column; twice as many columns have one."""
APART, ALIKE, TOLERANCE = 8, 0.99, 0.02
"""Rows over which a speed is held against a position, their correlation, and how far the power of ten may be off."""
MOST_LOOKED_AT = 1_000_000
"""Values of which a refusal says from where to where they go."""


def read(request: Mapping[str, Any], limits: Mapping[str, float], send: Send) -> Mapping[str, Any]:
    """Task: read and check a table; send times, channels (float64) and where a channel is lost (bool), if asked for."""
    with refusals():
        map_ = None if request["channels"] is None else channel_map_of(request["channels"])
        return _read(Path(request["path"]), map_, int(limits["cells"]), send if request["send"] else lambda _: None)


def columns(request: Mapping[str, Any], limits: Mapping[str, float], _: Send) -> Mapping[str, object]:
    """Task: what is recognised of a table's columns, and what they look like."""
    with refusals():
        table = opened(Path(request["path"]), None)
        names = names_of(table)
        found = recognise(names, table.units, table.times)
        values = _looked_at(table, range(len(names))[: 2 * DRAWN], int(limits["cells"]) // 8)
        looks: list[dict[str, object]] = [
            {"name": name[:LONGEST_NAME], "time": place in table.times, **_look(values.get(place, np.empty(0)))}
            for place, name in enumerate(names)
        ]
        for place, speed in _speeds(looks, values):
            looks[speed]["speed_of"] = place
        map_ = found.map if found.open or not _is_own(channel_map_of(found.map)) else ""
        return {"map": map_, "open": found.open, "columns": looks}


def joint_columns(request: Mapping[str, Any], _: Mapping[str, float], __: Send) -> Mapping[str, str]:
    """Task: which columns of a robot's log are which channels of its joints."""
    with refusals():
        joints, given = [LoggedJoint(name, ratio) for name, ratio in request["joints"]], request["given"]
        layout = layout_of(given)
        table = opened(Path(request["path"]), None if layout == Wanted() else layout)
        return asdict(recognise_joints(names_of(table), table.units, table.times, joints, given))


@contextmanager
def refusals() -> Iterator[None]:
    try:
        yield
    except TelemetryError as error:
        words = "".join(each if each.isprintable() or each == "\n" else " " for each in str(error))
        raise RefusedError("telemetry", words[:LONGEST_REFUSAL]) from error


def _read(path: Path, map_: ChannelMap | None, cells: int, send: Send) -> Mapping[str, Any]:
    table = opened(path, None if map_ is None else map_.layout)
    names = names_of(table)
    sources, recognised = _recognised(table, names) if map_ is None else (map_.sources, "")
    known = [name for name in CHANNELS if name in sources]
    places = {name: _place(name, source, names) for name, source in sources.items() if source.column is not None}
    values = dict(zip(places, _values(table, sources, places, cells), strict=True))
    if TIME not in values:
        values[TIME] = np.arange(next(iter(values.values())).size, dtype=np.float64) * sources[TIME].scale
    if map_ is not None or recognised:
        values = _whole_ends(values)
    _check_clock(values[TIME])
    time_s = stamps_from_zero(values[TIME])
    lost = []
    send(np.ascontiguousarray(time_s).data)
    for name in known:
        filled, missing = _filled(name, time_s, values[name])
        send(np.ascontiguousarray(filled).data)
        if missing is not None:
            lost.append(name)
            send(missing.data)
    others = [name[:LONGEST_NAME] for place, name in enumerate(names) if place not in places.values()]
    ignored = others if map_ is None else []  # whoever wrote a map has left the others out on purpose
    told = {"ignored": ignored, "recognised": recognised, "first_s": float(values[TIME][0])}
    return {"rows": time_s.size, "channels": known, "lost": lost, **told}


def names_of(table: OpenTable) -> list[str]:
    if len(table.names) > MOST_COLUMNS:
        raise TelemetryError(
            f"the table has {len(table.names)} columns; at most {MOST_COLUMNS} are read: leave out those that are "
            "no channel"
        )
    return [name.strip().lstrip("\ufeff") for name in table.names]


def opened(path: Path, wanted: Wanted | None) -> OpenTable:
    """The table; without a map text of another layout is tried where the plain one has no clock."""
    open_ = _reader(path)
    if wanted is not None:
        return open_(path, wanted)
    if open_ is not open_comma_separated:
        return open_(path, None)
    with suppress(TelemetryError):
        table = open_(path, None)
        if any(name.strip().lstrip("\ufeff") == TIME for name in table.names):
            return table
    with suppress(TelemetryError):
        return open_(path, Wanted())
    return open_(path, None)


def _recognised(table: OpenTable, names: Sequence[str]) -> tuple[Mapping[str, Source], str]:
    """Where the channels are, and the map that this amounts to; none where all have their own names."""
    for name in (TIME, *CHANNELS):
        if names.count(name) > 1:
            raise TelemetryError(f"the column {name} stands twice in the table; one of them must go")
    found = recognise(names, table.units, table.times)
    if found.open:
        _try(table, found.map)
        raise TelemetryError(
            f"the names and units of the columns do not tell enough: {found.open}. The table has "
            f"{_held(table, names)}. Looked through, and {BLANK} filled in, these lines are a channel map that reads "
            f"it:\n{found.map}"
        )
    map_ = channel_map_of(found.map)
    return map_.sources, "" if _is_own(map_) else found.map


def _try(table: OpenTable, map_: str) -> None:
    """Read the columns of a map that is to be filled in: none is offered that cannot read them.

    Raises:
        TelemetryError: as reading them does.
    """
    shown = [json.loads(each) for each in COLUMN.findall(map_)]
    names = [name.strip().lstrip("\ufeff") for name in table.names]
    places = {each - 1 if isinstance(each, int) else names.index(each) for each in shown}
    try:
        for _ in table.rows(sorted(places) or [0], dict.fromkeys(table.times, "")):
            pass
    except TelemetryError as error:
        raise TelemetryError(
            f"{error}. One row a line is read, with a column for each channel; a stamp of time that is no number has "
            'unit = "format", format = "%d.%m.%Y %H:%M:%S,%f" in a channel map'
        ) from error


def _looked_at(table: OpenTable, places: Sequence[int], cells: int) -> dict[int, NDArray[np.float64]]:
    """What is finite in those columns that hold numbers or times, in about so many cells from the first row on."""
    blocks: list[tuple[NDArray[np.float64], ...]] = []
    try:
        for block in table.rows(places, dict.fromkeys(table.times.intersection(places), "")):
            blocks.append(block)
            cells -= len(places) * block[0].size
            if cells < 0:
                break
    except TelemetryError:  # one of them is text: the others are read without it
        middle = len(places) // 2
        halves = (places[:middle], places[middle:]) if middle else ()
        return {place: values for half in halves for place, values in _looked_at(table, half, cells).items()}
    columns = zip(places, map(np.concatenate, zip(*blocks, strict=True)), strict=False)
    return {place: values[np.isfinite(values)] for place, values in columns}


def _look(values: NDArray[np.float64]) -> dict[str, object]:
    """What a column looks like; nothing of one without values."""
    if not values.size:
        return {}
    starts = np.arange(0, values.size, -(-values.size // DRAWN))
    ends = np.stack([np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)], axis=1).ravel()
    low, high = float(ends.min()), float(ends.max())
    steps, spread = np.diff(values), float(values.std())
    return {
        "first": values[:3].tolist(),
        "low": low,
        "high": high,
        "y": np.nan_to_num((ends - low) / ((high - low) or 1.0)).round(3).tolist(),
        "rises": bool(steps.size and (steps > 0.0).all()),
        # white noise has steps of 1.4 times its spread; what an axis at rest shows is small beside the value
        "moves": bool(2.0 * np.linalg.norm(steps) < spread * values.size**0.5 and spread > 0.01 * np.abs(ends).max()),
    }


def _speeds(
    looks: Sequence[Mapping[str, object]], values: Mapping[int, NDArray[np.float64]]
) -> Iterator[tuple[int, int]]:
    """Places of columns that move, and of those that are their speed, up to the unit of time.

    A position's change over some rows is the integral of the speed over them, which rounding hardly disturbs.
    """
    clock = next((values[place] for place, look in enumerate(looks) if look.get("rises")), None)
    if clock is None:
        return
    moving = [k for k, look in enumerate(looks) if look.get("moves") and values[k].size == clock.size > 2 * APART]
    ways = {k: np.cumsum(0.5 * (values[k][1:] + values[k][:-1]) * np.diff(clock)) for k in moving}
    for one, other in permutations(moving[:MOST_SHOWN], 2):
        change = values[one][1:][APART:] - values[one][1:][:-APART]
        way = ways[other][APART:] - ways[other][:-APART]
        slope = float(change @ way / (way @ way))
        if slope <= 0.0 or np.corrcoef(change, way)[0, 1] < ALIKE:
            continue
        if abs(math.remainder(math.log10(slope), 3.0)) < TOLERANCE:
            yield one, other


def _is_own(map_: ChannelMap) -> bool:
    return all(source.column == name for name, source in map_.sources.items())


def _place(channel: str, source: Source, names: Sequence[str]) -> int:
    """Which column a source is, from 0."""
    column = source.column
    if isinstance(column, int):
        if column > len(names):
            raise TelemetryError(
                f"channel map: [{channel}] column = {column}; the table has {len(names)} columns: {_listed(names)}"
            )
        return column - 1
    wanted = str(column).strip()
    count = names.count(wanted)
    if count != 1:
        says = "is not in the table" if count == 0 else f"stands {count} times in the table; give its number from 1"
        raise TelemetryError(f'channel map: [{channel}] column = "{wanted}" {says}; it has {_listed(names)}')
    return names.index(wanted)


def _whole_ends(values: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """The rows from the first to the last in which nothing is missing: what begins later cannot be filled."""
    whole = np.flatnonzero(~np.any([np.isnan(one) for one in values.values()], axis=0))
    if not whole.size:
        empty = [name for name, one in values.items() if np.isnan(one).all()]
        raise TelemetryError(
            f"there is no row in which nothing is missing; {', '.join(empty) or 'no channel'} is empty"
        )
    return {name: one[whole[0] : whole[-1] + 1] for name, one in values.items()}


def _values(
    table: OpenTable, sources: Mapping[str, Source], places: Mapping[str, int], cells: int
) -> list[NDArray[np.float64]]:
    """Values of each placed channel in its unit, in their order."""
    columns = sorted(set(places.values()))
    times = {place: sources[name].format for name, place in places.items() if sources[name].unit in (ISO8601, FORMAT)}
    blocks: list[tuple[NDArray[np.float64], ...]] = []
    count = 0
    for rows in table.rows(columns, times):
        count += len(columns) * rows[0].size
        if count > cells:
            raise TelemetryError(
                f"the table has more than {cells // len(columns)} rows of {len(columns)} known columns; at most "
                f"{cells} values are read: cut it, or log every second sample"
            )
        blocks.append(rows)
    found = []
    for name, place in places.items():
        values = np.concatenate([np.empty(0), *(block[columns.index(place)] for block in blocks)])
        values *= sources[name].scale
        if sources[name].format and not DATED.search(sources[name].format):
            values += DAY_S * np.cumsum(np.diff(values, prepend=values[:1]) < -0.5 * DAY_S)
        found.append(values)
    return found


def _reader(path: Path) -> Reader:
    with path.open("rb") as file:
        start = file.read(BEGINNING)
    if not start:
        raise TelemetryError(f"the telemetry file is empty; needed is {TABLES}")
    return reader_of(start)


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    shown = [(name if len(name) <= 40 else name[:40] + "...") or "(no name)" for name in names[:12]]
    return ", ".join(shown) + (", ..." if len(names) > 12 else "")


def _held(table: OpenTable, names: Sequence[str]) -> str:
    """The columns, and from where to where they go: which is a clock, and which axis moves, is seen by that."""
    shown = [place for place in range(min(len(names), MOST_SHOWN)) if place not in table.times]
    found = {place: values for place, values in _looked_at(table, shown, MOST_LOOKED_AT).items() if values.size}
    listed = [
        f"{name[:40] or place + 1} ({found[place].min():.4g} to {found[place].max():.4g})"
        if place in found
        else name[:40]
        for place, name in enumerate(names[:MOST_SHOWN])
    ]
    return ", ".join(listed) + (", ..." if len(names) > MOST_SHOWN else "")


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
