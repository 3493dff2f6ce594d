"""Plans of recordings of one joint within a moving robot: those of its axis, with the links of the robot for its load.

The robot moves back and forth between two poses, all joints together, as robots go from point to point. The joint that
is heard moves as the plan of its axis says. Each other joint goes some way from where it can be towards somewhere else,
from standing to as fast as it can; at the last link hangs something between nothing and the described payload.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.acoustics.microphone import Microphone
from sim.description.axis import Axis, MechanismEntry
from sim.experiment.design_of_experiments import DURATION_S, Planned, Range, plan
from sim.experiment.pose_load import PoseLoad
from sim.experiment.scenario import Scenario, travel_rad
from sim.mechanisms import MECHANISMS
from sim.robot.joint_simulation import own_inertia
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot, RobotError

Array = NDArray[np.float64]

ROWS = 41  # of a way
DECIMALS = 9  # of kg m2 and N m: what two machines agree on, so that a case has one key
RATE_HZ = 200.0  # of rows at which it is looked what the gear carries
DRAWS = 100


def plan_joint(
    robot: Robot,
    place: int,
    counts: Mapping[str, int],
    seed: int = 0,
    *,
    microphones: Sequence[Microphone] = (),
    duration_s: float = DURATION_S,
    operation: Sequence[Range] = (),
    only: range | None = None,
) -> list[Planned]:
    """Scenarios of a joint for each label, as `plan` makes them for an axis; `place`: which of the logged joints.

    Raises
    ------
    SimulationError
        as `plan`, and where the motor of the joint can move the arm in no pose.
    """
    planned = plan(
        robot.joints[place].axis,
        counts,
        seed,
        microphones=microphones,
        duration_s=duration_s,
        operation=operation,
        reach_rad=_reach(robot, robot.joints[place].name),
        only=only,
    )
    return [_in_robot(robot, place, each) for each in planned]


def pose_load(robot: Robot, body: RigidBody, place: int, first: Array, last: Array) -> tuple[float, PoseLoad]:
    """What the links ask of a joint on the straight way from one pose to another, shape (joints,) [rad].

    Returns
    -------
    The inertia that the joint feels on average while the others are held [kg m2], and the load along the way.
    """
    way = last - first
    position = first + np.linspace(0.0, 1.0, ROWS)[:, None] * way
    together = np.tile(way / way[place], (ROWS, 1))
    rest = np.zeros_like(position)
    gravity = body.torque_of(position, rest, rest)[:, place]
    own = own_inertia(body, position, place)
    inertia = body.torque_of(position, rest, together)[:, place] - gravity
    centrifugal = body.torque_of(position, together, rest)[:, place] - gravity
    load = PoseLoad(
        robot.name,
        robot.joints[place].name,
        robot.payload.mass_kg,
        _rounded(first),
        _rounded(last),
        (float(first[place]), float(last[place])),
        _rounded(own),
        _rounded(inertia),
        _rounded(centrifugal),
        _rounded(gravity),
    )
    return round(float(np.mean(own)), DECIMALS), load


def _in_robot(robot: Robot, place: int, planned: Planned) -> Planned:
    """The planned recording in poses that the motor can take the arm through, and in which its fault shows."""
    random = np.random.default_rng([planned.scenario.noise_seed, place])
    robot = replace(robot, payload=replace(robot.payload, mass_kg=robot.payload.mass_kg * random.random()))
    body = RigidBody.of(robot)
    for _ in range(DRAWS):
        scenario, entry = planned.scenario, planned.mechanism
        motion = scenario.motion(RATE_HZ)
        inertia, load = pose_load(robot, body, place, *_poses(robot, place, scenario, random))
        axis = replace(scenario.axis, load=replace(scenario.axis.load, inertia_kg_m2=inertia))
        scenario = replace(scenario, axis=axis, payload_kg_m2=inertia, pose_load=load)
        carried = scenario.load_torque(motion)
        strong = np.abs(carried).max() <= axis.motor.torque_limit_n_m * axis.ratio
        if strong and (carried.min() < 0.0 < carried.max() or not _of_reversals(entry)):
            return replace(planned, scenario=_on_loaded_flank(scenario, entry, motion[0], carried))
        planned = _elsewhere(planned, _reach(robot, robot.joints[place].name), random)
    raise RobotError(
        f"joints[{place}].axis: in none of {DRAWS} motions that were drawn for it motor.torque_limit_n_m suffices and "
        f"{planned.label!r} can be heard; leave that label out, or give a motion with less acceleration"
    )


def _elsewhere(planned: Planned, reach_rad: tuple[float, float], random: np.random.Generator) -> Planned:
    """The same motion about another angle; damage comes along."""
    scenario, entry = planned.scenario, planned.mechanism
    half = 0.5 * travel_rad(scenario.axis.motion)
    middle = float(random.uniform(reach_rad[0] + half, reach_rad[1] - half))
    axis = scenario.axis
    if entry is not None and _of_one_flank(entry):
        angle = entry.parameters["angle_rad"] + middle - scenario.middle_rad
        axis = _with_fault(axis, entry, angle_rad=angle)
    return replace(planned, scenario=replace(scenario, axis=axis, middle_rad=middle))


def _with_fault(axis: Axis, entry: MechanismEntry, **changes: float) -> Axis:
    """The axis with other numbers of its last mechanism, which is the fault."""
    changed = replace(entry, parameters={**entry.parameters, **changes})
    return replace(axis, mechanisms=(*axis.mechanisms[:-1], changed))


def _of_one_flank(entry: MechanismEntry) -> bool:
    return MECHANISMS[entry.name].signature.flank == "one"


def _of_reversals(entry: MechanismEntry | None) -> bool:
    """Whether a fault shows only where the load changes sides."""
    return entry is not None and MECHANISMS[entry.name].signature.domain == "reversal"


def _on_loaded_flank(scenario: Scenario, entry: MechanismEntry | None, angle: Array, carried: Array) -> Scenario:
    """The scenario with its damage on the other flank, if the flank that it is on is free whenever it passes."""
    if entry is None or not _of_one_flank(entry):
        return scenario
    passing = np.flatnonzero(np.diff(np.sign(np.sin(0.5 * (angle - entry.parameters["angle_rad"])))))
    flank = entry.parameters["flank"]
    if np.any(flank * carried[passing] >= 0.0):
        return scenario
    return replace(scenario, axis=_with_fault(scenario.axis, entry, flank=-flank))


def _poses(robot: Robot, place: int, scenario: Scenario, random: np.random.Generator) -> tuple[Array, Array]:
    """The two ends of the motion, shape (joints,)."""
    travel = travel_rad(scenario.axis.motion)
    seconds = travel / scenario.axis.motion.load_speed_rad_s
    low, high = np.transpose([_reach(robot, joint.name) for joint in robot.joints])
    fastest = np.array([robot.urdf.limits.get(joint.name, (0.0, 0.0, 0.0))[2] or math.inf for joint in robot.joints])
    first, towards = random.uniform(low, high, (2, low.size))
    way = np.clip(random.random() * (towards - first), -fastest * seconds, fastest * seconds)
    first[place], way[place] = scenario.middle_rad - 0.5 * travel, travel
    return first, first + way


def _reach(robot: Robot, joint: str) -> tuple[float, float]:
    """Between which angles a joint can be: any, of one without ends."""
    low, high, _ = robot.urdf.limits.get(joint, (0.0, 0.0, 0.0))
    return (low, high) if low < high else (-math.pi, math.pi)


def _rounded(values: Array) -> tuple[float, ...]:
    return tuple(np.round(values, DECIMALS).tolist())
