"""A robot's channel map: lists with one entry a joint, taken apart into a channel map of each."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from signals.errors import TelemetryError, TextError
from signals.reading.documents import parse_document
from signals.telemetry import TIME, recognise_joint_columns

SCHEMA = "gearcase-channels/1"


@dataclass(frozen=True)
class LoggedJoint:
    """A joint of which a log has columns.

    `ratio`: turns of its motor per turn of the joint [1]; None where its drive is not described.
    """

    name: str
    ratio: float | None = None


def read_joint_maps(
    path: Path,
    joints: Sequence[LoggedJoint],
    text: str | None,
    parse: Callable[[str], Mapping[str, object]] = parse_document,
) -> tuple[tuple[str | None, ...], str]:
    """Return a channel map of each joint for one log, and the robot's map that was recognised, empty where none was.

    A map that names no column gives what the names of the columns do not tell, such as the torque per ampere.

    Raises:
        TelemetryError: as `joint_maps`; where columns of a log without a map, or with one that names none, are in
            doubt, with the lines of a map that would read it.
    """
    names = [joint.name for joint in joints]
    given = {} if text is None else json.loads(json.dumps(_parsed(text, parse), default=str))
    if text is None and len(joints) == 1:
        return (None,), ""
    if text is not None and any(isinstance(table, Mapping) and "column" in table for table in given.values()):
        return joint_maps(text, names, parse), ""
    found = recognise_joint_columns(path, [(joint.name, joint.ratio) for joint in joints], given)
    if found.open:
        raise TelemetryError(
            f"the names and units of the columns do not tell enough: {found.open}. Looked through, and ... filled in, "
            f"these lines are a channel map that reads the log:\n{found.map}"
        )
    return joint_maps(found.map, names), found.map


def joint_maps(
    text: str, joints: Sequence[str], parse: Callable[[str], Mapping[str, object]] = parse_document
) -> tuple[str, ...]:
    """Take a robot's channel map apart into one of each joint, as JSON that `channel_map_of` reads.

    In a robot's map `column`, `unit`, `factor`, `counts_per_rev` may be lists, one entry a joint, in the joints' order.

    Args:
        text: of the map.
        parse: how the text is parsed; `parse_foreign` where it came from elsewhere.

    Raises:
        TelemetryError: for a list of another length, a list where none can be, or a column for all joints.
    """
    document = _parsed(text, parse)
    maps: list[dict[str, object]] = [{} for _ in joints]
    for name, value in document.items():
        for k, one in enumerate(maps):
            one[name] = _of_joint(name, value, k, joints) if isinstance(value, Mapping) and name != TIME else value
    return tuple(json.dumps(one) for one in maps)


def _parsed(text: str, parse: Callable[[str], Mapping[str, object]]) -> Mapping[str, object]:
    try:
        return parse(text)
    except TextError as error:
        raise TelemetryError(f"channel map: {error}") from None


def _of_joint(channel: str, table: Mapping[str, object], joint: int, joints: Sequence[str]) -> dict[str, object]:
    out = {}
    for key, value in table.items():
        if isinstance(value, list) and len(value) != len(joints):
            raise TelemetryError(
                f"channel map: [{channel}] {key} has {len(value)} entries; the robot has {len(joints)} logged joints, "
                f"in this order: {', '.join(joints)}"
            )
        out[key] = value[joint] if isinstance(value, list) else value
    if len(joints) > 1 and not isinstance(table.get("column"), list):
        raise TelemetryError(
            f"channel map: [{channel}] column = {table.get('column')!r} is one column for {len(joints)} joints; write "
            f"a list, one entry a joint: column = [{', '.join(str(k + 1) for k in range(len(joints)))}]"
        )
    return out
