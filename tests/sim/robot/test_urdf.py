"""What of a URDF is read, and each refusal by its words."""

import re

import pytest

from benchmarks.robot_arms import Link, two_links, urdf
from sim.errors import AxisError
from sim.robot.urdf import MOST_ELEMENTS, read_urdf

ARM = urdf(two_links())
INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'


def joint(name: str, parent: str, child: str, kind: str = "revolute") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no XML"),
        ("<robot", "no XML"),
        ('<!DOCTYPE robot [<!ENTITY a "aaaa">]>' + ARM, "document type"),
        ('<xacro:macro xmlns:xacro="x"/>', "expand a xacro file first"),
        ("<mujoco/>", "a URDF is <robot>"),
        ("<robot>" + "<a/>" * MOST_ELEMENTS + "</robot>", f"more than {MOST_ELEMENTS} elements"),
        (ARM.replace("<inertial>", "<inertial>" + "<a>" * 5000 + "</a>" * 5000, 1), "nest more than"),
        (ARM.replace('name="link2"', 'name="link1"'), "'link1': a name that no other link has"),
        (ARM.replace('type="revolute"', 'type="ball"', 1), "type 'ball' is not known here; there are revolute"),
        (ARM.replace('parent link="link1"', 'parent link="arm"'), "joint 'joint2': its parent link 'arm' is not in"),
        (ARM.replace('child link="link2"', 'chill link="link2"'), "joint 'joint2': its child link"),
        (urdf(two_links(), extra='<link name="x"/>' + joint("j", "x", "link2")), "'link2' is the child of two joints"),
        (urdf(two_links(), extra='<link name="x"/>'), "2 links are no joint's child"),
        (
            urdf(two_links(), extra='<link name="x"/><link name="y"/>' + joint("a", "x", "y") + joint("b", "y", "x")),
            "'x' does not hang at the base 'link0': its joints make a ring",
        ),
        (ARM.replace("revolute", "fixed"), "no joint moves"),
        (ARM.replace('lower="-6.0"', 'lower="low"', 1), "'joint1': lower of its limit must be finite numbers"),
        (ARM.replace('xyz="0.0 0.0 0.5"', 'xyz="0 0 nan"'), "'joint1': xyz of its origin must be finite numbers"),
        (ARM.replace('mass value="', 'mass value="-', 1), "'link1': its mass of -3 kg is below 0"),
        (ARM.replace("inertial>", "visual>"), "no link has a mass"),
        (re.sub("<inertia [^>]*>", "", ARM), "link 'link1': its <inertial> has no <inertia>; write both"),
    ],
)
def test_a_refusal_says_what_is_wrong(text: str, said: str) -> None:
    with pytest.raises(AxisError) as refused:
        read_urdf(text.encode())
    assert said in str(refused.value)


def test_shapes_and_colours_are_left_out() -> None:
    shape = '<visual><geometry><mesh filename="package://nowhere/link.stl"/></geometry></visual>'
    dressed = ARM.replace("<inertial>", shape + "<inertial>").replace("</robot>", '<material name="m"/></robot>')
    assert read_urdf(dressed.encode()) == read_urdf(ARM.encode())
    assert "mesh" not in read_urdf(dressed.encode()).text


def test_joints_that_turn_slide_and_are_fixed() -> None:
    first, second = two_links()
    slide = Link(second.origin, second.axis, second.mass, second.center, second.inertia, slides=True)
    welded = urdf([first, slide], extra='<link name="flange"/>' + joint("weld", "link2", "flange", "fixed"))
    found = read_urdf(welded.encode())
    assert found.moving == ("joint1", "joint2")
    assert found.prismatic == {"joint2"}
    assert found.limits == {"joint1": (-6.0, 6.0, 3.0), "joint2": (-6.0, 6.0, 3.0)}


def test_a_joint_without_end_has_no_limits() -> None:
    """Makers write a range of one turn at joints that turn on and on; the URDF's rules say that it does not count."""
    assert "joint1" not in read_urdf(ARM.replace("revolute", "continuous", 1).encode()).limits
