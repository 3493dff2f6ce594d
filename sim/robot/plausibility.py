"""Can a log be of the robot that is described? Order of the joints, signs, the way down, another robot."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from sim.discrepancy.data.data_fault import InvestigationError
from sim.robot.motion import Motion
from sim.robot.rigid_body import PARAMETERS, RigidBody
from sim.robot.robot import Robot, position_key
from sim.robot.shared_fit import TILT_RAD, shared_columns

Array = NDArray[np.float64]

ROWS = 60  # for each order of the joints that is tried
MOST_ORDERS = 6  # joints, of which all orders are tried
WORSE = 1.5  # times the squares without any rigid body: masses that are off by several percent do not get there
FAR_BETTER = 0.25  # of the squares of all joints, multiplied: what else would be right explains the torques
ASKEW_RAD = 10.0 * TILT_RAD  # a base that is off by more was mounted so, and no error of masses looks like it
TURNED = 0.5  # of its dry friction, which a joint that moves has in full
FEWEST = 20  # rows in motion, for three numbers of friction and the rotor
CHECKED = 0.05  # of a joint's torque, from which the rigid body's counts


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
        where they are more; naming the joints whose torques the rigid body makes worse, and an order, a sign or a
        direction of gravity that explains them, where there is one.
    """
    counting = np.flatnonzero(motion.counts)
    few = counting[np.linspace(0, counting.size - 1, min(counting.size, 10 * ROWS)).astype(int)]
    ways = (motion.position[few], motion.speed[few], motion.acceleration[few])
    rigid = body.torque(*ways)
    absent, measured = list(motion.unmeasured), motion.torque.copy()
    measured[np.ix_(few, absent)] = rigid[:, absent]  # a joint without torque speaks against nothing
    motion = replace(motion, torque=measured)
    frictions, torque = _frictions(motion, few), measured[few]
    without, with_ = _left(torque, frictions), _left(torque - rigid, frictions)
    if np.any(with_ > WORSE * without):
        with_ = _with_payload(body, motion, few, rigid, frictions, with_)
    asked = rigid.std(axis=0) > CHECKED * np.maximum(torque.std(axis=0), 1e-12)
    wrong = asked & (with_ > WORSE * without)
    if wrong.any():
        wrong &= with_ - without > _unsure(robot, body, motion) ** 2  # worse than errors of the description make it
    names = [joint.name for joint in robot.joints]
    joints = len(names)
    order = _order(body, motion, frictions, few, every=wrong.any() and joints <= MOST_ORDERS)
    least = np.minimum(with_, without)  # what would be right is better than no rigid body at all
    swapped = order is not None and _explains(order[1], least)
    down = _direction(robot, body, motion, few, rigid, frictions)
    askew = down is not None and _angle(down[0], np.array(robot.gravity_m_s2)) > ASKEW_RAD and _explains(down[1], least)
    if askew and not wrong.any():
        least = np.minimum(least, _with_payload(body, motion, few, rigid, frictions, least))
        askew = down is not None and _explains(down[1], least)
    if not wrong.any() and not swapped and not askew:
        return frozenset(np.flatnonzero(wrong).tolist())
    said = ", ".join(name for name, bad in zip(names, wrong, strict=True) if bad) or "the joints"
    would_fit: list[tuple[Array, str]] = []
    if down is not None:
        x, y, z = (round(float(v), 2) for v in down[0])
        text = f"with gravity along another direction of the base they are: gravity_m_s2 = [{x}, {y}, {z}]"
        would_fit.append((down[1], text))
    if wrong.any():
        turned = np.where(wrong, _left(-torque - rigid, frictions), with_)
        would_fit.append((turned, f"with the other sign they are: turn the factor of {said} in the map"))
    if order is not None:
        right = ", ".join(names[k] for k in order[0])
        would_fit.append((order[1], f"with the columns of the log in another order they are: {right}"))
    left, text = min(would_fit, key=lambda one: float(np.sum(np.log(one[0]))), default=(with_, ""))
    start = f"the torques of {said} are not those that this robot asks for along this motion"
    if _explains(left, least):
        raise InvestigationError(f"{start}; {text}")
    if 2 * wrong.sum() < asked.sum():
        return frozenset(np.flatnonzero(wrong).tolist())
    raise InvestigationError(
        f"{start}, and no other order of the joints, sign or direction of gravity explains them. "
        "The URDF may be of another robot, the torques not at the joints (N m), or the positions not from its zeros."
    )


def _angle(one: Array, other: Array) -> float:
    """Between two vectors [rad]."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def _with_payload(
    body: RigidBody, motion: Motion, few: NDArray[np.int64], rigid: Array, frictions: list[Array], left: Array
) -> Array:
    """Mean squares that are left of each joint with the payload that fits best; `left` where that weighs too little."""
    hung = body.regressor(motion.position[few], motion.speed[few], motion.acceleration[few])[:, :, body.tool, :4]
    torque = motion.torque[few]
    numbers = _fitted(hung, torque - rigid, torque, frictions)
    if numbers[0] <= -body.parameters[body.tool, 0]:  # with it, what the last joint moves weighs less than nothing
        return left
    return _left(torque - rigid - hung @ numbers, frictions)


def _unsure(robot: Robot, body: RigidBody, motion: Motion) -> Array:
    """What of the torque of each joint may be wrong by the description's usual errors, shape (joints,) [N m].

    A joint that hardly carries anything asks for no more than a millimetre of the centre of what it carries.
    """
    values = shared_columns(robot, body, motion).values[motion.counts][..., :-PARAMETERS]
    return np.asarray(np.sqrt(np.sum(values.var(axis=0), axis=-1)))


def _explains(left: Array, before: Array) -> bool:
    """Whether the joints together leave far less: by the product of what each leaves, as likelihoods multiply."""
    return float(np.sum(np.log(left / before))) < math.log(FAR_BETTER)


def _frictions(motion: Motion, few: NDArray[np.int64]) -> list[Array]:
    """Dry and viscous friction, offset and rotor of each joint, shape (rows, 4)."""
    out = []
    for speed, acceleration in zip(motion.speed[few].T, motion.acceleration[few].T, strict=True):
        way = np.tanh(speed / max(0.03 * float(np.abs(speed).max()), 1e-12))
        out.append(np.stack([way, speed, np.ones_like(speed), acceleration], axis=1))
    return out


def _in_motion(friction: Array) -> NDArray[np.bool_]:
    """Rows of a joint that say what is asked of it, by its columns of friction (rows, 4).

    At rest friction holds what the load asks for, and the torque may be any. One that hardly moves is asked at rest.
    """
    moves = np.abs(friction[:, 0]) > TURNED
    return moves if moves.sum() >= FEWEST else np.ones(moves.size, dtype=np.bool_)


def _left(torque: Array, frictions: list[Array]) -> Array:
    """Mean squares that friction and rotor leave of each joint's torque while it moves, shape (joints,)."""
    out = []
    for values, columns in zip(torque.T, frictions, strict=True):
        counts = _in_motion(columns)
        values, columns = values[counts], columns[counts]
        left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        out.append(float(np.mean(left**2)))
    return np.asarray(np.maximum(out, 1e-300), dtype=np.float64)


def _direction(
    robot: Robot, body: RigidBody, motion: Motion, few: NDArray[np.int64], rigid: Array, frictions: list[Array]
) -> tuple[Array, Array] | None:
    """Gravity that fits best, of the described size, and what it leaves; None without gravity."""
    g = np.array(robot.gravity_m_s2)
    size = float(np.linalg.norm(g))
    if size == 0.0:
        return None
    ways = [body.at_rest(motion.position[few], way) for way in np.eye(3)]
    weights = np.stack([np.einsum("njbp,bp->nj", way, body.parameters) for way in ways], axis=-1)
    dynamic = rigid - weights @ g
    found = _fitted(weights, motion.torque[few] - dynamic, motion.torque[few], frictions)
    found *= size / max(float(np.linalg.norm(found)), 1e-12)
    return found, _left(motion.torque[few] - dynamic - weights @ found, frictions)


def _fitted(columns: Array, left: Array, torque: Array, frictions: list[Array]) -> Array:
    """Numbers that explain what is left of all joints, each by its torque, beside any friction; shape (p,).

    `columns`: per number, shape (rows, joints, p).
    """
    rows, right = [], []
    count = columns.shape[-1]
    for j, friction in enumerate(frictions):
        counts = _in_motion(friction)
        table, friction = np.column_stack([columns[:, j], left[:, j]])[counts], friction[counts]
        table = table - friction @ np.linalg.lstsq(friction, table, rcond=None)[0]
        table /= max(float(torque[:, j].std()), 1e-12)
        rows.append(table[:, :count])
        right.append(table[:, count])
    return np.asarray(np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0])


def _order(
    body: RigidBody, motion: Motion, frictions: list[Array], few: NDArray[np.int64], *, every: bool
) -> tuple[tuple[int, ...], Array] | None:
    """Joints to which the log's columns belong if not to those described, and what is left then of each column.

    Two that change places are always tried, `every` order where something is wrong: by a tenth of the rows, and the
    best by all of `few`, as what it is held against.
    """
    joints = motion.position.shape[1]
    some = slice(None, None, max(1, few.size // ROWS))
    columns = [each[some] for each in frictions]
    given = tuple(range(joints))

    def left(order: tuple[int, ...], rows: NDArray[np.int64], shapes: list[Array]) -> Array:
        back = np.argsort(order)  # column of the log that moves each joint
        ways = (motion.position[rows][:, back], motion.speed[rows][:, back], motion.acceleration[rows][:, back])
        return _left(motion.torque[rows] - body.torque_of(*ways)[:, list(order)], shapes)

    tried = [order for order in (permutations(given) if every else _swaps(given)) if order != given]
    if not tried:
        return None
    best = min(tried, key=lambda order: float(np.sum(np.log(left(order, few[some], columns)))))
    return best, left(best, few, frictions)


def _swaps(given: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    for a, b in combinations(given, 2):
        order = list(given)
        order[a], order[b] = b, a
        yield tuple(order)
