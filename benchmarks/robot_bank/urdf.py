"""An arm written as makers write it: URDF with frames of their own choice, a fixed flange and tool, no meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

import numpy as np

from benchmarks.robot_bank.arm import Arm
from benchmarks.robot_bank.multibody import Array, Body

NAMES = (
    ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
    ("joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"),
    ("joint_a1", "joint_a2", "joint_a3", "joint_a4", "joint_a5", "joint_a6"),
    ("J1", "J2", "J3", "J4", "J5", "J6"),
)


@dataclass(frozen=True, eq=False)
class Written:
    """How an arm is written: joint names, a frame (3, 3) and its origin (3,) [m] per link, in the pose of all zeros.

    mount: rotation (3, 3) from the base into the world, which the URDF has as a fixed joint. turned: inertia of each
    link stands in axes turned (3, 3) against the link's. heavy_flange: the flange is a link with a mass of its own.
    dynamics: joints say friction and damping of 0, as many makers' files do. shuffle: seed of the elements' order.
    """

    names: tuple[str, ...]
    frames: tuple[tuple[Array, Array], ...]
    mount: Array
    turned: tuple[Array, ...]
    heavy_flange: bool
    dynamics: bool
    shuffle: int | None


def draw_written(rng: np.random.Generator, arm: Arm, mount: Array) -> Written:
    """Draw names and frames: all z axes along the joints, frames of the base, or frames turned by quarters."""
    habit = str(rng.choice(["along z", "of the base", "quarters"]))
    frames = []
    for direction, point in zip(arm.chain.directions, arm.chain.points, strict=True):
        if habit == "along z":
            frame = _with_z(direction)
        elif habit == "of the base":
            frame = np.eye(3)
        else:
            frame = np.linalg.matrix_power(_QUARTERS[int(rng.integers(3))], int(rng.integers(4)))
        # any point of the line will do as an origin
        along = rng.choice([0.0, 0.0, rng.uniform(-0.1, 0.1)])
        frames.append((frame, point + along * direction))
    names = NAMES[int(rng.integers(len(NAMES)))]
    turned = tuple(_random_rotation(rng) if rng.random() < 0.4 else np.eye(3) for _ in range(6))
    shuffle = int(rng.integers(1_000_000)) if rng.random() < 0.3 else None
    heavy_flange, dynamics = (bool(rng.random() < 0.5) for _ in range(2))
    return Written(names, tuple(frames), mount, turned, heavy_flange, dynamics, shuffle)


def _with_z(direction: Array) -> Array:
    """Return a right-handed frame (3, 3) whose z axis is a base axis, either way."""
    across = np.roll(direction, 1)
    return np.column_stack([across, np.cross(direction, across), direction])


def _random_rotation(rng: np.random.Generator) -> Array:
    q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return np.asarray(q * np.linalg.det(q))


_QUARTERS = (
    np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
)


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return the angles (3,) [rad] of Rz(yaw) Ry(pitch) Rx(roll), as a URDF has them."""
    if abs(rotation[2, 0]) > 1 - 1e-9:
        pitch = -np.sign(rotation[2, 0]) * np.pi / 2
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.array(
        [
            np.arctan2(rotation[2, 1], rotation[2, 2]),
            -np.arcsin(rotation[2, 0]),
            np.arctan2(rotation[1, 0], rotation[0, 0]),
        ]
    )


def last_frame(written: Written) -> tuple[Array, Array]:
    """Return frame (3, 3) and origin (3,) [m] of the link that the last joint moves."""
    return written.frames[-1]


def write_urdf(name: str, arm: Arm, bodies: Sequence[Body], written: Written) -> str:
    """Return the URDF; `bodies` are what the maker believes of the links."""
    robot = Xml.Element("robot", name=name)
    frames = written.frames
    links = [f"link_{i}" for i in range(1, 7)]
    parts: list[Xml.Element] = []
    flange_body, last = _split(bodies[-1]) if written.heavy_flange else (None, bodies[-1])
    parents = ["base_link", *links[:-1]]
    before = (np.eye(3), np.zeros(3))
    for i, (frame, origin) in enumerate(frames):
        body = last if i == 5 else bodies[i]
        parts.append(_link(links[i], body, frames[i], written.turned[i]))
        joint = _joint(written.names[i], "revolute", parents[i], links[i], before, frames[i])
        axis = frame.T @ arm.chain.directions[i]
        Xml.SubElement(joint, "axis", xyz=_numbers(axis))
        limit = {"lower": -arm.limit[i], "upper": arm.limit[i], "effort": arm.torque[i], "velocity": arm.speed[i]}
        Xml.SubElement(joint, "limit", {key: f"{value:g}" for key, value in limit.items()})
        if written.dynamics:
            Xml.SubElement(joint, "dynamics", damping="0.0", friction="0.0")
        parts.append(joint)
        before = (frame, origin)
    world, origin_frame = (written.mount.T, np.zeros(3)), (np.eye(3), np.zeros(3))
    base = Body(arm.base_kg, np.array([0, 0, 0.03]), 0.01 * arm.base_kg * np.eye(3))
    parts += [
        _link("base_link", base, origin_frame, np.eye(3)),
        Xml.Element("link", name="world"),
        _joint("world_joint", "fixed", "world", "base_link", world, origin_frame),
        Xml.Element("link", name="base"),
        _joint("base_link-base_fixed_joint", "fixed", "base_link", "base", origin_frame, origin_frame),
        Xml.Element("link", name="flange")
        if flange_body is None
        else _link("flange", flange_body, arm.flange, np.eye(3)),
        _joint("flange_joint", "fixed", "link_6", "flange", frames[-1], arm.flange),
        Xml.Element("link", name="tool0"),
    ]
    parts.append(_joint("tool0_joint", "fixed", "flange", "tool0", arm.flange, arm.flange))
    if written.shuffle is not None:
        order = np.random.default_rng(written.shuffle).permutation(len(parts))
        parts = [parts[k] for k in order]
    robot.extend(parts)
    Xml.indent(robot)
    return '<?xml version="1.0"?>\n' + Xml.tostring(robot, encoding="unicode") + "\n"


def _split(body: Body) -> tuple[Body, Body]:
    """Return a body as two with the same sum: a fifth of it, and the rest, both about the same centre."""
    return Body(0.2 * body.mass, body.center, 0.2 * body.inertia), Body(
        0.8 * body.mass, body.center, 0.8 * body.inertia
    )


def _link(name: str, body: Body, frame: tuple[Array, Array], turned: Array) -> Xml.Element:
    rotation, origin = frame
    link = Xml.Element("link", name=name)
    inertial = Xml.SubElement(link, "inertial")
    Xml.SubElement(inertial, "mass", value=f"{body.mass:.9g}")
    center = rotation.T @ (body.center - origin)
    Xml.SubElement(inertial, "origin", xyz=_numbers(center), rpy=_numbers(roll_pitch_yaw(turned)))
    axes = rotation @ turned
    i = axes.T @ body.inertia @ axes
    entries = {"ixx": i[0, 0], "ixy": i[0, 1], "ixz": i[0, 2], "iyy": i[1, 1], "iyz": i[1, 2], "izz": i[2, 2]}
    Xml.SubElement(inertial, "inertia", {key: f"{value:.9g}" for key, value in entries.items()})
    return link


def _joint(
    name: str, kind: str, parent: str, child: str, before: tuple[Array, Array], after: tuple[Array, Array]
) -> Xml.Element:
    """Return a joint; frames are given in the base frame at the pose of all zeros."""
    joint = Xml.Element("joint", name=name, type=kind)
    Xml.SubElement(joint, "parent", link=parent)
    Xml.SubElement(joint, "child", link=child)
    rotation = before[0].T @ after[0]
    shift = before[0].T @ (after[1] - before[1])
    Xml.SubElement(joint, "origin", xyz=_numbers(shift), rpy=_numbers(roll_pitch_yaw(rotation)))
    return joint


def _numbers(values: Array) -> str:
    return " ".join(f"{value + 0.0:.10g}" for value in np.where(np.abs(values) < 1e-12, 0.0, values))
