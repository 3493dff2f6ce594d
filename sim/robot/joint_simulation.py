"""One joint of a moving robot, simulated: its drive with gears, while the links ask for another torque in every pose.

The load turns with the inertia that the joint feels on average; what the links ask for beyond it (weight, other joints,
an inertia that changes) stands as a torque from outside along the motion that was asked for. From that the load is off
by the error of the servo and the twist of the gears alone, over which no pose changes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.experiment.virtual_measurement import TELEMETRY_RATE_HZ, Measurement, measure
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot, RobotError
from sim.robot.trajectory import Trajectory
from sim.torsional.motion_profile import back_and_forth
from sim.torsional.reduction import Course

Array = NDArray[np.float64]

LINKS_HZ = 50.0  # of rows at which links are asked: the file of a motion has twice as many


def place_of(robot: Robot, joint: str) -> int:
    """Which of the logged joints is called so.

    Raises
    ------
    RobotError
        if none is, or its drive is not described.
    """
    names = [one.name for one in robot.joints]
    if joint not in names:
        raise RobotError(f"joints: none is called {joint!r}; there are {', '.join(names)}")
    if not robot.joints[names.index(joint)].described:
        raise RobotError(
            f"joints[{names.index(joint)}].axis: missing; {joint} needs the description of its drive to be simulated"
        )
    return names.index(joint)


def own_motion(robot: Robot, place: int, seconds: float) -> Trajectory:
    """The joint moves back and forth as its axis says (`[motion]`), from 0 on; the other logged joints stand at 0."""
    motion = robot.joints[place].axis.motion
    time_s = np.arange(round(seconds * 2 * LINKS_HZ) + 1) / (2 * LINKS_HZ)
    ways = np.zeros((3, time_s.size, len(robot.joints)))
    ways[:, :, place] = back_and_forth(
        time_s, motion.period_s, motion.load_speed_rad_s, motion.acceleration_time_s, motion.dwell_s
    )
    return Trajectory(tuple(joint.name for joint in robot.joints), time_s, ways[0], ways[1], ways[2])


def measure_joint(
    robot: Robot, place: int, motion: Trajectory, seed: int = 0, watch: Array | None = None
) -> tuple[Axis, Measurement]:
    """Simulate a joint while the robot makes a motion; return its axis with the inertia that it feels, and what is
    measured: sound, and telemetry with `known_torque_nm`, which the links ask for beside that inertia.

    Raises
    ------
    SimulationError
        for a drive that cannot be simulated, RunError where the motion left all bounds.
    """
    body, axis = RigidBody.of(robot), robot.joints[place].axis
    step = max(1, round(1.0 / (LINKS_HZ * float(motion.time_s[1]))))
    position, speed, acceleration = (each[::step] for each in (motion.position, motion.speed, motion.acceleration))
    asked = body.torque_of(position, speed, acceleration)[:, place]
    inertia = float(np.mean(own_inertia(body, position, place)))
    axis = replace(axis, load=replace(axis.load, inertia_kg_m2=inertia))
    known = CubicSpline(motion.time_s[::step], asked - inertia * acceleration[:, place])
    end = float(motion.time_s[::step][-1])
    clock = np.arange(round(end * SAMPLE_RATE_HZ) + 1) / SAMPLE_RATE_HZ
    way = CubicSpline(motion.time_s, motion.position[:, place], bc_type="clamped")
    motor = axis.ratio * np.stack([way(clock), way(clock, 1), way(clock, 2)])
    found = measure(axis, end, seed, watch=watch, course=Course(motor, -known(clock)))
    telemetry = found.telemetry
    rows = np.arange(telemetry.rows) / TELEMETRY_RATE_HZ
    channels = {**telemetry.channels, "known_torque_nm": known(np.clip(rows, 0.0, end))}
    return axis, replace(found, telemetry=replace(telemetry, channels=channels))


def own_inertia(body: RigidBody, position: Array, place: int) -> Array:
    """What a joint feels of the links while the others are held, shape (rows,) [kg m2]."""
    rest, turned = np.zeros_like(position), np.zeros_like(position)
    turned[:, place] = 1.0
    return (body.torque_of(position, rest, turned) - body.torque_of(position, rest, rest))[:, place]
