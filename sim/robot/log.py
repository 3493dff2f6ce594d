"""Logs of all joints of a robot, read by the names of their columns or by one channel map with lists."""

from __future__ import annotations

from pathlib import Path

from casebase.signals.errors import TelemetryError
from casebase.signals.joint_maps import read_joint_maps
from casebase.signals.telemetry import Telemetry, read_telemetry
from sim.robot.investigation import RobotLog
from sim.robot.robot import Robot, logged_joints


def read_log(robot: Robot, path: Path, channels: str | None) -> RobotLog:
    """Read each joint's telemetry.

    Raises
    ------
    TelemetryError
        as `read_telemetry`, beginning with the joint; and where the columns of the joints are in doubt.
    """
    maps, recognised = read_joint_maps(path, logged_joints(robot), channels)
    joints = tuple(_read(path, joint.name, map_) for joint, map_ in zip(robot.joints, maps, strict=True))
    return RobotLog(path.name, joints, recognised)


def _read(path: Path, joint: str, channels: str | None) -> Telemetry:
    try:
        return read_telemetry(path, channels=channels)
    except TelemetryError as error:
        raise TelemetryError(f"{joint}: {error}") from None
