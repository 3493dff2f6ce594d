"""A robot's channel map: lists with one entry a joint, taken apart into a channel map of each."""

import json
from collections.abc import Callable, Mapping, Sequence

from casebase.signals.documents import parse_document
from casebase.signals.errors import TelemetryError, TextError
from casebase.signals.telemetry import TIME

SCHEMA = "gearcase-channels/1"


def joint_map_template(joints: int) -> str:
    """A robot's channel map to fill in: positions, then torques, one column a joint.

    >>> joint_map_template(2).splitlines()[4:]
    ['[motor_position_rad]', 'column = [2, 3]', 'unit = "rad"', '[motor_torque_nm]', 'column = [4, 5]', 'unit = "N.m"']
    """
    position, torque = (", ".join(str(2 + k + first) for k in range(joints)) for first in (0, joints))
    return f"""schema = "{SCHEMA}"
[time_s]
column = 1
unit = "s"
[motor_position_rad]
column = [{position}]
unit = "rad"
[motor_torque_nm]
column = [{torque}]
unit = "N.m"
"""


def joint_maps(
    text: str | None, joints: Sequence[str], parse: Callable[[str], Mapping[str, object]] = parse_document
) -> tuple[str | None, ...]:
    """Take a robot's channel map apart into one of each joint, as JSON that `channel_map_of` reads.

    In a robot's map `column`, `unit`, `factor`, `counts_per_rev` may be lists, one entry a joint, in the joints' order.

    Args:
        text: of the map; a log of a single joint may do without.
        parse: how the text is parsed; `parse_foreign` where it came from elsewhere.

    Raises:
        TelemetryError: for a list of another length, a list where none can be, a column for all joints, or no map for
            several joints, with one to fill in.
    """
    if text is None and len(joints) > 1:
        raise TelemetryError(
            "a robot's log needs a channel map with one column a joint, in the joints' order:\n"
            + joint_map_template(len(joints)).rstrip()
        )
    if text is None:
        return (None,)
    try:
        document = parse(text)
    except TextError as error:
        raise TelemetryError(f"channel map: {error}") from None
    maps: list[dict[str, object]] = [{} for _ in joints]
    for name, value in document.items():
        for k, one in enumerate(maps):
            one[name] = _of_joint(name, value, k, joints) if isinstance(value, Mapping) and name != TIME else value
    return tuple(json.dumps(one) for one in maps)


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
