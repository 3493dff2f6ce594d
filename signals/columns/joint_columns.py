"""Which columns of a robot's log are which channels of which joint, by the joints' names or by their numbers.

It is said as a robot's channel map, with `...` where something has to be filled in. Words and units are those of
`column_names`; as there, nothing is taken from how large values are.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

from signals.columns.column_names import MOTOR, NEEDED, QUANTITY_WORDS
from signals.columns.joint_maps import SCHEMA, LoggedJoint
from signals.columns.recognition import BLANK, Column, columns_of, quoted, rank_of, units_in_words
from signals.telemetry import TIME, Recognition

POSITION, TORQUE = "motor_position_rad", "motor_torque_nm"
NEEDED_CHANNELS = ((POSITION, "load_position_rad"), (TORQUE,))
"""Of every joint: one of each of these."""
CHANNELS = (TORQUE, POSITION, "motor_speed_rad_s", "load_position_rad", "load_speed_rad_s", "temperature_degc")
"""What is read of a joint. What a controller asked for is not: it is left to a map."""
NUMBER = re.compile(r"\d{1,3}")
GEAR = f'axis = {{motor = {{}}, load = {{inertia_kg_m2 = 1.0}}, stages = [{{name = "gear", ratio = {BLANK}}}]}}'
"""Of a joint in robot.toml: what lets in values of its motor."""


@dataclass(frozen=True)
class Candidate:
    """Columns of one kind, one a joint in the joints' order."""

    columns: tuple[Column, ...]
    by_name: bool

    @property
    def channel(self) -> str:
        return self.columns[0].meaning.channel

    @property
    def rank(self) -> tuple[bool, ...]:
        """What comes first is rather the channel."""
        meaning = self.columns[0].meaning
        return not self.by_name, *rank_of(self.columns[0]), QUANTITY_WORDS.get(meaning.word) is None


def recognise_joints(
    names: Sequence[str],
    units: Sequence[str],
    times: Iterable[int],
    joints: Sequence[LoggedJoint],
    given: Mapping[str, object] = {},
) -> Recognition:
    """Return which columns are which channels of each joint.

    `units`, `times`: as in `recognise`; `given`: of a channel map that names no columns, what it says of channels.

    >>> two = [LoggedJoint("shoulder"), LoggedJoint("elbow")]
    >>> print(recognise_joints(["timestamp", "actual_q_0", "actual_q_1", "tau_0", "tau_1"], (), (), two).map)
    schema = "gearcase-channels/1"
    time_s = {column = "timestamp", unit = "s"}
    motor_torque_nm = {column = ["tau_0", "tau_1"], unit = "N.m"}
    motor_position_rad = {column = ["actual_q_0", "actual_q_1"], unit = "rad"}
    """
    told = {name: value for name, value in given.items() if isinstance(value, Mapping)}
    layout = [f"{name} = {json.dumps(value)}" for name, value in given.items() if name not in told and name != "schema"]
    plain = columns_of(names, units, frozenset(times))
    named, count = _named(names, units, joints), len(joints)
    candidates = [Candidate(tuple(kind[k] for k in range(count)), True) for kind in named if len(kind) == count]
    candidates += _by_number(plain, count)
    clock, doubts = _clock(plain, told.get(TIME, {}))
    lines = [f'schema = "{SCHEMA}"', *layout, clock]
    found = {
        channel: sorted((c for c in candidates if c.channel == channel), key=attrgetter("rank")) for channel in CHANNELS
    }
    for channel, its in found.items():
        if not its:
            continue
        line, doubt = _line(channel, its, joints, told.get(channel, {}))
        left_out = doubt and not any(channel in each for each in NEEDED_CHANNELS)
        lines.append(("# " if left_out else "") + line)
        doubts += [] if left_out or not doubt else [doubt]
    for either in NEEDED_CHANNELS:
        if not any(found.get(channel) for channel in either):
            lines.append(_blank(either[0], joints))
            doubts.append(_missing(either[0], plain, named, names, joints))
    lines += [f"{name} = {_inline(value)}" for name, value in told.items() if not found.get(name) and name != TIME]
    return Recognition("\n".join(lines), "; ".join(doubts))


def _named(names: Sequence[str], units: Sequence[str], joints: Sequence[LoggedJoint]) -> list[dict[int, Column]]:
    """Columns that name joints, by joint; of one kind are those that say the same beside its name."""
    patterns = sorted(
        ((alias, k) for k, joint in enumerate(joints) for alias in {joint.name, joint.name.removesuffix("_joint")}),
        key=lambda one: -len(one[0]),
    )
    of: dict[int, int] = {}
    rests = []
    for place, name in enumerate(names):
        rest = ""
        for alias, joint in patterns:
            match = re.search(rf"(?<![A-Za-z0-9]){re.escape(alias)}(?![A-Za-z0-9])", name, re.IGNORECASE)
            if match:
                of[place], rest = joint, name[: match.start()] + name[match.end() :]
                break
        rests.append(rest)
    kinds: dict[str, dict[int, Column]] = {}
    for column in columns_of(names, units, frozenset(), rests):
        if column.place in of:
            kinds.setdefault(rests[column.place], {}).setdefault(of[column.place], column)
    return list(kinds.values())


def _families(columns: Sequence[Column]) -> dict[tuple[str, str], dict[int, Column]]:
    """Columns whose names differ by a number alone, by that number; the key is what stands around it."""
    families: dict[tuple[str, str], dict[int, Column]] = {}
    for column in columns:
        for match in NUMBER.finditer(column.name):
            around = column.name[: match.start()], column.name[match.end() :]
            families.setdefault(around, {}).setdefault(int(match[0]), column)
    return families


def _by_number(columns: Sequence[Column], joints: int) -> Iterator[Candidate]:
    """Kinds of columns that count the joints, from 0 or 1."""
    for family in _families(columns).values():
        if _counts(family) == joints:
            ordered = tuple(family[number] for number in sorted(family))
            if len({each.meaning.channel for each in ordered}) == 1:
                yield Candidate(ordered, by_name=False)


def _counts(family: Mapping[int, Column]) -> int:
    """How many it counts without a gap, from 0 or 1; 0 where it does not."""
    first = min(family)
    return len(family) if first in (0, 1) and max(family) - first + 1 == len(family) else 0


def _clock(columns: Sequence[Column], given: Mapping[str, object]) -> tuple[str, list[str]]:
    """The line of the clock, and what is in doubt about it."""
    clocks = sorted((each for each in columns if each.meaning.channel == TIME), key=rank_of)
    if given.get("unit") == "sample":
        return f"{TIME} = {_inline(given)}", []
    if not clocks:
        return f"{TIME} = {{column = {BLANK}, unit = {quoted(BLANK)}}}  # {units_in_words(TIME)}", [
            "no column says the time"
        ]
    first = clocks[0]
    unit = given.get("unit", first.meaning.unit)
    alike = [each.shown for each in clocks if rank_of(each) == rank_of(first)]
    says = {"column": first.shown, "unit": quoted(BLANK) if unit is None else json.dumps(unit), **_other(given, "unit")}
    doubts = [] if unit else [f"{TIME} has no unit"]
    doubts += [f"{TIME} could be each of {', '.join(alike)}"] if len(alike) > 1 else []
    return f"{TIME} = {_table(says)}" + ("" if unit else f"  # {units_in_words(TIME)}"), doubts


def _line(
    channel: str, candidates: Sequence[Candidate], joints: Sequence[LoggedJoint], given: Mapping[str, object]
) -> tuple[str, str]:
    """The line of a channel, with what is to be filled in behind it, and what is in doubt about it."""
    columns = candidates[0].columns
    unit = given.get("unit", columns[0].meaning.unit)
    says = {
        "column": _list(each.shown for each in columns),
        "unit": quoted(BLANK) if unit is None else json.dumps(unit),
        **_other(given, "unit"),
    }
    key, value, doubt, comment = _constant(channel, columns[0], unit, joints)
    if key in given:
        doubt = comment = ""
    elif key:
        says[key] = value
    alike = [each.columns[0].shown for each in candidates if each.rank == candidates[0].rank]
    if len(alike) > 1 and not doubt:
        doubt = f"{channel} could be each of {', '.join(alike)} and so on"
    return f"{channel} = {_table(says)}" + (f"  # {comment}" if comment else ""), doubt


def _constant(channel: str, column: Column, unit: object, joints: Sequence[LoggedJoint]) -> tuple[str, str, str, str]:
    """What a line needs beside its unit: key, value, what is in doubt without it, and what it is; empty if nothing."""
    meaning, blanks = column.meaning, _list([BLANK] * len(joints))
    needed = NEEDED.get(meaning.needed if unit == meaning.unit else str(unit))
    unknown = [joint.name for joint in joints if joint.ratio is None]
    gears = f"; gears that robot.toml describes are no part of it: {GEAR}" if unknown else ""
    if unit is None:
        return "", "", f"{channel} has no unit", units_in_words(channel)
    if needed:
        more = f", times the gear ratio{gears}" if gears and channel == TORQUE else ""
        return needed.key, blanks, f"{channel} is {needed.what}", needed.constant + more
    if meaning.open:
        return "", "", f"{column.name} {meaning.open}", ""
    if meaning.side == MOTOR and channel not in column.name:
        if not unknown:
            return "", "", "", ""
        doubt = f"{channel} is of the motors, and the gears of {', '.join(unknown)} are not described"
        return "factor", blanks, doubt, ("the gear ratio" if channel == TORQUE else "1 / gear ratio") + gears
    if channel.startswith("motor_") and any(joint.ratio not in (None, 1.0) for joint in joints):
        ratios = [joint.ratio or 1.0 for joint in joints]
        factors = _list(f"{1.0 / ratio if channel == TORQUE else ratio:.10g}" for ratio in ratios)
        return "factor", factors, "", "from the joint to its motor, by the gears of robot.toml"
    return "", "", "", ""


def _blank(channel: str, joints: Sequence[LoggedJoint]) -> str:
    blanks = _list([BLANK] * len(joints))
    return f"{channel} = {{column = {blanks}, unit = {quoted(BLANK)}}}  # one a joint: {units_in_words(channel)}"


def _missing(
    channel: str,
    columns: Sequence[Column],
    named: Sequence[Mapping[int, Column]],
    names: Sequence[str],
    joints: Sequence[LoggedJoint],
) -> str:
    """That a channel is not there for every joint, and what comes near."""
    what = "position" if channel == POSITION else "torque or current"
    if names and all(map(str.isdigit, names)):
        return f"its {len(names)} columns have no names, and a map says which are the {what} of each joint"
    for kind in named:
        first = next(iter(kind.values()))
        if first.meaning.channel == channel:
            lacking = ", ".join(joint.name for k, joint in enumerate(joints) if k not in kind)
            return f"columns such as {first.shown} say the {what}, and there is none of {lacking}"
    for (before, after), family in _families([each for each in columns if each.meaning.channel == channel]).items():
        count = _counts(family)
        if count > 1:
            return (
                f"{before}{min(family)}{after} to {before}{max(family)}{after} are {count} columns, and robot.toml has "
                f"{len(joints)} logged joints; name all that are logged there, in this order"
            )
    listed = ", ".join(joint.name for joint in joints)
    return f"no columns say the {what} of each joint, by its name ({listed}) or by a number from 0 or 1"


def _list(texts: Iterable[str]) -> str:
    return f"[{', '.join(texts)}]"


def _table(entries: Mapping[str, str]) -> str:
    return "{" + ", ".join(f"{key} = {value}" for key, value in entries.items()) + "}"


def _other(given: Mapping[str, object], *known: str) -> dict[str, str]:
    return {key: json.dumps(value) for key, value in given.items() if key not in known}


def _inline(given: Mapping[str, object]) -> str:
    return _table(_other(given))
