"""What the URDF says, read back by its own rules, is the arm that it was written from."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from benchmarks.robot_bank.arm import draw_arm
from benchmarks.robot_bank.multibody import Array, rotation_about
from benchmarks.robot_bank.urdf import draw_written, write_urdf


def _rotation(rpy: Array) -> Array:
    x, y, z = np.eye(3)
    turns = [rotation_about(axis, np.array([angle]))[0] for axis, angle in zip((x, y, z), rpy, strict=True)]
    return turns[2] @ turns[1] @ turns[0]


def _vector(text: str) -> Array:
    return np.array([float(part) for part in text.split()])


def _bodies_in_world(urdf: str, angles: dict[str, float]) -> list[tuple[float, Array, Array]]:
    """Return mass, centre and inertia in the world's axes of every link that has some, for a pose."""
    robot = Xml.fromstring(urdf)
    joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}  # type: ignore[union-attr]

    def placed(link: str) -> tuple[Array, Array]:
        if link not in joints:
            return np.eye(3), np.zeros(3)
        joint = joints[link]
        origin = joint.find("origin").attrib  # type: ignore[union-attr]
        rotation, place = placed(joint.find("parent").get("link"))  # type: ignore[union-attr,arg-type]
        place = place + rotation @ _vector(origin["xyz"])
        rotation = rotation @ _rotation(_vector(origin["rpy"]))
        if joint.get("type") == "revolute":
            axis = _vector(joint.find("axis").get("xyz"))  # type: ignore[union-attr,arg-type]
            rotation = rotation @ rotation_about(axis, np.array([angles[joint.get("name")]]))[0]  # type: ignore[index]
        return rotation, place

    found = []
    for link in robot.findall("link"):
        inertial = link.find("inertial")
        if inertial is None or link.get("name") == "base_link":
            continue
        rotation, place = placed(link.get("name"))  # type: ignore[arg-type]
        origin = inertial.find("origin").attrib  # type: ignore[union-attr]
        axes = rotation @ _rotation(_vector(origin["rpy"]))
        i = {key: float(value) for key, value in inertial.find("inertia").attrib.items()}  # type: ignore[union-attr]
        matrix = np.array(
            [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]]
        )
        mass = float(inertial.find("mass").get("value"))  # type: ignore[union-attr,arg-type]
        found.append((mass, place + rotation @ _vector(origin["xyz"]), axes @ matrix @ axes.T))
    return found


def _moments(bodies: list[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Return mass, first moment and inertia about the origin of all bodies together."""
    first = sum((m * c for m, c, _ in bodies), np.zeros(3))
    second = sum((i + m * (c @ c * np.eye(3) - np.outer(c, c)) for m, c, i in bodies), np.zeros((3, 3)))
    return sum(m for m, _, _ in bodies), first, second


@pytest.mark.parametrize("seed", range(3))
def test_read_back_it_has_its_masses_where_the_arm_has_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = draw_arm(rng)
    mount = _rotation(rng.uniform(-3, 3, 3))
    written = draw_written(rng, arm, mount)
    urdf = write_urdf("arm", arm, arm.bodies, written)
    for angles in rng.uniform(-3, 3, (3, 6)):
        placed = arm.chain.placements(angles[None])
        expected = [
            (b.mass, mount @ (r[0] @ b.center + s[0]), mount @ r[0] @ b.inertia @ r[0].T @ mount.T)
            for b, (r, s) in zip(arm.bodies, placed, strict=True)
        ]
        found = _bodies_in_world(urdf, dict(zip(written.names, angles, strict=True)))
        for one, other in zip(_moments(found), _moments(expected), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-6 * float(np.max(np.abs(other))))
