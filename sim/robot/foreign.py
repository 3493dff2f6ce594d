"""Robot descriptions from elsewhere: read, and made a rigid body of, in the limited process before anything else.

What MuJoCo, a program in C++, cannot bear ends that process and is refused; it never gets to where a job runs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from signals.columns.joint_maps import LoggedJoint
from signals.errors import TextError
from signals.reading.documents import parse_foreign
from signals.reading.limited_pool import LimitedPool, refusals_as
from signals.reading.limited_worker import RefusedError, Send
from sim.errors import AxisError, SimulationError
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import LARGEST_URDF_BYTES, Robot, logged_joints, robot_of
from sim.robot.urdf import read_urdf

LIMITS: Mapping[str, float] = {"seconds": 60.0, "cpu_seconds": 20.0, "memory_bytes": 2 << 30}
"""A robot takes a hundredth of a second; the first one of a process also loads MuJoCo."""
TASK = "sim.robot.foreign:task"
ROBOTS = LimitedPool(1, "sim.robot.foreign")


@dataclass(frozen=True)
class ForeignRobot:
    """A robot description from elsewhere that a rigid body was made of.

    `document`: with its name, and with the axes of its joints in place of the files that it names; `joints`: those that
    are logged, in the log's order; `urdf`: its links and joints.
    """

    name: str
    joints: tuple[LoggedJoint, ...]
    document: Mapping[str, object]
    urdf: str


def check_foreign(text: str, urdf: bytes, axes: Mapping[str, str]) -> ForeignRobot:
    """Read a robot description that came from elsewhere.

    `text`: robot.toml or the same as JSON; `urdf`: of the robot; `axes`: file names to axis.toml or the same as JSON.

    Raises
    ------
    AxisError
        as `read_robot`; for an axis that is named and missing, or given and not named; for a robot that MuJoCo cannot
        make, or that takes more time or memory than robots need.
    DecoderUnavailableError
        if the limited process cannot be started.
    """
    if len(urdf) > LARGEST_URDF_BYTES:
        raise AxisError(f"urdf: has {len(urdf)} bytes; it may have {LARGEST_URDF_BYTES}")
    document = _with_axes(_parsed("robot", text), {name: _parsed(name, axis) for name, axis in axes.items()})
    given = {"document": document, "urdf": urdf.decode("latin-1")}
    with refusals_as(AxisError, "urdf: no robot could be made of it ({}); is it of one robot, with its masses?"):
        _, found = ROBOTS.perform(TASK, given, LIMITS)
    return foreign_robot({**document, "name": found["name"]}, read_urdf(urdf).text)


def foreign_robot(document: Mapping[str, object], urdf: str) -> ForeignRobot:
    """Return a description that `check_foreign` found right before."""
    robot = kept_robot(document, urdf.encode())
    return ForeignRobot(robot.name, logged_joints(robot), document, urdf)


def kept_robot(document: Mapping[str, object], urdf: bytes) -> Robot:
    """Return the robot of a description that `check_foreign` found right."""
    return robot_of(document, urdf, _no_file)


def task(request: Mapping[str, Any], _: Mapping[str, float], send: Send) -> dict[str, object]:
    """Task: make a rigid body of a description; the name of the robot."""
    try:
        robot = kept_robot(request["document"], request["urdf"].encode("latin-1"))
        RigidBody.of(robot)
    except SimulationError as error:
        raise RefusedError("robot", str(error)[:2000]) from error
    return {"name": robot.name}


def _with_axes(document: dict[str, object], axes: Mapping[str, Mapping[str, object]]) -> dict[str, object]:
    joints = document.get("joints")
    given = joints if isinstance(joints, list) else []
    names = {
        k: PurePosixPath(joint["axis"].replace("\\", "/")).name
        for k, joint in enumerate(given)
        if isinstance(joint, dict) and isinstance(joint.get("axis"), str)
    }
    for k, name in names.items():
        if name not in axes:
            raise AxisError(
                f"joints[{k}].axis: names the file {name!r}; send it as a further part 'axis', or write the axis "
                f"itself there, as a table; files that came: {', '.join(axes) or 'none'}"
            )
    if idle := [name for name in axes if name not in names.values()]:
        raise AxisError(f"axis: no joint of the robot names the file {idle[0]!r}; write axis = {json.dumps(idle[0])}")
    placed = [{**joint, "axis": axes[names[k]]} if k in names else joint for k, joint in enumerate(given)]
    return {**document, "joints": placed} if placed else document


def _parsed(name: str, text: str) -> dict[str, object]:
    try:
        return parse_foreign(text)
    except TextError as error:
        raise AxisError(f"{name}: {error}") from None


def _no_file(name: str) -> Mapping[str, object]:
    raise AxisError(f"the file {name!r} did not come with the robot")
