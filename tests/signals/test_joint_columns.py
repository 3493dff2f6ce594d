"""Logs of robots are read by their columns' names, as controllers write them."""

from pathlib import Path

import numpy as np
import pytest

from signals.columns.channel_map import channel_map_of
from signals.columns.joint_columns import recognise_joints
from signals.columns.joint_maps import LoggedJoint, joint_maps, read_joint_maps
from signals.errors import TelemetryError
from signals.telemetry import read_telemetry

UR = [LoggedJoint(f"{n}_joint") for n in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
NAMES = [joint.name for joint in UR]
CONSTANTS = {"motor_torque_nm": {"factor": [10.0, 10.7, 8.5, 9.0, 9.5, 10.1]}}


def six(text: str, first: int = 0) -> list[str]:
    return [text.format(first + k) for k in range(6)]


def of_joints(text: str, joints: list[str] = NAMES) -> list[str]:
    return [text.format(name) for name in joints]


RTDE = [
    "timestamp", *six("target_q_{}"), *six("target_qd_{}"), *six("target_moment_{}"), *six("actual_q_{}"),
    *six("actual_qd_{}"), *six("actual_current_{}"), *six("joint_control_output_{}"), *six("actual_TCP_pose_{}"),
    *six("joint_temperatures_{}"), *six("joint_mode_{}"), "robot_mode", "speed_scaling",
]  # fmt: skip
ALPHABETIC = sorted(NAMES)
PLOTJUGGLER = [
    "__time", *(f"/joint_states/{joint}/{what}" for joint in ALPHABETIC for what in ("effort", "position", "velocity")),
    "/joint_states/header/stamp",
]  # fmt: skip
MCAP = [
    "time",
    *(f"{what}[{joint}]" for joint in [*ALPHABETIC, "finger"] for what in ("position", "velocity", "effort")),
]
ROSTOPIC = ["%time", "field.header.seq", "field.header.stamp", *six("field.position{}"), *six("field.velocity{}"),
            *six("field.effort{}")]  # fmt: skip
LIBFRANKA = [
    "time",
    *six("q[{}]"),
    *six("q_d[{}]"),
    *six("dq[{}]"),
    *six("tau_J[{}]"),
    *six("tau_ext_hat_filtered[{}]"),
]
PLAIN = ["t [s]", *six("joint_{}_position [deg]", 1), *six("joint_{}_torque [Nm]", 1)]


@pytest.mark.parametrize(
    ("names", "given", "position", "torque", "third", "unit"),
    [
        (RTDE, CONSTANTS, "actual_q_2", "actual_current_2", 8.5, "rad"),
        (PLOTJUGGLER, {}, "/joint_states/elbow_joint/position", "/joint_states/elbow_joint/effort", 1.0, "rad"),
        (MCAP, {}, "position[elbow_joint]", "effort[elbow_joint]", 1.0, "rad"),
        (ROSTOPIC, {}, "field.position2", "field.effort2", 1.0, "rad"),
        (["stamp [s]", *six("position[{}]"), *six("effort[{}]")], {}, "position[2]", "effort[2]", 1.0, "rad"),
        (LIBFRANKA, {"time_s": {"unit": "s"}}, "q[2]", "tau_J[2]", 1.0, "rad"),
        (PLAIN, {}, "joint_3_position [deg]", "joint_3_torque [Nm]", 1.0, "deg"),
        (["timestamp", *six("actual_q_{}"), *six("actual_current_as_torque_{}")], {}, "actual_q_2",
         "actual_current_as_torque_2", 1.0, "rad"),
    ],
)  # fmt: skip
def test_headers_of_controllers_amount_to_a_map_of_all_joints(
    names: list[str], given: dict[str, object], position: str, torque: str, third: float, unit: str
) -> None:
    units = ["s", *["rad", "rad/s", "N.m"] * 7] if names is MCAP else ()
    found = recognise_joints(names, units, (), UR, given)
    assert found.open == ""
    elbow = channel_map_of(joint_maps(found.map, NAMES)[2]).sources
    assert (elbow["motor_position_rad"].column, elbow["motor_position_rad"].unit) == (position, unit)
    assert (elbow["motor_torque_nm"].column, elbow["motor_torque_nm"].scale) == (torque, third)
    assert elbow["time_s"].column == names[0]


@pytest.mark.parametrize(
    ("names", "open_", "lines"),
    [
        (RTDE, "motor_torque_nm is a current", ("factor = [..., ..., ..., ..., ..., ...]}  #", "times the gear ratio")),
        (["t [s]", *six("position_{}"), *six("torque_{}")], "motor_position_rad has no unit", ('unit = "..."',)),
        (["t [s]", *six("motor_pos_{} [rad]"), *six("torque_{} [Nm]")],
         "is of the motors, and the gears of shoulder_pan_joint",
         ("factor = [..., ..., ..., ..., ..., ...]}  # 1 / gear ratio", 'stages = [{name = "gear", ratio = ...}]')),
        (["t [s]", *six("q_{}"), "q_6", *six("tau_{}")], "q_0 to q_6 are 7 columns, and robot.toml has 6", ()),
        (["t [s]", *six("left_q_{}"), *six("right_q_{}"), *six("tau_{}")], "could be each of", ()),
        ([*six("q_{}"), *six("tau_{}")], "no column says the time", ('unit = "sample", rate_hz = ...',)),
        (["t [s]", *six("q_{}")], "no columns say the torque or current of each joint", ("# one a joint: ",)),
        (["t [s]", *of_joints("q_{}"), *of_joints("tau_{}", NAMES[:5])], "there is none of wrist_3_joint", ()),
        ([str(k + 1) for k in range(13)], "its 13 columns have no names", ("motor_position_rad = {column = [..., ",)),
    ],
)  # fmt: skip
def test_what_is_missing_is_asked_for_by_the_line_that_would_let_it_in(
    names: list[str], open_: str, lines: tuple[str, ...]
) -> None:
    found = recognise_joints(names, (), (), UR)
    assert open_ in found.open
    assert all(line in found.map for line in lines)


def test_gears_that_are_described_take_the_joint_to_its_motor() -> None:
    """Positions of a joint are those of its motor over the ratio, torques the other way; a current needs no ratio."""
    joints = [LoggedJoint("a", 100.0), LoggedJoint("b", 50.0)]
    names = ["t [s]", "q_0", "q_1", "tau_0", "tau_1"]
    first, second = map(channel_map_of, joint_maps(recognise_joints(names, (), (), joints).map, ["a", "b"]))
    assert [one.sources["motor_position_rad"].scale for one in (first, second)] == [100.0, 50.0]
    assert [one.sources["motor_torque_nm"].scale for one in (first, second)] == [0.01, 0.02]
    current = recognise_joints(["t [s]", "q_0", "q_1", "i_0 [A]", "i_1 [A]"], (), (), joints)
    assert "torque constant" in current.map
    assert "times the gear ratio" not in current.map
    of_motors = recognise_joints(["t [s]", "motor q_0", "motor q_1", "motor tau_0", "motor tau_1"], (), (), joints)
    assert of_motors.open == ""
    assert "factor" not in of_motors.map


def test_joints_that_are_named_are_taken_by_name_whatever_their_numbers_and_order_say() -> None:
    joints = [LoggedJoint("joint_2"), LoggedJoint("joint_1")]
    names = ["t [s]", "joint_1_pos_rad", "joint_2_pos_rad", "joint_1_trq_nm", "joint_2_trq_nm"]
    found = recognise_joints(names, (), (), joints)
    assert 'motor_position_rad = {column = ["joint_2_pos_rad", "joint_1_pos_rad"], unit = "rad"}' in found.map


def written(folder: Path, names: list[str], delimiter: str) -> tuple[Path, np.ndarray]:
    """A file with those columns, and its values."""
    values = np.column_stack([np.arange(200) / 100.0, np.random.default_rng(4).normal(size=(200, len(names) - 1))])
    path = folder / "log.csv"
    np.savetxt(path, values, delimiter=delimiter, header=delimiter.join(names), comments="", fmt="%.9g")
    return path, values


@pytest.mark.parametrize(("names", "delimiter"), [(RTDE, " "), (PLOTJUGGLER, ","), (RTDE, ";")])
def test_a_file_is_read_joint_by_joint(tmp_path: Path, names: list[str], delimiter: str) -> None:
    path, values = written(tmp_path, names, delimiter)
    constants = "[motor_torque_nm]\nfactor = [10, 10.7, 8.5, 9, 9.5, 10.1]" if names is RTDE else None
    maps, recognised = read_joint_maps(path, UR, constants)
    joint = read_telemetry(path, channels=maps[2])
    position, torque = (
        ("actual_q_2", "actual_current_2")
        if names is RTDE
        else ("/joint_states/elbow_joint/position", "/joint_states/elbow_joint/effort")
    )
    assert joint["motor_position_rad"] == pytest.approx(values[:, names.index(position)])
    assert joint["motor_torque_nm"] == pytest.approx(values[:, names.index(torque)] * (8.5 if names is RTDE else 1.0))
    assert read_joint_maps(path, UR, recognised) == (maps, "")


@pytest.mark.parametrize(
    ("constants", "said"),
    [
        (None, "the torque per ampere is needed"),
        ("[motor_torque_nm]\nfactor = [1.0, 2.0]", "factor has 2 entries; the robot has 6 logged joints"),
        ("[motor_torqe_nm]\nfactor = 1.0", "motor_torqe_nm"),
        ("[motor_torque_nm]\nfactor = 2020-01-01", "factor = '2020-01-01' has to be a number"),
        ("delimiter = 4\n[motor_torque_nm]\nfactor = 1.0", "delimiter = 4; write it as"),
        ("motor_torque_nm = {", "channel map: "),
    ],
)
def test_constants_that_do_not_fit_are_refused(tmp_path: Path, constants: str | None, said: str) -> None:
    path, _ = written(tmp_path, RTDE, " ")
    with pytest.raises(TelemetryError) as refused:  # noqa: PT012 - a map is read where a joint is
        maps, _ = read_joint_maps(path, UR, constants)
        read_telemetry(path, channels=maps[0])
    assert said in str(refused.value)
