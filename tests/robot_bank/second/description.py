"""What an owner has of a robot: a URDF with frames of its maker's choice, robot.toml, and axis files of some."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as Xml

import numpy as np
from scipy.spatial.transform import Rotation

from tests.robot_bank.multibody import Array, Body
from tests.robot_bank.second.builds import Build


@dataclass(frozen=True)
class Sheet:
    """A drive as its sheet has it, at the joint: rotor [kg m2], dry [N m] and viscous friction [N m s/rad], its gear's
    ratio, stiffness [N m/rad] and damping [N m s/rad], 0 where it is rigid; about what its spring moves [kg m2]."""

    rotor: float
    dry: float
    viscous: float
    gear: float
    stiffness: float = 0.0
    damping: float = 0.0
    moved: float = 0.0


@dataclass(frozen=True, eq=False)
class Written:
    """How a robot is written: joint names; of each link frame (3, 3) and origin (3,) [m] in the pose of zeros."""

    names: tuple[str, ...]
    frames: tuple[tuple[Array, Array], ...]


def draw_written(rng: np.random.Generator, build: Build) -> Written:
    """Draw names, and frames that have z along the joint or x along it, or stand as the base does."""
    word = str(rng.choice(["axis_{}", "joint{}", "A{}", "lbr_joint_{}", "q{}"]))
    habit = str(rng.choice(["z", "x", "base"]))
    frames = []
    for direction, point in zip(build.directions, build.points, strict=True):
        frame = np.eye(3)
        if habit != "base":
            across = np.roll(direction, 1)
            third = np.cross(direction, across)
            frame = np.column_stack([across, third, direction] if habit == "z" else [direction, across, third])
        frames.append((frame, point))
    return Written(tuple(word.format(j + 1) for j in range(build.joints)), tuple(frames))


def write_urdf(build: Build, bodies: Sequence[Body], written: Written, effort: Array) -> str:
    """Return the URDF of believed links; effort: (n,) largest torques [N m]."""
    robot = Xml.Element("robot", name=build.name)
    base = Body(build.base_kg, np.array([0.0, 0, -0.05]), 0.02 * build.base_kg * np.eye(3))
    before = (np.eye(3), np.zeros(3))
    _link(robot, "base", base, before)
    parent = "base"
    for j, (name, frame, body) in enumerate(zip(written.names, written.frames, bodies, strict=True)):
        joint = _joint(
            robot, name, "prismatic" if build.sliding[j] else "revolute", (parent, f"link{j + 1}"), before, frame
        )
        Xml.SubElement(joint, "axis", xyz=_numbers(frame[0].T @ build.directions[j]))
        most = {"lower": -build.limit[j], "upper": build.limit[j], "effort": effort[j], "velocity": build.speed[j]}
        Xml.SubElement(joint, "limit", {key: f"{value:.6g}" for key, value in most.items()})
        parent, before = f"link{j + 1}", frame
        _link(robot, parent, body, frame)
    Xml.SubElement(robot, "link", name="tool_flange")
    _joint(robot, "flange_fixed", "fixed", (parent, "tool_flange"), before, build.flange)
    Xml.indent(robot)
    return '<?xml version="1.0"?>\n' + Xml.tostring(robot, encoding="unicode") + "\n"


def _link(robot: Xml.Element, name: str, body: Body, frame: tuple[Array, Array]) -> None:
    """Add a link, its inertia along its main axes, as programs for drawing give it."""
    inertial = Xml.SubElement(Xml.SubElement(robot, "link", name=name), "inertial")
    rotation, origin = frame
    moments, axes = np.linalg.eigh(body.inertia)
    axes = axes * np.linalg.det(axes)
    place = rotation.T @ (body.center - origin)
    Xml.SubElement(inertial, "origin", xyz=_numbers(place), rpy=_numbers(_angles(rotation.T @ axes)))
    Xml.SubElement(inertial, "mass", value=f"{body.mass:.9g}")
    entries = {"ixx": moments[0], "ixy": 0.0, "ixz": 0.0, "iyy": moments[1], "iyz": 0.0, "izz": moments[2]}
    Xml.SubElement(inertial, "inertia", {key: f"{value:.9g}" for key, value in entries.items()})


def _joint(
    robot: Xml.Element,
    name: str,
    kind: str,
    links: tuple[str, str],
    before: tuple[Array, Array],
    after: tuple[Array, Array],
) -> Xml.Element:
    joint = Xml.SubElement(robot, "joint", name=name, type=kind)
    shift = before[0].T @ (after[1] - before[1])
    Xml.SubElement(joint, "origin", xyz=_numbers(shift), rpy=_numbers(_angles(before[0].T @ after[0])))
    Xml.SubElement(joint, "parent", link=links[0])
    Xml.SubElement(joint, "child", link=links[1])
    return joint


def _angles(rotation: Array) -> Array:
    """Return roll, pitch and yaw (3,) [rad]: about x, then y, then z, all fixed."""
    found = Rotation.from_matrix(rotation)
    # a pitch of a quarter turn leaves one angle free; scipy says so and takes 0
    pitch = float(np.arcsin(np.clip(-rotation[2, 0], -1, 1)))
    if abs(abs(pitch) - np.pi / 2) < 1e-7:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.asarray(found.as_euler("xyz"))


def _numbers(values: Array) -> str:
    return " ".join(f"{value + 0.0:.12g}" for value in np.where(np.abs(values) < 1e-13, 0.0, values))


def in_last_frame(written: Written, body: Body) -> Array:
    """Return where a body's centre is in the last link's frame (3,) [m]."""
    rotation, origin = written.frames[-1]
    return np.asarray(rotation.T @ (body.center - origin))


def write_robot(
    gravity: Array, names: Sequence[str], axes: Mapping[str, str], payload: tuple[float, Array] | None
) -> str:
    """Return robot.toml; gravity (3,) [m/s2] in the base frame, payload its mass [kg] and centre (3,) [m]."""
    vector = ", ".join(f"{value:.6g}" for value in gravity)
    lines = ['schema = "gearcase-robot/1"', 'name = "robot"', 'urdf = "robot.urdf"', f"gravity_m_s2 = [{vector}]"]
    if payload is not None:
        center = ", ".join(f"{value:.5f}" for value in payload[1])
        lines += ["", "[payload]", f"mass_kg = {payload[0]:.4f}", f"center_m = [{center}]"]
    for name in names:
        lines += ["", "[[joints]]", f'name = "{name}"', *([f'axis = "{axes[name]}"'] if name in axes else [])]
    return "\n".join(lines) + "\n"


def write_axis(name: str, sheet: Sheet, geared: bool) -> str:
    """Return an axis file: the drive as one without a gear, or with its numbers at the motor and its gear after it."""
    ratio = sheet.gear if geared else 1.0
    lines = [
        'schema = "gearcase-axis/1"',
        f'name = "{name}"',
        "",
        "[motor]",
        f"inertia_kg_m2 = {sheet.rotor / ratio**2:.8g}",
        f"coulomb_friction_n_m = {sheet.dry / ratio:.8g}",
        f"viscous_friction_n_m_s_per_rad = {sheet.viscous / ratio**2:.8g}",
    ]
    if geared:
        # the gear's own inertia is counted with the rotor
        lines += [
            "",
            "[[stages]]",
            'name = "output"',
            f"ratio = {ratio:.8g}",
            f"inertia_kg_m2 = {1e-4 * sheet.rotor:.6g}",
        ]
        if sheet.stiffness > 0:
            lines += [f"stiffness_n_m_per_rad = {sheet.stiffness:.6g}", f"damping_n_m_s_per_rad = {sheet.damping:.6g}"]
    return "\n".join([*lines, "", "[load]", f"inertia_kg_m2 = {sheet.moved:.6g}"]) + "\n"
