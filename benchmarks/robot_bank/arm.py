"""Six-joint arms of three builds and payload classes from 3 to 20 kg, drawn by seed; every link a sum of solid pieces.

Sizes follow what makers publish of such robots: reach and mass grow with the payload class, links get lighter towards
the flange. A sum of solids is physically consistent whatever is drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.robot_bank.multibody import Array, Body, Chain

X, Y, Z = np.eye(3)
SHARES = np.array([0.24, 0.38, 0.18, 0.09, 0.08, 0.03])
"""Of the mass of all moving links, about as in the published descriptions of cooperative robots."""
TORQUES = np.array([1.0, 1.0, 0.5, 0.17, 0.17, 0.15])
"""Rated torque of a joint over that of the shoulder."""
DENSITY = 2500.0
"""Of a link with its motor and gear, between aluminium and steel with hollows [kg/m3]."""


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm in its pose of all zeros, base frame: a body per link, the base's mass [kg], and where the flange is.

    flange: rotation (3, 3) and place (3,) [m] of the flange, its z axis pointing out. class_kg: what it may carry.
    torque: rated (6,) [N m]; speed: largest (6,) [rad/s]; limit: of the angles both ways (6,) [rad].
    home, range: middle and half width (6,) of what a program uses [rad].
    """

    build: str
    class_kg: float
    chain: Chain
    bodies: tuple[Body, ...]
    base_kg: float
    flange: tuple[Array, Array]
    torque: Array
    speed: Array
    limit: Array
    home: Array
    range: Array


def cylinder(mass: float, start: Array, end: Array, radius: float) -> Body:
    """Return a solid cylinder from one point to another [m]."""
    along = end - start
    length = float(np.linalg.norm(along))
    direction = along / length if length > 0 else Z
    through, across = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
    outer = np.outer(direction, direction)
    return Body(mass, (start + end) / 2, through * outer + across * (np.eye(3) - outer))


def ball(mass: float, center: Array, radius: float) -> Body:
    """Return a solid ball."""
    return Body(mass, np.asarray(center, dtype=float), 0.4 * mass * radius**2 * np.eye(3))


Lines = tuple[list[Array], list[Array], Array, Array]
"""Directions, points, the flange's place and its outward direction."""


def _cooperative(rng: np.random.Generator, reach: float) -> Lines:
    """Shoulder, elbow and first wrist about parallel axes, then two wrist axes with offsets."""
    upper, fore = reach * rng.uniform(0.44, 0.5), reach * rng.uniform(0.38, 0.45)
    wrist, side = reach * rng.uniform(0.08, 0.11), reach * rng.uniform(0.09, 0.13)
    foot = reach * rng.uniform(0.13, 0.2)
    shoulder = side * Y + foot * Z
    elbow = side * rng.uniform(0.1, 0.3) * Y + (foot + upper) * Z
    first = elbow + fore * Z
    second = first + wrist * Y
    third = second + wrist * Z
    return [Z, Y, Y, Y, Z, Y], [0 * Z, shoulder, elbow, first, second, third], third + wrist * Y, Y


def _elbow(rng: np.random.Generator, reach: float) -> Lines:
    """Shoulder and elbow, the forearm ahead, three wrist axes through one point."""
    foot, upper = reach * rng.uniform(0.25, 0.4), reach * rng.uniform(0.42, 0.5)
    ahead = reach * rng.uniform(0.0, 0.12)
    up = reach * rng.uniform(0.0, 0.08)
    fore = reach * rng.uniform(0.4, 0.48)
    shoulder = ahead * X + foot * Z
    elbow = shoulder + upper * Z
    roll = elbow + up * Z + 0.3 * fore * X
    center = elbow + up * Z + fore * X
    return [Z, Y, Y, X, Y, X], [0 * Z, shoulder, elbow, roll, center, center], center + 0.09 * reach * X, X


def _selective(rng: np.random.Generator, reach: float) -> Lines:
    """Two upright axes that sweep a plane, as in a SCARA, and a wrist of four axes."""
    foot, first, second = (
        reach * rng.uniform(0.3, 0.45),
        reach * rng.uniform(0.38, 0.45),
        reach * rng.uniform(0.3, 0.38),
    )
    wrist = reach * rng.uniform(0.1, 0.14)
    middle = foot * Z + first * X
    pitch = middle + second * X
    roll = pitch + 0.5 * wrist * X
    again = roll + wrist * X
    return [Z, Z, Y, X, Y, X], [0 * Z, middle, pitch, roll, again, again], again + 0.6 * wrist * X, X


BUILDS: dict[str, tuple[Callable[[np.random.Generator, float], Lines], Array, Array]] = {
    "cooperative": (_cooperative, np.array([0, -0.5, 0.9, -0.4, 0, 0]), np.array([1.6, 0.8, 1.0, 1.8, 2.0, 2.4])),
    "elbow": (_elbow, np.array([0, 0.2, 0.1, 0, 0.3, 0]), np.array([1.6, 0.7, 0.9, 2.2, 1.4, 2.6])),
    "selective": (_selective, np.array([0, 0.4, 0.1, 0, 0.2, 0]), np.array([1.4, 1.3, 0.9, 2.0, 1.3, 2.6])),
}
"""Lines, and middle and half width of what a program uses of the joints' angles [rad]."""


def draw_arm(rng: np.random.Generator) -> Arm:
    """Draw an arm of any build."""
    build = str(rng.choice(list(BUILDS)))
    lines, home, reach_of_program = BUILDS[build]
    class_kg = float(np.exp(rng.uniform(np.log(3.0), np.log(20.0))))
    reach = 0.5 * (class_kg / 3.0) ** 0.6 * rng.uniform(0.9, 1.1)
    total = 4.5 * class_kg**0.85 * rng.uniform(0.9, 1.1) * (1.5 if build == "elbow" else 1.0)
    directions, points, flange, outward = lines(rng, reach)
    # makers count either sense of turning as positive
    signs = rng.choice([-1.0, 1.0], 6)
    chain = Chain(np.array(directions) * signs[:, None], np.array(points))
    masses = SHARES * rng.uniform(0.8, 1.2, 6)
    masses *= total / masses.sum()
    ends = [*points[1:], flange]
    bodies = tuple(_link(rng, m, a, b, d) for m, a, b, d in zip(masses, points, ends, directions, strict=True))
    shoulder = 0.8 * total * reach * 9.81
    jitter = rng.uniform(0.9, 1.1, 6)
    return Arm(
        build,
        class_kg,
        chain,
        bodies,
        base_kg=0.2 * total,
        flange=(_frame(rng, outward), flange),
        torque=np.round(shoulder * TORQUES * jitter),
        speed=np.round(np.array([3.1, 3.1, 3.3, 5.2, 5.2, 6.3]) * rng.uniform(0.8, 1.2), 2),
        limit=np.array([6.28, 2.9, 2.9, 6.28, 4.5, 6.28]) if rng.random() < 0.5 else np.full(6, 6.28),
        home=home * signs + rng.uniform(-0.2, 0.2, 6),
        range=reach_of_program * rng.uniform(0.8, 1.1, 6),
    )


def _link(rng: np.random.Generator, mass: float, start: Array, end: Array, axis: Array) -> Body:
    """Return a link: a housing about each of its joints, a tube between, and something bolted to its side."""
    shares = rng.dirichlet([6, 4, 4, 0.7])
    housing = (mass / (4 * np.pi * DENSITY)) ** (1 / 3)
    span = end - start
    aside = start + rng.uniform(0.2, 0.8) * span + housing * rng.uniform(-1.5, 1.5, 3)
    pieces = (
        cylinder(mass * shares[0], start - housing * axis, start + housing * axis, housing),
        cylinder(mass * shares[1], start, end, 0.6 * housing),
        ball(mass * shares[2], start + 0.9 * span, 0.8 * housing),
        ball(mass * shares[3], aside, 0.4 * housing),
    )
    return pieces[0] + pieces[1] + pieces[2] + pieces[3]


def _frame(rng: np.random.Generator, outward: Array) -> Array:
    """Return a right-handed frame (3, 3) with its z axis outward, turned about it by a quarter or so."""
    across = np.roll(outward, 1)
    third = np.cross(outward, across)
    turn = rng.choice([0, np.pi / 2, np.pi, rng.uniform(-np.pi, np.pi)])
    first = np.cos(turn) * across + np.sin(turn) * third
    return np.column_stack([first, np.cross(outward, first), outward])
