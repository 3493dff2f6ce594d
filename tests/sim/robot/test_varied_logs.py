"""Logs and descriptions that differ in one thing each: friction of every joint is found, and nothing else is sure."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.robot_arms import GRAVITY, channel_map, names_of, random_arm, swings, torque, write_log, write_robot
from sim.robot.investigation import investigate_robot
from sim.robot.motion import read_log
from sim.robot.robot import read_robot

pytestmark = pytest.mark.slow
DRY, VISCOUS, ROTOR = 2.0, 1.5, 0.5
LEANING = Rotation.from_euler("xyz", [0.5, 0.3, 0.0]).inv().apply(GRAVITY)


@dataclass(frozen=True)
class Varied:
    """One log; `begins`: the row with which it does; `urdf`: how the text of the URDF differs."""

    joints: int = 3
    slides: tuple[int, ...] = ()
    rate_hz: float = 100.0
    units: tuple[str, str] = ("rad", "N.m")
    gravity: tuple[float, float, float] = GRAVITY
    begins: int = 0
    size: float = 0.5
    urdf: Callable[[str], str] = str


def without_a_mass(urdf: str) -> str:
    """The second link as its maker says nothing of it."""
    return re.sub(r'(<link name="link2">).*?(</link>)', r"\1\2", urdf)


def with_meshes_that_are_nowhere(urdf: str) -> str:
    shape = '<visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual>'
    return urdf.replace("</inertial>", f"</inertial>{shape}")


VARIED = {
    "50 Hz": Varied(rate_hz=50.0),
    "125 Hz": Varied(rate_hz=125.0),
    "500 Hz": Varied(rate_hz=500.0),
    "degrees and milliamperes": Varied(units=("deg", "A")),
    "a base that leans": Varied(gravity=(float(LEANING[0]), float(LEANING[1]), float(LEANING[2]))),
    "seven joints": Varied(joints=7),
    "a joint that slides": Varied(slides=(1,), size=0.3),
    "a link without a mass": Varied(joints=4, urdf=without_a_mass),
    "meshes that are nowhere": Varied(urdf=with_meshes_that_are_nowhere),
    "a log that begins in motion": Varied(begins=137),
}


@pytest.mark.parametrize("one", VARIED.values(), ids=VARIED.keys())
def test_friction_of_every_joint_is_found_and_nothing_else_is_sure(one: Varied, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    links = random_arm(np.random.default_rng(10 * one.joints + len(one.slides) + 1), one.joints, one.slides)
    time, q, qd, qdd = (each[one.begins :] for each in swings(rng, one.joints, 25.0, one.rate_hz, one.size))
    felt = torque(links, q, qd, qdd, one.gravity) + DRY * np.tanh(qd / 0.03) + VISCOUS * qd + ROTOR * qdd
    felt = felt + 0.05 * rng.normal(size=q.shape)
    path = write_robot(tmp_path, links, head=f"gravity_m_s2 = {list(one.gravity)}")
    (tmp_path / "arm.urdf").write_text(one.urdf((tmp_path / "arm.urdf").read_text()))
    angle, unit = one.units
    constants = np.linspace(0.008, 0.012, one.joints) if unit == "A" else np.ones(one.joints)
    logged = np.degrees(q) if angle == "deg" else q
    log = write_log(tmp_path / "log.csv", time, logged, felt / constants)
    text = channel_map(one.joints).replace("[motor_torque_nm]", f'unit = "{angle}"\n[motor_torque_nm]')
    text += f'unit = "{unit}"\n' + (f"factor = {constants.tolist()}\n" if unit == "A" else "")
    robot = read_robot(path)
    found = investigate_robot(robot, [read_log(robot, log, text)]).findings()
    sure = {
        (f.finding.mechanism, f.place): f.finding.parameters[0].value for f in found if f.finding.probability >= 0.9
    }
    joints = names_of(links)
    assert set(sure) == {(m, joint) for m in ("coulomb_friction", "viscous_friction") for joint in joints}
    for joint in joints:
        assert sure["coulomb_friction", joint] == pytest.approx(DRY, rel=0.1)
        assert sure["viscous_friction", joint] == pytest.approx(VISCOUS, rel=0.15)
