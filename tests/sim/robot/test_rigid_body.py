"""Torques of the rigid body against closed forms, MuJoCo in one piece, and Newton and Euler written apart."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robot_arms import (
    Array,
    Link,
    names_of,
    random_arm,
    robot,
    swings,
    torque,
    two_links,
    urdf,
    with_mass,
)
from sim.errors import AxisError
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Payload, Robot, rigid_joint
from sim.robot.urdf import read_urdf

G = 9.81


def motion(joints: int, seed: int = 1) -> tuple[Array, Array, Array]:
    _, *ways = swings(np.random.default_rng(seed), joints, 5.0, 10.0)
    return ways[0], ways[1], ways[2]


@pytest.mark.parametrize("slides", [(), (1,), (0, 2)])
def test_regressor_in_one_piece_and_newton_euler_agree(slides: tuple[int, ...]) -> None:
    links = random_arm(np.random.default_rng(0), 4, slides)
    body = RigidBody.of(robot(links))
    expected = torque(links, *motion(4))
    np.testing.assert_allclose(body.torque(*motion(4)), expected, atol=1e-9)


def test_two_links_are_the_textbook_s() -> None:
    """Spong, Hutchinson, Vidyasagar, Robot Modeling and Control, example 7.2; here about y, downwards."""
    first, second = two_links()
    q, qd, qdd = motion(2)
    length, c1, c2 = second.origin[0], first.center[0], second.center[0]
    m1, m2, i1, i2 = first.mass, second.mass, first.inertia[1, 1], second.inertia[1, 1]
    cos2, h = np.cos(q[:, 1]), m2 * length * c2 * np.sin(q[:, 1])
    m11 = m1 * c1**2 + m2 * (length**2 + c2**2 + 2.0 * length * c2 * cos2) + i1 + i2
    m12 = m2 * (c2**2 + length * c2 * cos2) + i2
    m22 = m2 * c2**2 + i2
    g1 = -G * ((m1 * c1 + m2 * length) * np.cos(q[:, 0]) + m2 * c2 * np.cos(q.sum(axis=1)))
    g2 = -G * m2 * c2 * np.cos(q.sum(axis=1))
    one = m11 * qdd[:, 0] + m12 * qdd[:, 1] - h * (2.0 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2) + g1
    two = m12 * qdd[:, 0] + m22 * qdd[:, 1] + h * qd[:, 0] ** 2 + g2
    found = RigidBody.of(robot([first, second])).torque(q, qd, qdd)
    np.testing.assert_allclose(found, np.stack([one, two], axis=1), atol=1e-10)


def test_power_of_the_joints_is_the_rate_of_energy() -> None:
    """Kinetic energy is half the sum of inertial torque times speed; weight is what is asked for at rest."""
    body = RigidBody.of(robot(random_arm(np.random.default_rng(2), 3, (2,))))
    time, q, qd, qdd = swings(np.random.default_rng(3), 3, 2.0, 500.0)
    at_rest = body.torque(q, 0.0 * q, 0.0 * q)
    kinetic = 0.5 * np.sum(qd * (body.torque(q, 0.0 * q, qd) - at_rest), axis=1)
    power = np.sum(qd * (body.torque(q, qd, qdd) - at_rest), axis=1)
    np.testing.assert_allclose(np.gradient(kinetic, time)[1:-1], power[1:-1], atol=1e-3 * np.abs(power).max())


def test_a_described_payload_is_a_point_at_the_last_link() -> None:
    links, center = random_arm(np.random.default_rng(5), 3), (0.1, -0.05, 0.2)
    body = RigidBody.of(robot(links, payload=Payload(1.5, center)))
    expected = torque(with_mass(links, 1.5, np.array(center)), *motion(3))
    np.testing.assert_allclose(body.torque(*motion(3)), expected, atol=1e-6)


def test_what_is_fixed_to_a_link_counts_into_it() -> None:
    links = random_arm(np.random.default_rng(6), 3)
    tool = (
        '<link name="tool"><inertial><origin xyz="0.1 0 0"/><mass value="1.5"/>'
        '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="weld" type="fixed">'
        '<parent link="link3"/><child link="tool"/><origin xyz="0 0 0.2"/></joint>'
    )
    joints = tuple(rigid_joint(name) for name in names_of(links))
    body = RigidBody.of(Robot("arm", read_urdf(urdf(links, extra=tool).encode()), joints))
    expected = torque(with_mass(links, 1.5, np.array([0.1, 0.0, 0.2])), *motion(3))
    np.testing.assert_allclose(body.torque(*motion(3)), expected, atol=1e-6)
    assert body.links == ("link1", "link2", "link3")


def test_a_link_without_mass_between_two_joints_is_a_frame() -> None:
    base, last = two_links()
    links = [base, Link((0.4, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0, (0.0, 0.0, 0.0)), replace(last, origin=(0.0, 0.0, 0.0))]
    body = RigidBody.of(robot(links))
    np.testing.assert_allclose(body.torque(*motion(3)), torque(links, *motion(3)), atol=1e-6)
    assert not body.parameters[1].any()


def test_the_payload_hangs_at_the_joint_farthest_from_the_base_in_any_order_of_the_log() -> None:
    links = random_arm(np.random.default_rng(7), 3)
    whole = robot(links)
    turned = replace(whole, joints=whole.joints[::-1])
    assert RigidBody.of(whole).tool == RigidBody.of(turned).tool == 2


def test_an_unlogged_joint_stands_where_it_is_held() -> None:
    links = random_arm(np.random.default_rng(8), 3)
    whole = robot(links)
    q, qd, qdd = (way * np.array([1.0, 0.0, 1.0]) for way in motion(3))
    some = replace(whole, joints=(whole.joints[0], whole.joints[2]), held={"joint2": 0.7})
    body, logged = RigidBody.of(some), (q[:, [0, 2]], qd[:, [0, 2]], qdd[:, [0, 2]])
    expected = torque(links, q + np.array([0.0, 0.7, 0.0]), qd, qdd)[:, [0, 2]]
    np.testing.assert_allclose(body.torque(*logged), expected, atol=1e-9)


TREE = (
    ("torso", "base", "trunk", 9.0), ("left1", "trunk", "upper_left", 3.0), ("left2", "upper_left", "hand_left", 2.0),
    ("camera", "hand_left", "lens", 0.0), ("right1", "trunk", "upper_right", 3.0),
)  # fmt: skip


@pytest.mark.parametrize(
    "logged", [("left1",), ("left1", "left2"), ("torso",), ("right1", "camera"), ("torso", "left2")]
)
def test_unknown_are_the_joints_whose_motion_changes_a_logged_torque(logged: tuple[str, ...]) -> None:
    """Two arms on a turning trunk, and a camera without a mass: what moves a torque is tried joint by joint."""
    links = "".join(
        f'<link name="{child}"><inertial><origin xyz="0.1 0.05 0.02"/><mass value="{mass}"/>'
        f'<inertia ixx="{mass}" iyy="{mass}" izz="{mass}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.2 0 0.1"/><axis xyz="0.3 0.8 0.5"/></joint>'
        for name, parent, child, mass in TREE
    )
    urdf_ = read_urdf(f'<robot name="two arms"><link name="base"/>{links}</robot>'.encode())
    arms = Robot("two arms", urdf_, tuple(rigid_joint(name) for name in logged))
    unknown = RigidBody.of(arms).unknown(())
    turning = np.full((1, len(logged)), 0.4)
    for name, *_ in TREE:
        if name in logged:
            continue
        there, elsewhere = (
            RigidBody.of(replace(arms, held={name: at})).torque(turning, turning, turning)[0] for at in (0.0, 0.7)
        )
        depend = tuple(j for j, one, other in zip(logged, there, elsewhere, strict=True) if abs(one - other) > 1e-6)
        assert unknown.get(name, ()) == depend
        assert name not in RigidBody.of(arms).unknown((name,))


def test_what_mujoco_refuses_is_an_error_of_the_urdf() -> None:
    links = two_links()
    flat = replace(links[0], axis=(0.0, 0.0, 0.0))
    with pytest.raises(AxisError, match=r"^urdf: .*axis"):
        RigidBody.of(robot([flat, links[1]]))
