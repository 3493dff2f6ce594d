"""Can a log be of the robot that is described? Order of the joints, signs, the way down, another robot."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from sim.investigation.data.data_fault import InvestigationError
from sim.robot.motion import Motion
from sim.robot.rigid_body import PARAMETERS, RigidBody
from sim.robot.robot import Robot, position_key
from sim.robot.shared_fit import GAIN_ERROR, TILT_RAD, shared_columns

Array = NDArray[np.float64]

ROWS = 240
MOST_ORDERS = 6  # joints, of which all orders are tried
WORSE = 1.5  # times the squares without any rigid body: masses that are off by several percent do not get there
FAR_BETTER = 0.25  # of the squares of all joints, multiplied: what else would be right explains the torques
ASKEW_RAD = 10.0 * TILT_RAD  # a base that is off by more was mounted so, and no error of masses looks like it
TURNED = 0.5  # of its dry friction, which a joint that moves has in full
FEWEST = 20  # rows in motion, for three numbers of friction and the rotor


def check_joints(robot: Robot, body: RigidBody) -> None:
    """Refuse a description by which nobody knows where a joint was that counts in the torques of those logged.

    Raises
    ------
    InvestigationError
        naming these joints, and the lines of robot.toml that would say it.
    """
    unknown = body.unknown(robot.held)
    if not unknown:
        return
    logged = [joint.name for joint in robot.joints]
    depend = [name for name in logged if any(name in each for each in unknown.values())]
    whose = "all logged joints" if depend == logged else ", ".join(depend)
    held = "\n".join(f"[[held]]\nname = {json.dumps(name)}\n{position_key(robot.urdf, name)} = ..." for name in unknown)
    raise InvestigationError(
        f"robot.toml does not say where these joints of the URDF are: {', '.join(unknown)}. The torques of {whose} "
        "depend on how they stand and move. A joint that moved has to be logged: name it under [[joints]], at its "
        "place in the log's order, and in the channel map. A joint that was held still needs its position in "
        f"robot.toml:\n{held}"
    )


def check_robot(robot: Robot, body: RigidBody, motion: Motion) -> frozenset[int]:
    """Return the places of joints whose torques this robot cannot have asked for, if they are fewer than half.

    Raises
    ------
    InvestigationError
        where they are more, naming them; and where another order of the joints, sign or direction of gravity explains
        the torques far better, naming that.
    """
    counting = np.flatnonzero(motion.counts)
    few = motion.at(counting[np.linspace(0, counting.size - 1, min(counting.size, ROWS)).astype(int)])
    ways = (few.position, few.speed, few.acceleration)
    joints = [_Joint.of(few, k) for k in range(len(robot.joints))]
    rigid, torque = body.torque(*ways), few.torque
    without, with_ = _left(joints, torque), _left(joints, torque - rigid)
    hung = body.regressor(*ways)[:, :, body.tool, :4]
    numbers = _fitted(joints, hung, torque - rigid)
    if numbers[0] > -body.parameters[body.tool, 0]:  # less, and what the last joint moves would weigh less than nothing
        with_ = np.minimum(with_, _left(joints, torque - rigid - hung @ numbers))
    asked = rigid.std(axis=0) > GAIN_ERROR * np.maximum(torque.std(axis=0), 1e-12)
    wrong = asked & (with_ > WORSE * without) & (with_ - without > _unsure(robot, body, few) ** 2)
    names = [joint.name for joint in robot.joints]
    said = ", ".join(name for name, bad in zip(names, wrong, strict=True) if bad) or "the joints"
    would_fit = [
        *_gravity(robot, body, few, joints, rigid),
        *_orders(body, few, joints, names, every=bool(wrong.any())),
    ]
    if wrong.any():
        turned = np.where(wrong, _left(joints, -torque - rigid), with_)
        would_fit.append((turned, f"with the other sign they are: turn the factor of {said} in the map"))
    start = f"the torques of {said} are not those that this robot asks for along this motion"
    least = np.minimum(with_, without)  # what would be right is better than no rigid body at all
    for left, text in sorted(would_fit, key=lambda one: _log(one[0]))[:1]:
        if _log(left) < _log(least) + math.log(FAR_BETTER):
            raise InvestigationError(f"{start}; {text}")
    if wrong.any() and 2 * wrong.sum() >= asked.sum():
        raise InvestigationError(
            f"{start}, and no other order of the joints, sign or direction of gravity explains them. "
            "The URDF may be of another robot, the torques not at the joints (N m), or the positions not from its "
            "zeros."
        )
    return frozenset(np.flatnonzero(wrong).tolist())


@dataclass(frozen=True)
class _Joint:
    """What is asked of a joint: `rows` that say it, and there an orthonormal basis of dry and viscous friction, offset
    and rotor, shape (rows, 4); no rows where its torque was not measured.

    At rest friction holds what the load asks for, and the torque may be any. One that hardly moves is asked at rest.
    """

    rows: NDArray[np.int64]
    basis: Array

    @staticmethod
    def of(motion: Motion, place: int) -> _Joint:
        speed, acceleration = motion.speed[:, place], motion.acceleration[:, place]
        way = np.tanh(speed / max(0.03 * float(np.abs(speed).max()), 1e-12))
        moves = np.abs(way) > TURNED
        moves |= moves.sum() < FEWEST
        rows = np.flatnonzero(moves & (place not in motion.unmeasured))
        return _Joint(rows, np.linalg.qr(np.stack([way, speed, np.ones_like(way), acceleration], axis=1)[rows])[0])

    def beyond(self, values: Array) -> Array:
        """What friction and rotor leave of columns, shape (rows, ...)."""
        there = values[self.rows]
        return np.asarray(there - self.basis @ (self.basis.T @ there))


def _left(joints: list[_Joint], torque: Array) -> Array:
    """Mean squares that friction and rotor leave of each joint's torque while it moves; 1 where it is not measured."""
    left = [
        float(np.mean(one.beyond(each) ** 2)) if one.rows.size else 1.0
        for one, each in zip(joints, torque.T, strict=True)
    ]
    return np.asarray(np.maximum(left, 1e-300), dtype=np.float64)


def _fitted(joints: list[_Joint], columns: Array, torque: Array) -> Array:
    """Numbers of `columns`, shape (rows, joints, p), that explain torques beside any friction; shape (p,)."""
    parts = [(one.beyond(columns[:, k]), one.beyond(torque[:, k])) for k, one in enumerate(joints)]
    scales = [max(float(y.std()), 1e-12) if y.size else 1.0 for _, y in parts]
    table, right = (
        np.concatenate([part[k] / scale for part, scale in zip(parts, scales, strict=True)]) for k in range(2)
    )
    return np.asarray(np.linalg.lstsq(table, right, rcond=None)[0])


def _log(left: Array) -> float:
    """Of the product of all joints, as likelihoods multiply."""
    return float(np.sum(np.log(left)))


def _unsure(robot: Robot, body: RigidBody, motion: Motion) -> Array:
    """What of the torque of each joint may be wrong by the description's usual errors, shape (joints,) [N m].

    A joint that hardly carries anything asks for no more than a millimetre of the centre of what it carries.
    """
    values = shared_columns(robot, body, motion)[..., :-PARAMETERS]
    return np.asarray(np.sqrt(np.sum(values.var(axis=0), axis=-1)))


def _gravity(
    robot: Robot, body: RigidBody, motion: Motion, joints: list[_Joint], rigid: Array
) -> Iterator[tuple[Array, str]]:
    """Gravity that fits best, of the described size, where it pulls far off the direction described."""
    g = np.array(robot.gravity_m_s2)
    size = float(np.linalg.norm(g))
    ways = [body.at_rest(motion.position, way) for way in np.eye(3)]
    weights = np.stack([np.einsum("njbp,bp->nj", way, body.parameters) for way in ways], axis=-1)
    beyond = motion.torque - rigid + weights @ g
    found = _fitted(joints, weights, beyond)
    found *= size / max(float(np.linalg.norm(found)), 1e-12)
    if found @ g < size**2 * math.cos(ASKEW_RAD):
        x, y, z = (round(float(v), 2) for v in found)
        text = f"with gravity along another direction of the base they are: gravity_m_s2 = [{x}, {y}, {z}]"
        yield _left(joints, beyond - weights @ found), text


def _orders(
    body: RigidBody, motion: Motion, joints: list[_Joint], names: list[str], *, every: bool
) -> Iterator[tuple[Array, str]]:
    """Joints to which the log's columns may belong instead: two that change places, or `every` order of a few."""
    count = len(names)
    swaps = ([b if k == a else a if k == b else k for k in range(count)] for a, b in combinations(range(count), 2))
    for order in map(list, permutations(range(count))) if every and count <= MOST_ORDERS else swaps:
        back = np.argsort(order)  # column of the log that moves each joint
        asked = body.torque(motion.position[:, back], motion.speed[:, back], motion.acceleration[:, back])
        text = f"with the columns of the log in another order they are: {', '.join(names[k] for k in order)}"
        yield _left(joints, motion.torque - asked[:, order]), text
