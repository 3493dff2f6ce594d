"""The drive of a joint: rotor, gear and friction, all felt at the joint, and what may be wrong with it.

The load follows the program exactly; the motor does what that takes. Gears are rigid. Where one has play, the motor's
angle is the load's and that of the play, which hangs on the torque that the gear carries; everything else follows by
differentiation (the drive is flat, M. Fliess et al., 1995): exact, and nothing is integrated.

Dry friction builds up over a small way as teeth and bearings give (P. R. Dahl, 1968); with the motion known it is an
exponential of the way gone since the last reversal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.robot_bank.motion import smooth
from benchmarks.robot_bank.multibody import Array

CONTACT_SHARE = 0.004
"""Flanks of teeth change over about this share of the joint's rated torque."""


@dataclass(frozen=True)
class Drive:
    """Numbers at the joint: rotor [kg m2], dry [N m] and viscous friction [N m s/rad], rated torque [N m].

    gear: motor turns per joint turn. way: over which dry friction builds up [rad]. Of what is wrong: `raised` is a
    factor of dry friction; stribeck is dry friction [N m] that is gone above `stribeck_speed` [rad/s]; asymmetry is the
    share by which friction is larger forward and smaller backward; drift is the growth of friction [1/s]; a missing
    counterweight asks `imbalance` sin(angle + phase) [N m] of the motor; ripple [N m] has an order of the motor's
    angle; gap [rad] is the whole play of the gear.
    """

    rotor: float
    dry: float
    viscous: float
    rated: float
    gear: float
    way: float
    start: float = 0.0
    raised: float = 1.0
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    asymmetry: float = 0.0
    drift: float = 0.0
    imbalance: float = 0.0
    imbalance_phase: float = 0.0
    ripple: float = 0.0
    ripple_order: float = 1.0
    ripple_phase: float = 0.0
    gap: float = 0.0


def bristles(angle: Array, way: float, start: float) -> Array:
    """Return dry friction over its full value (n,) for the course of an angle (n,) [rad]: Dahl's, between -1 and 1."""
    step = np.diff(angle, prepend=angle[0])
    # a motion at rest was smoothed: what rounding leaves of it is no way
    step[np.abs(step) < 1e-12] = 0.0
    moving = np.sign(step)
    gone = np.cumsum(np.abs(step)) / way
    out = np.empty_like(angle)
    # a stretch without reversal: towards its sign by the exponential of the way; at rest nothing changes
    edges = np.flatnonzero(np.diff(moving, prepend=moving[0])).tolist()
    level, since = start, 0.0
    for a, b in zip([0, *edges], [*edges, len(angle)], strict=True):
        if moving[a] == 0:
            out[a:b] = level
        else:
            out[a:b] = moving[a] + (level - moving[a]) * np.exp(-(gone[a:b] - since))
        level, since = float(out[b - 1]), float(gone[b - 1])
    return out


def friction(drive: Drive, time: Array, angle: Array, speed: Array) -> Array:
    """Return the torque (n,) [N m] that friction takes."""
    side = bristles(angle, drive.way, drive.start)
    dry = drive.raised * drive.dry + drive.stribeck * np.exp(-((speed / drive.stribeck_speed) ** 2))
    return (dry * side + drive.viscous * speed) * (1 + drive.asymmetry * side) * (1 + drive.drift * time)


def motor_angle(drive: Drive, angle: Array, carried: Array) -> Array:
    """Return the motor's angle over the gear's ratio (n,) [rad] for the load's angle and the torque carried [N m]."""
    contact = np.tanh(carried / (CONTACT_SHARE * drive.rated))
    return angle + drive.gap / 2 * contact


def motor_torque(drive: Drive, time: Array, angle: Array, carried: Array) -> tuple[Array, Array, Array]:
    """Return the motor's torque [N m], angle [rad] and speed [rad/s] (n,), all at the joint.

    `angle` (n,) is the load's, `carried` (n,) the torque that the rigid body asks of the joint [N m].
    """
    balance = drive.imbalance * np.sin(angle + drive.imbalance_phase)
    carried = carried + balance
    motor = motor_angle(drive, angle, carried)
    speeds, accelerations = smooth(time, motor[:, None])
    speed = speeds[:, 0]
    torque = carried + drive.rotor * accelerations[:, 0] + friction(drive, time, motor, speed)
    torque -= drive.ripple * np.sin(drive.ripple_order * drive.gear * motor + drive.ripple_phase)
    return torque, motor, speed
