"""Robots of five builds, drawn by seed: lines of joints, links as sums of solid pieces, and what programs use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.robot_bank.arm import ball, cylinder
from tests.robot_bank.multibody import Array, Body

X, Y, Z = np.eye(3)
DENSITY = 2700.0
"""Of a link with hollows, motors and gears [kg/m3]."""


@dataclass(frozen=True, eq=False)
class Build:
    """A robot at rest in its pose of all zeros, base frame.

    sliding: (n,) whether a joint slides: its angles, speeds and torques are then m, m/s and N. directions, points:
    (n, 3) its line. bodies: of the links; base_kg: what stands still. flange: rotation (3, 3) and place (3,) [m], z
    outward. gear: (n,) rad of the motor per rad or m of the joint. speed: (n,) largest. limit: (n,) both ways.
    home, range: (n,) middle and half width of what programs use.
    """

    name: str
    class_kg: float
    sliding: tuple[bool, ...]
    directions: Array
    points: Array
    bodies: tuple[Body, ...]
    base_kg: float
    flange: tuple[Array, Array]
    gear: Array
    speed: Array
    limit: Array
    home: Array
    range: Array

    @property
    def joints(self) -> int:
        """How many joints it has."""
        return len(self.sliding)


def box(mass: float, center: Array, sides: Array) -> Body:
    """Return a solid box along the base's axes."""
    return Body(mass, np.asarray(center, dtype=float), mass / 12 * np.diag(np.sum(sides**2) - sides**2))


@dataclass(frozen=True, eq=False)
class _Sketch:
    """What a build draws: see `Build`; masses are those of the links, flange its place and its outward direction."""

    class_kg: float
    directions: list[Array]
    points: list[Array]
    masses: Array
    flange: tuple[Array, Array]
    gear: Array
    speed: Array
    home: Array
    range: Array
    sliding: tuple[int, ...] = ()


def _heavy(rng: np.random.Generator) -> _Sketch:
    """Six axes for 60 to 200 kg: shoulder ahead of the column, no parallelogram, three wrist axes through one point."""
    class_kg = float(np.exp(rng.uniform(np.log(60), np.log(200))))
    reach = 2.0 * (class_kg / 60) ** 0.25 * rng.uniform(0.95, 1.15)
    shoulder = reach * (rng.uniform(0.1, 0.15) * X + rng.uniform(0.24, 0.3) * Z)
    elbow = shoulder + reach * rng.uniform(0.4, 0.46) * Z
    lift = elbow + reach * rng.uniform(0.01, 0.06) * Z
    center = lift + reach * rng.uniform(0.42, 0.5) * X
    return _Sketch(
        class_kg,
        [Z, Y, Y, X, Y, X],
        [0 * Z, shoulder, elbow, lift + 0.3 * (center - lift), center, center],
        90 * class_kg**0.45 * np.array([0.33, 0.27, 0.22, 0.1, 0.05, 0.03]),
        (center + 0.09 * reach * X, X),
        rng.uniform([120, 150, 140, 60, 60, 40], [220, 250, 240, 120, 110, 90]),
        rng.uniform(0.85, 1.2) * np.array([1.9, 1.8, 1.9, 3.2, 3.2, 4.2]),
        np.array([0, 0.1, 0.15, 0, 0.4, 0]),
        np.array([1.5, 0.6, 0.7, 2.0, 1.3, 2.5]),
    )


def _seven(rng: np.random.Generator) -> _Sketch:
    """Seven axes in turn upright and across, for 4 to 14 kg; the elbow in line or aside."""
    class_kg = float(rng.uniform(4, 14))
    reach = 0.75 + 0.01 * class_kg
    aside = rng.choice([0.0, 0.08]) * X
    heights = np.cumsum(reach * np.array([0.0, 0.38, 0.24, 0.26, 0.24, 0.24, 0.1]) * rng.uniform(0.95, 1.05, 7))
    points = [h * Z for h in heights]
    points[3] = points[3] + aside
    return _Sketch(
        class_kg,
        [Z, Y, Z, Y, Z, Y, Z],
        points,
        (12 + class_kg) * np.array([0.2, 0.2, 0.17, 0.16, 0.12, 0.1, 0.05]),
        (points[-1] + 0.1 * reach * Z, Z),
        rng.choice([100.0, 101.0, 120.0, 160.0], 7),
        rng.uniform(0.9, 1.2) * np.array([1.7, 1.7, 1.8, 1.9, 2.3, 2.4, 2.6]),
        np.array([0, 0.5, 0, -1.2, 0, 0.9, 0]),
        np.array([1.5, 0.6, 1.2, 0.7, 1.6, 0.9, 2.0]),
    )


def _scara(rng: np.random.Generator) -> _Sketch:
    """Two upright axes, a quill that slides and turns, for 3 to 10 kg."""
    class_kg = float(rng.uniform(3, 10))
    reach = rng.uniform(0.45, 0.85)
    middle, end = 0.53 * reach * X + 0.2 * Z, reach * X + 0.2 * Z
    lead = rng.choice([0.01, 0.016, 0.02])
    return _Sketch(
        class_kg,
        [Z, Z, -Z, -Z],
        [0 * Z, middle, end, end],
        (8 + 1.5 * class_kg) * np.array([0.5, 0.32, 0.13, 0.05]),
        (end - 0.15 * Z, -Z),
        np.array([rng.choice([50.0, 80.0]), rng.choice([50.0, 80.0]), 2 * np.pi / lead, rng.uniform(12, 25)]),
        rng.uniform(0.7, 1.1) * np.array([4.5, 6.0, 0.9, 12.0]),
        np.array([0, 0.6, 0.08, 0]),
        np.array([1.7, 1.2, 0.07, 2.6]),
        (2,),
    )


def _gantry(rng: np.random.Generator) -> _Sketch:
    """Bridge, carriage and ram slide, a head turns; for 10 to 50 kg."""
    class_kg = float(rng.uniform(10, 50))
    carriage, ram = 0.15 * Y + 0.05 * Z, 0.25 * Y - 0.1 * Z
    end = 0.25 * Y - 0.9 * Z
    return _Sketch(
        class_kg,
        [X, Y, -Z, -Z],
        [0 * Z, carriage, ram, end],
        (30 + class_kg) * np.array([2.0, 0.9, 0.5, 0.1]) * rng.uniform(0.8, 1.2),
        (end - 0.12 * Z, -Z),
        np.array([*(2 * np.pi / rng.choice([0.12, 0.16, 0.2], 2) * rng.uniform(3, 8)), 2 * np.pi / 0.02, 50.0]),
        rng.uniform(0.8, 1.2) * np.array([1.6, 1.6, 0.9, 3.5]),
        np.array([0.0, 0, 0.2, 0]),
        np.array([0.9, 0.6, 0.25, 2.5]),
        (0, 1, 2),
    )


def _five(rng: np.random.Generator) -> _Sketch:
    """Five axes for 0.5 to 3 kg: three across one after another, and a hand that rolls."""
    class_kg = float(rng.uniform(0.5, 3))
    reach = 0.34 + 0.07 * class_kg
    shoulder = reach * rng.uniform(0.3, 0.4) * Z
    elbow = shoulder + reach * rng.uniform(0.42, 0.5) * Z
    wrist = elbow + reach * rng.uniform(0.42, 0.5) * X
    hand = wrist + 0.15 * reach * X
    return _Sketch(
        class_kg,
        [Z, Y, Y, Y, X],
        [0 * Z, shoulder, elbow, wrist, hand],
        (4 + 2 * class_kg) * np.array([0.33, 0.3, 0.2, 0.12, 0.05]),
        (hand + 0.05 * X, X),
        rng.choice([50.0, 80.0, 100.0], 5),
        rng.uniform(0.8, 1.2) * np.array([2.6, 2.6, 2.8, 3.5, 4.5]),
        np.array([0, 0.1, 0.2, 0.4, 0]),
        np.array([1.6, 0.7, 0.8, 1.0, 2.4]),
    )


BUILDS: dict[str, Callable[[np.random.Generator], _Sketch]] = {
    "heavy": _heavy,
    "seven": _seven,
    "scara": _scara,
    "gantry": _gantry,
    "five": _five,
}


def draw_build(rng: np.random.Generator, name: str | None = None) -> Build:
    """Draw a robot, of a build or of any."""
    name = str(rng.choice(list(BUILDS), p=[0.3, 0.25, 0.15, 0.1, 0.2])) if name is None else name
    sketch = BUILDS[name](rng)
    n = len(sketch.points)
    masses = sketch.masses * rng.uniform(0.85, 1.15, n)
    place, outward = sketch.flange
    ends = [*sketch.points[1:], place]
    bodies = tuple(
        _link(rng, m, a, b, d) for m, a, b, d in zip(masses, sketch.points, ends, sketch.directions, strict=True)
    )
    # makers count either sense as positive
    signs = rng.choice([-1.0, 1.0], n)
    return Build(
        name,
        sketch.class_kg,
        tuple(j in sketch.sliding for j in range(n)),
        np.array(sketch.directions) * signs[:, None],
        np.array(sketch.points),
        bodies,
        0.3 * float(masses.sum()),
        (_outward_frame(outward), place),
        np.round(sketch.gear, 3),
        np.round(sketch.speed, 2),
        np.abs(sketch.home) + 1.5 * sketch.range,
        sketch.home * signs,
        sketch.range * rng.uniform(0.7, 1.0, n),
    )


def _link(rng: np.random.Generator, mass: float, start: Array, end: Array, axis: Array) -> Body:
    """Return a link: a motor with its gear at the joint, a hollow casting along the way, a box of cables beside it."""
    shares = rng.dirichlet([5, 6, 1])
    radius = float(np.cbrt(mass * shares[0] / (np.pi * DENSITY)))
    span = end - start
    motor = cylinder(mass * shares[0], start - 0.6 * radius * axis, start + 0.6 * radius * axis, radius)
    width = float(np.sqrt(mass * shares[1] / (0.4 * DENSITY * max(float(np.linalg.norm(span)), 2 * radius) * np.pi)))
    casting = cylinder(mass * shares[1], start, end, width) if np.any(span) else ball(mass * shares[1], start, radius)
    sides = np.cbrt(mass * shares[2] / DENSITY) * rng.uniform(0.6, 1.6, 3)
    aside = start + rng.uniform(0.1, 0.9) * span + radius * rng.uniform(-1.2, 1.2, 3)
    return motor + casting + box(mass * shares[2], aside, sides)


def _outward_frame(outward: Array) -> Array:
    """Return a right-handed frame (3, 3) with its z axis outward."""
    across = np.roll(outward, 1)
    return np.column_stack([across, np.cross(outward, across), outward])


def draw_payload(rng: np.random.Generator, build: Build) -> Body:
    """Draw a workpiece in a gripper: a fifth to nine tenths of what the robot carries."""
    mass = float(rng.uniform(0.2, 0.9) * build.class_kg)
    frame, place = build.flange
    size = float(np.cbrt(mass / 5000))
    sides = size * rng.uniform(0.6, 1.6, 3)
    offset = np.array([*(0.6 * size * rng.uniform(-1, 1, 2)), size * rng.uniform(0.6, 1.2)])
    inertia = mass / 12 * np.diag(np.sum(sides**2) - sides**2)
    return Body(mass, place + frame @ offset, frame @ inertia @ frame.T)
