"""Logs of all joints of a robot, read by the names of their columns or by one channel map with lists."""

from __future__ import annotations

import json
from pathlib import Path

from signals.columns.joint_maps import read_joint_maps
from signals.errors import TelemetryError
from signals.telemetry import Telemetry, read_telemetry
from sim.robot.investigation import RobotLog
from sim.robot.robot import Robot, logged_joints

TORQUE = "motor_torque_nm"


def read_log(robot: Robot, path: Path, channels: str | None) -> RobotLog:
    """Read each joint's telemetry; a joint whose torque alone cannot be read goes without.

    Raises
    ------
    TelemetryError
        as `read_telemetry`, beginning with the joint; and where the columns of the joints are in doubt.
    """
    maps, recognised = read_joint_maps(path, logged_joints(robot), channels)
    read = [_read(path, joint.name, map_) for joint, map_ in zip(robot.joints, maps, strict=True)]
    return RobotLog(
        path.name, tuple(telemetry for telemetry, _ in read), recognised,
        {joint.name: why for joint, (_, why) in zip(robot.joints, read, strict=True) if why},
    )  # fmt: skip


def _read(path: Path, joint: str, channels: str | None) -> tuple[Telemetry, str]:
    """A joint's telemetry; without its torque where that cannot be read, and why: it still moves the others."""
    try:
        return read_telemetry(path, channels=channels), ""
    except TelemetryError as error:
        rest = {} if channels is None else {k: v for k, v in json.loads(channels).items() if k != TORQUE}
        try:
            return read_telemetry(path, channels=json.dumps(rest)), str(error)
        except TelemetryError:
            raise TelemetryError(f"{joint}: {error}") from None
