"""Which columns of a table are which channels, where their names and units leave no doubt.

It is said as a channel map, with `...` where something has to be filled in.
Nothing is taken from how large values are. What is in doubt is asked for, unless the record says the same without it.
"""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from types import MappingProxyType

from signals.columns.column_names import (
    CURRENT,
    FAMILIES,
    LONGEST_NAME,
    NEEDED,
    QUANTITY_WORDS,
    Meaning,
    meaning_of,
)
from signals.columns.joint_maps import SCHEMA
from signals.columns.units import FORMAT, ISO8601, SAMPLE, units_of
from signals.telemetry import CHANNELS, TIME, Recognition

TEMPERATURE, TORQUE = "temperature_degc", "motor_torque_nm"

BLANK = "..."
INSTEAD: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "motor_speed_rad_s": ("motor_position_rad",),
        "load_speed_rad_s": ("load_position_rad",),
        "reference_position_rad": (),
        TEMPERATURE: (),
    }
)
"""Channels that are left out where they are in doubt, if these others are there, of which a record says the same."""
LEAST = ("motor_position_rad", TORQUE)
"""Channels whose lines stand in a map where no column is any channel."""
LONGEST_SHOWN = 60
MOST_RIVALS = 4
MOST_LISTED, MOST_LINES = 400, 60
"""Characters of the names of axes that are listed, and lines of a map for those that are not the first one."""


@dataclass(frozen=True)
class Column:
    """A column that may be a channel.

    Args:
        name: as it stands in the table.
        shown: as it stands in a map: in quotes, or its number from 1 where the name does not tell it.
        place: in the table, from 0.
    """

    name: str
    shown: str
    meaning: Meaning
    place: int


def recognise(names: Sequence[str], units: Sequence[str] = (), times: Iterable[int] = ()) -> Recognition:
    """Return what the columns of a table are.

    `units`: what stands below the names, or nothing; `times`: places of columns, from 0, that hold times of ISO 8601.

    >>> print(recognise(["t [ms]", "pos_deg", "Torque [Nm]"]).map)
    schema = "gearcase-channels/1"
    time_s = {column = "t [ms]", unit = "ms"}
    motor_torque_nm = {column = "Torque [Nm]", unit = "N.m"}
    motor_position_rad = {column = "pos_deg", unit = "deg"}
    >>> recognise(["t [ms]", "position"]).open
    'motor_position_rad has no unit'
    """
    columns = _beside_own(names, columns_of(names, units, frozenset(times)))
    axis, others, doubts = _axis([each for each in columns if each.meaning.channel != TIME])
    by_channel = {
        name: sorted(
            (each for each in (columns if name == TIME else axis) if each.meaning.channel == name), key=rank_of
        )
        for name in (TIME, *CHANNELS)
    }
    found = {name: each for name, each in by_channel.items() if each}
    open_ = {name: _doubt(name, each) for name, each in found.items()}
    lines = []
    for name, each in found.items():
        is_left_out = open_[name] and name in INSTEAD and found.keys() >= set(INSTEAD[name])
        lines.append(("# " if is_left_out else "") + _line(name, each))
        doubts += [open_[name]] if open_[name] and not is_left_out else []
    if names and all(map(str.isdigit, names)):
        doubts.append(f"its {len(names)} columns have no names, and a map says their numbers")
    if not by_channel[TIME]:
        doubts.append("no column says the time")
        lines.insert(0, f"{TIME} = {{column = {BLANK}, unit = {quoted(BLANK)}}}  # {units_in_words(TIME)}")
    if not axis:
        doubts.append("no column says which channel it is")
        lines += [f"{name} = {{column = {BLANK}, unit = {quoted(BLANK)}}}  # {units_in_words(name)}" for name in LEAST]
    return Recognition("\n".join([f'schema = "{SCHEMA}"', *lines, *others]), "; ".join(doubts))


def columns_of(
    names: Sequence[str], units: Sequence[str], times: frozenset[int], said: Sequence[str] | None = None
) -> list[Column]:
    """Return the columns that may be channels, in their order; `said`: what tells it of each, where not its name."""
    found, occurrences = [], Counter(names)
    said = names if said is None else said
    short = [text.lower() for text in said if len(text) <= LONGEST_NAME]
    known = {word: unit for marker, its in FAMILIES if any(map(marker.fullmatch, short)) for word, unit in its.items()}
    for place, name in enumerate(names):
        meaning = meaning_of(said[place], units[place] if units else "")
        if place in times:
            meaning = Meaning(TIME, ISO8601) if meaning is None or meaning.channel == TIME else None
        if meaning is not None:
            unit = meaning.unit or known.get(meaning.word)
            tells = 0 < len(name) <= LONGEST_SHOWN and name.isprintable() and not name.isdigit()
            shown = quoted(name) if tells and occurrences[name] == 1 else str(place + 1)
            found.append(Column(name, shown, replace(meaning, unit=unit), place))
    return found


def quoted(text: str) -> str:
    """Return a text as it stands in a map."""
    return json.dumps(text, ensure_ascii=False)


def _beside_own(names: Sequence[str], columns: Sequence[Column]) -> list[Column]:
    """Where a table has channels under their own names: these, and beside them what is beyond doubt alone."""
    own = {name for name in (TIME, *CHANNELS) if name in names}
    if TIME not in own or len(own) == 1:
        return list(columns)
    more = [
        each
        for each in columns
        if each.meaning.is_sure and not each.meaning.label and each.meaning.channel not in own and each.name not in own
    ]
    counted = Counter(each.meaning.channel for each in more)
    return [each for each in columns if each.name in own or (each in more and counted[each.meaning.channel] == 1)]


def _axis(columns: Sequence[Column]) -> tuple[list[Column], list[str], list[str]]:
    """The columns of the axis that is meant, lines that name those of others, and what is in doubt about it."""
    groups: dict[tuple[str, ...], list[Column]] = {}
    for each in columns:
        if each.meaning.channel != TEMPERATURE:
            groups.setdefault(each.meaning.label, []).append(each)
    torques = {name for name, group in groups.items() if any(each.meaning.channel == TORQUE for each in group)}
    makeshift = {name for name, group in groups.items() if all(each.meaning.needed for each in group)}
    if torques - makeshift:  # a current or a share of a torque alone is no axis
        groups = {name: group for name, group in groups.items() if name not in makeshift}
    if not groups:
        return [], [], []
    channels = [{each.meaning.channel for each in group} for group in groups.values()]
    label = max(groups, key=lambda each: len({one.meaning.channel for one in groups[each]}))
    temperatures = [
        each
        for each in columns
        if each.meaning.channel == TEMPERATURE and each.meaning.label == label and each.meaning.unit
    ]
    if len(groups) == 1:
        return groups[label] + temperatures, [], []
    if sum(map(len, channels)) == len(set().union(*channels)):
        all_ = [each for group in groups.values() for each in group]
        listed = ", ".join(group[0].shown for group in groups.values())
        return all_, [], [f"whether {listed} are of one axis is not said"]
    first = groups.pop(label)
    called = _called(label, first)
    names = [_called(name, group) for name, group in groups.items()]
    doubt = (
        f"there are columns of {len(groups) + 1} axes ({_listed([called, *names])}), and nothing shows "
        f"which is meant (the lines are of {called}, those of the others stand behind #)"
    )
    others = [line for name, group in zip(names, groups.values(), strict=True) for line in _lines_of(name, group)]
    return first + temperatures, others[:MOST_LINES], [doubt]


def _called(label: Sequence[str], columns: Sequence[Column]) -> str:
    """What an axis is called in its columns' names: how they all begin, if that has the words that make it one."""
    beginnings = zip(*(each.name for each in columns), strict=False)
    alike = "".join(letter for letter, *_ in takewhile(lambda each: len(set(each)) == 1, beginnings)).rstrip(" ._-/[(")
    if len(columns) > 1 and label and all(word in alike.lower() for word in label):
        return alike
    return " ".join(label) or "no name"


def _listed(names: Sequence[str]) -> str:
    listed = ", ".join(names)
    return listed if len(listed) <= MOST_LISTED else listed[:MOST_LISTED] + BLANK


def _lines_of(called: str, columns: Sequence[Column]) -> Iterator[str]:
    """The lines of a map for an axis that is not the first one."""
    yield f"# of the axis {called} instead:"
    for channel in CHANNELS:
        if its := sorted((each for each in columns if each.meaning.channel == channel), key=rank_of):
            yield "# " + _line(channel, its).partition("  # ")[0]


def rank_of(column: Column) -> tuple[bool, ...]:
    """What comes first is rather the channel: what is told, by the channel's own name, and no makeshift of it."""
    meaning = column.meaning
    if meaning.channel == TIME:
        makeshift = (meaning.unit == ISO8601, bool(meaning.label))
    else:
        makeshift = (bool(meaning.open), QUANTITY_WORDS.get(meaning.word, CURRENT) == CURRENT)
    return not meaning.is_sure, column.name not in (TIME, *CHANNELS), *makeshift


def _doubt(channel: str, columns: Sequence[Column]) -> str:
    """What is in doubt about a channel, whose columns stand in the order of `rank_of`; empty if nothing is."""
    first = columns[0]
    if first.meaning.is_sure:
        alike = [each.shown for each in columns if rank_of(each) == rank_of(first)]
        more = ["..."] if len(alike) > MOST_RIVALS else []
        return f"{channel} could be each of {', '.join(alike[:MOST_RIVALS] + more)}" if len(alike) > 1 else ""
    if first.meaning.open:
        return f"{first.shown} {first.meaning.open}"
    if first.meaning.needed:
        return f"{channel} is {NEEDED[first.meaning.needed].what}"
    return f"{channel} has no unit"


def _line(channel: str, columns: Sequence[Column]) -> str:
    """The line of a map, and behind it what may be filled in."""
    first = columns[0]
    meaning, needed = first.meaning, NEEDED.get(first.meaning.needed)
    more = f", {needed.key} = {BLANK}" if needed else ""
    comments = [needed.constant] if needed else [] if meaning.unit else [units_in_words(channel)]
    if _doubt(channel, columns):
        comments += [f"or column = {each.shown}" for each in columns[1:MOST_RIVALS]]
    says = f"  # {'; '.join(comments)}" if comments else ""
    return f"{channel} = {{column = {first.shown}, unit = {quoted(meaning.unit or BLANK)}{more}}}{says}"


def units_in_words(channel: str) -> str:
    """Return the units that a channel may have, and what some of them need."""
    units = [each for each in units_of(channel) if each not in (FORMAT, SAMPLE)]
    plain = [each for each in units if each not in NEEDED]
    more = [f"{each} with {NEEDED[each].key} = {BLANK}" for each in units if each in NEEDED]
    if channel == TIME:
        more = [
            'other stamps have unit = "format", format = "%d.%m.%Y %H:%M:%S,%f"',
            f"a log without a clock has unit = {quoted(SAMPLE)}, rate_hz = {BLANK}",
        ]
    elif channel != TEMPERATURE:
        more.append(f"of any other unit {plain[0]} with factor = {BLANK}")
    return "; ".join([", ".join(plain), *more])
