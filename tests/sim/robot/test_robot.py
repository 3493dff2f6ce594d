"""Robot descriptions: read from their files, each refusal by its key."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.robot_arms import two_links, write_robot
from sim.errors import SimulationError
from sim.robot.robot import read_robot


def test_a_robot_is_read_with_what_stands_beside_it(tmp_path: Path) -> None:
    (tmp_path / "axis2.toml").write_text(
        'name = "second"\n'
        '[motor]\ninertia_kg_m2 = 1e-4\n[[stages]]\nname = "output"\nratio = 100.0\n[load]\ninertia_kg_m2 = 0.1'
    )
    head = "gravity_m_s2 = [0.0, 0.0, 9.81]\n[payload]\nmass_kg = 1.5\ncenter_m = [0.0, 0.0, 0.1]"
    found = read_robot(write_robot(tmp_path, two_links(), ("a/b", "c d"), head, 'axis = "axis2.toml"'))
    assert [joint.name for joint in found.joints] == ["a/b", "c d"]
    assert [joint.described for joint in found.joints] == [False, True]
    assert found.joints[1].axis.ratio == 100.0
    assert found.gravity_m_s2 == (0.0, 0.0, 9.81)
    assert (found.payload.mass_kg, found.payload.center_m) == (1.5, (0.0, 0.0, 0.1))
    assert found.name == "arm"


def test_what_is_not_said_is_a_robot_on_the_floor_with_nothing_at_its_flange(tmp_path: Path) -> None:
    found = read_robot(write_robot(tmp_path, two_links()))
    assert found.gravity_m_s2 == (0.0, 0.0, -9.81)
    assert found.payload.mass_kg == 0.0


@pytest.mark.parametrize(
    ("head", "tail", "key"),
    [
        ("gravity = 9.81", "", "gravity: unknown key; known: schema, name, urdf, gravity_m_s2"),
        ("gravity_m_s2 = 9.81", "", "gravity_m_s2: must be three numbers in m/s2"),
        ("gravity_m_s2 = [0.0, 0.0, nan]", "", "gravity_m_s2[2]"),
        ("gravity_m_s2 = [0.0, 0.0, -9810.0]", "", "gravity_m_s2[2]"),
        ("name = 3", "", "name: must be a text"),
        ("payload = 3", "", "payload: must be a table"),
        ("[payload]\nmass_kg = -1.0", "", "payload.mass_kg"),
        ("[payload]\nmass = 1.0", "", "payload.mass: unknown key; known: mass_kg, center_m"),
        ("[payload]\ncenter_m = [0.0]", "", "payload.center_m: must be three numbers in m"),
        ("", "gain = 3", "joints[1].gain: unknown key; known: name, axis"),
        ("", "axis = 3", "joints[1].axis: must be the name of a file"),
        ("", 'axis = "absent.toml"', "joints[1].axis: absent.toml: no such file"),
        (
            "",
            '[[joints]]\nname = "elbow"',
            "joints[2].name: 'elbow' is no joint that moves in the URDF; there are joint1",
        ),
        ("", '[[joints]]\nname = "joint1"', "joints[2].name: 'joint1' stands twice"),
        ("[", "", "robot.toml: "),
        ("held = 3", "", "held: must be tables; write [[held]]"),
        ("", '[[held]]\nname = "elbow"', "held[0].name: 'elbow' is no joint that moves in the URDF"),
        ("", '[[held]]\nname = "joint1"', "held[0].name: 'joint1' stands under [[joints]]"),
    ],
)
def test_a_refusal_names_its_key(tmp_path: Path, head: str, tail: str, key: str) -> None:
    with pytest.raises(SimulationError) as refused:
        read_robot(write_robot(tmp_path, two_links(), head=head, tail=tail))
    assert str(refused.value).startswith(key)


def test_a_joint_that_is_held_has_its_place_in_the_unit_of_its_kind(tmp_path: Path) -> None:
    links = [*two_links(), replace(two_links()[1], slides=True)]
    path = write_robot(tmp_path, links)
    text = path.read_text().split('[[joints]]\nname = "joint2"')[0]
    path.write_text(
        f'{text}[[held]]\nname = "joint2"\nposition_rad = 0.5\n[[held]]\nname = "joint3"\nposition_m = -0.02'
    )
    assert read_robot(path).held == {"joint2": 0.5, "joint3": -0.02}
    for tail, said in (
        ('name = "joint3"\nposition_rad = 0.1', "held[0].position_rad: unknown key; known: name, position_m"),
        ('name = "joint2"', "held[0].position_rad: missing; where joint2 was held"),
        ('name = "joint2"\nposition_rad = "up"', "held[0].position_rad"),
        ('name = "joint2"\nposition_rad = 0.1\n[[held]]\nname = "joint2"\nposition_rad = 0.1', "held[1].name"),
    ):
        path.write_text(f"{text}[[held]]\n{tail}")
        with pytest.raises(SimulationError) as refused:
            read_robot(path)
        assert str(refused.value).startswith(said)


def test_files_that_are_not_there_or_no_robots_are_said(tmp_path: Path) -> None:
    path = write_robot(tmp_path, two_links())
    text = path.read_text()
    for wrong, said in (
        (text.replace("gearcase-robot/1", "gearcase-robot/9"), "schema: must be 'gearcase-robot/1'"),
        (text.replace('urdf = "arm.urdf"', ""), "urdf: must be the name of a file beside this one"),
        (text.replace("arm.urdf", "leg.urdf"), "urdf: leg.urdf: no such file"),
        (text.split("[[joints]]")[0], "joints: missing"),
    ):
        path.write_text(wrong)
        with pytest.raises(SimulationError) as refused:
            read_robot(path)
        assert str(refused.value).startswith(said)
    path.write_text(text)
    (tmp_path / "arm.urdf").write_text("<html/>")
    with pytest.raises(SimulationError, match=r"^urdf: the document is <html>"):
        read_robot(path)
