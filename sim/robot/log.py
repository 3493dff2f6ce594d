"""Logs of all joints of a robot, read by one channel map with lists."""

from __future__ import annotations

from pathlib import Path

from casebase.signals.errors import TelemetryError
from casebase.signals.joint_maps import joint_maps
from casebase.signals.telemetry import Telemetry, read_telemetry
from sim.robot.investigation import RobotLog
from sim.robot.robot import Robot


def read_log(robot: Robot, path: Path, channels: str | None) -> RobotLog:
    """Read each joint's telemetry.

    Raises
    ------
    TelemetryError
        as `read_telemetry`, beginning with the joint; and where there is no map for several joints.
    """
    names = [joint.name for joint in robot.joints]
    maps = joint_maps(channels, names)
    return RobotLog(path.name, tuple(_read(path, name, map_) for name, map_ in zip(names, maps, strict=True)))


def _read(path: Path, joint: str, channels: str | None) -> Telemetry:
    try:
        return read_telemetry(path, channels=channels)
    except TelemetryError as error:
        raise TelemetryError(f"{joint}: {error}") from None
