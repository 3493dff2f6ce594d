"""Torques of a serial arm by Kane's equations, all vectors in the base frame.

An arm is described by its pose of all zeros alone: a line in space for each joint (direction and a point) and a rigid
body for each link. A pose moves link i by the product of the rotations about the lines 1 to i (R. W. Brockett, Robotic
manipulators and the product of exponentials formula, 1984). The torque of joint j is the sum over all bodies of partial
velocity times rate of momentum and partial angular velocity times rate of angular momentum (T. R. Kane, D. A. Levinson,
Dynamics: Theory and Applications, 1985, chapter 6): no link frames, no recursion from the flange to the base.

Samples come first in all arrays: angles are (n, joints), vectors of one body (n, 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in the pose of all zeros, base frame: mass [kg], centre (3,) [m], inertia (3, 3) there [kg m2]."""

    mass: float
    center: Array
    inertia: Array

    def __add__(self, other: Body) -> Body:
        """Return both bodies as one (parallel axis theorem)."""
        mass = self.mass + other.mass
        center = (self.mass * self.center + other.mass * other.center) / mass
        return Body(mass, center, self.inertia_about(center) + other.inertia_about(center))

    def inertia_about(self, point: Array) -> Array:
        """Return the inertia about a point (3,) of the base frame [kg m2]."""
        d = self.center - point
        return self.inertia + self.mass * (d @ d * np.eye(3) - np.outer(d, d))


@dataclass(frozen=True, eq=False)
class Chain:
    """Lines of the joints in the pose of all zeros: directions (joints, 3) and points on them (joints, 3) [m]."""

    directions: Array
    points: Array

    def placements(self, angles: Array) -> list[tuple[Array, Array]]:
        """Return for each link rotation (n, 3, 3) and shift (n, 3) [m] that carry it from the pose of all zeros."""
        n = len(angles)
        rotation, shift = np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros((n, 3))
        placed = []
        for j, (direction, point) in enumerate(zip(self.directions, self.points, strict=True)):
            turn = rotation_about(direction, angles[:, j])
            shift = shift + np.einsum("nab,nb->na", rotation, point - turn @ point)
            rotation = rotation @ turn
            placed.append((rotation, shift))
        return placed


def rotation_about(direction: Array, angle: Array) -> Array:
    """Return rotations (n, 3, 3) by angles (n,) [rad] about a unit vector (Rodrigues)."""
    x, y, z = direction
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle)[:, None, None] * skew + (1 - np.cos(angle))[:, None, None] * (skew @ skew)


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products of (n, 3) vectors; numpy's own takes several times as long."""
    return np.stack(
        (
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ),
        axis=1,
    )


def torques(
    chain: Chain, bodies: tuple[Body, ...], angles: Array, speeds: Array, accelerations: Array, gravity: Array
) -> Array:
    """Return the torques (n, joints) [N m] that a motion asks of the joints.

    Angles [rad], speeds [rad/s] and accelerations [rad/s2] are (n, joints); gravity (3,) [m/s2] is in the base frame;
    body i moves with joint i.
    """
    n, joints = angles.shape
    placed = chain.placements(angles)
    torque = np.zeros((n, joints))
    lines: list[tuple[Array, Array, Array, Array]] = []  # direction, its rate, point, its velocity
    spin, spin_rate = np.zeros((n, 3)), np.zeros((n, 3))
    for i, (rotation, shift) in enumerate(placed):
        direction = rotation @ chain.directions[i]
        point = rotation @ chain.points[i] + shift
        velocity = sum(
            (speeds[:, k, None] * _cross(lines[k][0], point - lines[k][2]) for k in range(i)), np.zeros((n, 3))
        )
        turning = _cross(spin, direction)
        lines.append((direction, turning, point, velocity))
        spin = spin + speeds[:, i, None] * direction
        spin_rate = spin_rate + accelerations[:, i, None] * direction + speeds[:, i, None] * turning
        body = bodies[i]
        center = rotation @ body.center + shift
        levers = [center - line[2] for line in lines]
        partial = [_cross(line[0], lever) for line, lever in zip(lines, levers, strict=True)]
        moving = sum((speeds[:, k, None] * partial[k] for k in range(i + 1)), np.zeros((n, 3)))
        acceleration = np.zeros((n, 3))
        for k, (line, lever) in enumerate(zip(lines, levers, strict=True)):
            acceleration += accelerations[:, k, None] * partial[k]
            acceleration += speeds[:, k, None] * (_cross(line[1], lever) + _cross(line[0], moving - line[3]))
        force = body.mass * (acceleration - gravity)
        inertia = rotation @ body.inertia @ rotation.transpose(0, 2, 1)
        moment = np.einsum("nab,nb->na", inertia, spin_rate)
        moment += _cross(spin, np.einsum("nab,nb->na", inertia, spin))
        for j in range(i + 1):
            torque[:, j] += np.einsum("na,na->n", partial[j], force) + np.einsum("na,na->n", lines[j][0], moment)
    return torque
