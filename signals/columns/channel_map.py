"""Channel maps: which column of a log is which channel, in what unit (`gearcase-channels/1`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from signals.columns.joint_maps import SCHEMA
from signals.columns.units import COUNT, FORMAT, QUANTITIES, SAMPLE, TIMES, WITH_FACTOR, unit_of, units_of
from signals.errors import TelemetryError, TextError
from signals.formats.layout import Wanted
from signals.reading.documents import parse_document
from signals.telemetry import CHANNELS, TIME

TABLE_KEYS = {"header": bool, "delimiter": str, "decimal": str, "skip_rows": int}
CHANNEL_KEYS = ("column", "unit", "factor", "counts_per_rev", "rate_hz", "format")


@dataclass(frozen=True)
class Source:
    """Where the values of a channel come from.

    Args:
        column: its name in the header, or its number from 1; None for times that are counted by rows.
        unit: as in `TIMES` or `QUANTITIES`; `iso8601` and `format` are texts.
        scale: what one of the column's is of the channel's unit, sign included.
        format: of stamps of time, as of `datetime.strptime`.
    """

    column: str | int | None
    unit: str
    scale: float
    format: str = ""


@dataclass(frozen=True)
class ChannelMap:
    """A channel map: by channel, `time_s` among them, where its values come from; and what is said of the layout."""

    sources: Mapping[str, Source]
    layout: Wanted


def channel_map_of(text: str) -> ChannelMap:
    """Read a channel map, TOML or the same as JSON.

    Raises:
        TelemetryError: naming the table and the line that would be right.
    """
    try:
        document = parse_document(text)
    except TextError as error:
        raise TelemetryError(f"channel map: {error}") from None
    schema = document.pop("schema", SCHEMA)
    if schema != SCHEMA:
        raise TelemetryError(f'channel map: schema = {schema!r} is not known here; write schema = "{SCHEMA}"')
    sources: dict[str, Source] = {}
    for name, value in document.items():
        if name in TABLE_KEYS:
            continue
        if name == TIME or name in CHANNELS:
            sources[name] = _source(name, value)
        else:
            known = ", ".join((*TABLE_KEYS, TIME, *CHANNELS))
            raise TelemetryError(f"channel map: [{name}] is no channel; there are {known}")
    if TIME not in sources:
        raise TelemetryError(
            'channel map: the clock is missing; write [time_s] with column = 1 and unit = "s", or, where the log has '
            'none, unit = "sample" and rate_hz = 100'
        )
    if len(sources) == 1:
        raise TelemetryError(f"channel map: no channel is named beside time_s; there are {', '.join(CHANNELS)}")
    return ChannelMap(MappingProxyType(sources), layout_of(document))


def layout_of(document: Mapping[str, object]) -> Wanted:
    """Return what a channel map says of the layout.

    Raises:
        TelemetryError: with what would be right.
    """
    return Wanted(**{name: _layout(name, document[name]) for name in TABLE_KEYS if name in document})


def _layout(name: str, value: object) -> Any:
    kind = TABLE_KEYS[name]
    if type(value) is not kind:
        right = {"header": "header = false", "delimiter": 'delimiter = ";"', "decimal": 'decimal = ","'}
        raise TelemetryError(f"channel map: {name} = {value!r}; write it as {right.get(name, 'skip_rows = 14')}")
    if name in ("delimiter", "decimal") and len(str(value)) != 1:
        raise TelemetryError(f"channel map: {name} = {value!r} has to be one character")
    if name == "decimal" and value not in (".", ","):
        raise TelemetryError('channel map: decimal is "." or ","')
    if isinstance(value, int) and not 0 <= value <= 10_000:
        raise TelemetryError(f"channel map: skip_rows = {value}; at most 10000 rows can stand above the values")
    return value


def _meant(unit: object, units: Sequence[str]) -> str:
    """What a unit that is spelt otherwise may be written as."""
    known = unit_of(unit) if isinstance(unit, str) else None
    if known not in units:
        return ""
    of_the_column = f", with the factor in N m per {unit}" if known in WITH_FACTOR else ""
    return f'; write unit = "{known}"{of_the_column}'


def _source(channel: str, value: object) -> Source:
    if not isinstance(value, dict):
        raise TelemetryError(f'channel map: {channel} is a table; write [{channel}] and below it column = "..."')
    unknown = sorted(set(value) - set(CHANNEL_KEYS))
    if unknown:
        raise TelemetryError(f"channel map: [{channel}] {unknown[0]} is not known; there are {', '.join(CHANNEL_KEYS)}")
    units = units_of(channel)
    unit = value.get("unit", "s" if channel == TIME else units[0])
    if unit not in units:
        raise TelemetryError(
            f"channel map: [{channel}] unit = {unit!r} is not known; there are {', '.join(units)}{_meant(unit, units)}"
        )
    column = value.get("column")
    if not _is_column(column) and not (column is None and unit == SAMPLE):
        raise TelemetryError(
            f'channel map: [{channel}] column = {column!r}; write its name, column = "...", or its number from 1'
        )
    format_ = value.get("format", "")
    if (unit == FORMAT) != bool(format_) or not isinstance(format_, str):
        raise TelemetryError(
            f"channel map: [{channel}] unit = {unit!r} with format = {format_!r}; stamps other than ISO 8601 are "
            'written as unit = "format", format = "%d.%m.%Y %H:%M:%S,%f"'
        )
    return Source(column, str(unit), _scale(channel, str(unit), value), format_)


def _is_column(column: object) -> bool:
    return isinstance(column, str) or (type(column) is int and column >= 1)


def _scale(channel: str, unit: str, value: Mapping[str, object]) -> float:
    """What one of the column's is of the channel's unit."""
    factor = _number(channel, value, "factor", "N m per unit" if unit in WITH_FACTOR else None, default=1.0)
    if unit == COUNT:
        return factor * 2.0 * math.pi / _number(channel, value, "counts_per_rev", "such as 4096", positive=True)
    if unit == SAMPLE:
        return factor / _number(channel, value, "rate_hz", "samples per second, such as 100", positive=True)
    if channel == TIME:
        return factor * TIMES.get(unit, 1.0)
    return factor * QUANTITIES[CHANNELS[channel]].get(unit, 1.0)


def _number(
    channel: str,
    value: Mapping[str, object],
    name: str,
    needed: str | None,
    *,
    default: float | None = None,
    positive: bool = False,
) -> float:
    number = value.get(name)
    if number is None and needed is None and default is not None:
        return default
    if number is None:
        raise TelemetryError(
            f"channel map: [{channel}] unit = {value.get('unit')!r} needs {name} ({needed}); write {name} = ..."
        )
    if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number) or number == 0.0:
        raise TelemetryError(f"channel map: [{channel}] {name} = {number!r} has to be a number other than 0")
    if positive and number < 0:
        raise TelemetryError(f"channel map: [{channel}] {name} = {number!r} has to be above 0")
    return float(number)
