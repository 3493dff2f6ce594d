"""A joint that is simulated in a moving robot asks for the torques of the equations of motion, and is heard."""

from pathlib import Path

import numpy as np
import pytest

from casebase.signals.telemetry import read_telemetry
from sim.robot.joint_simulation import measure_joint, own_motion, place_of
from sim.robot.robot import Robot, RobotError, read_robot
from sim.robot.trajectory import Limits, Trajectory, read_trajectory
from tests.live import gearcase
from tests.sim.robot.arms import torque, two_links, write_robot

ARM, RATIO, ROTOR, VISCOUS = two_links(), 50.0, 2e-4, 1e-3
NAMING = 'axis = "shoulder.toml"\n'
SHOULDER = f"""name = "shoulder"
motor = {{inertia_kg_m2 = {ROTOR}, viscous_friction_n_m_s_per_rad = {VISCOUS}}}
load = {{inertia_kg_m2 = 1.0}}
motion = {{period_s = 4.0, load_speed_rad_s = 1.0, acceleration_time_s = 0.4}}
[[stages]]
name = "gear"
driver_teeth = 20
driven_teeth = 1000
stiffness_n_m_per_rad = 5e4
damping_n_m_s_per_rad = 50.0
"""


def robot_in(folder: Path) -> Path:
    """The first joint has gears, the second is not described."""
    path = write_robot(folder, ARM)
    head, tail = path.read_text().split("[[joints]]\n", 1)
    first, second = tail.split("[[joints]]\n")
    path.write_text(f"{head}[[joints]]\n{first}{NAMING}[[joints]]\n{second}")
    (folder / "shoulder.toml").write_text(SHOULDER)
    return path


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return read_robot(robot_in(tmp_path))


def both_moving(robot: Robot) -> Trajectory:
    joints = tuple(joint.name for joint in robot.joints)
    limits = Limits(joints, np.full(2, -1.5), np.full(2, 1.5), np.full(2, 2.0), np.full(2, 4.0))
    return limits.drawn(np.random.default_rng(2), 6.0).trajectory()


@pytest.mark.parametrize("alone", [True, False])
def test_motor_torques_are_those_of_the_equations_of_motion(robot: Robot, alone: bool) -> None:
    """Weight and inertia change with the pose; beside them the motor moves its rotor against its friction."""
    motion = own_motion(robot, 0, 6.0) if alone else both_moving(robot)
    axis, found = measure_joint(robot, 0, motion)
    telemetry = found.telemetry
    time = telemetry.time_s
    ways = [
        np.stack([np.interp(time, motion.time_s, each[:, k]) for k in range(2)], axis=1)
        for each in (motion.position, motion.speed, motion.acceleration)
    ]
    links = torque(ARM, *ways)[:, 0]
    expected = links / RATIO + ROTOR * RATIO * ways[2][:, 0] + VISCOUS * RATIO * ways[1][:, 0]
    assert telemetry["motor_position_rad"] / RATIO == pytest.approx(ways[0][:, 0], abs=5e-3)
    left = telemetry["motor_torque_nm"] - expected
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean(expected**2))
    known = links - axis.load.inertia_kg_m2 * ways[2][:, 0]
    assert telemetry["known_torque_nm"] == pytest.approx(known, abs=0.01 * np.abs(links).max())
    assert np.std(found.sound) > 0.0


def test_the_command_writes_what_an_investigation_reads(tmp_path: Path) -> None:
    path = robot_in(tmp_path)
    motion = both_moving(read_robot(path))
    (tmp_path / "next.csv").write_text(motion.csv())
    words = ["--robot", str(path), "--joint", "joint1", "--trajectory", str(tmp_path / "next.csv")]
    damage = ["--mechanism", "backlash@gear", "--set", "gap_rad=0.001"]
    done = gearcase("simulate", *words, *damage, "--out", str(tmp_path / "out"), data_dir=tmp_path / "data")
    assert done.code == 0, done.stderr
    telemetry = read_telemetry(tmp_path / "out" / "telemetry.csv")
    assert telemetry.duration_s == pytest.approx(6.0)
    assert {"known_torque_nm", "motor_torque_nm", "load_position_rad"} <= set(telemetry.channels)
    assert 'name = "backlash"' in (tmp_path / "out" / "axis.toml").read_text()


def test_what_cannot_be_simulated_is_said(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"joints\[1\].axis: missing"):
        place_of(robot, "joint2")
    with pytest.raises(RobotError, match="none is called 'wrist'; there are joint1, joint2"):
        place_of(robot, "wrist")
    (tmp_path / "short.csv").write_text("time_s,joint1/position\n0,0\n0.01,0\n")
    with pytest.raises(RobotError, match="its first line names joint2/position"):
        read_trajectory(tmp_path / "short.csv", ("joint1", "joint2"))


def test_a_trajectory_is_read_as_it_was_written(robot: Robot, tmp_path: Path) -> None:
    motion = both_moving(robot)
    (tmp_path / "next.csv").write_text(motion.csv())
    again = read_trajectory(tmp_path / "next.csv", motion.joints)
    for name, near in (
        ("position", 2e-6),
        ("speed", 2e-6),
        ("acceleration", 0.05),
    ):  # where the swell ends the jerk jumps
        assert getattr(again, name) == pytest.approx(getattr(motion, name), abs=near)
