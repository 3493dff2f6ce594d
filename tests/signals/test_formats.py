"""Logs of MATLAB, LabVIEW and ROS 2 are read as they are; what is broken is refused in words."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer
from nptdms import ChannelObject, TdmsWriter
from scipy import io

from signals.errors import TelemetryError
from signals.formats.open_table import loaded
from signals.telemetry import Telemetry, read_telemetry, recognise_columns

ROWS = 300
T = np.arange(ROWS) * 0.01
ANGLE, SPEED, TORQUE = np.sin(T), np.cos(T), 0.3 * np.cos(3 * T)
JOINT_STATE = "\n".join(
    [
        "std_msgs/Header header",
        "string[] name",
        *(f"float64[] {field}" for field in ("position", "velocity", "effort")),
        80 * "=",
        "MSG: std_msgs/Header",
        "builtin_interfaces/Time stamp",
        "string frame_id",
        80 * "=",
        "MSG: builtin_interfaces/Time",
        "int32 sec",
        "uint32 nanosec",
    ]
)


def bag(path: Path, messages: list[tuple[str, float, dict[str, list[float]]]]) -> Path:
    """A bag of joint states: topic, time [s], and by joint position, velocity and effort."""
    with path.open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for topic, time, joints in messages:
            at = round(1e9 * time) + 1_764_000_000 * 10**9
            stamp = {"sec": at // 10**9, "nanosec": at % 10**9}
            columns = zip(*joints.values(), strict=True)
            fields = dict(zip(("position", "velocity", "effort"), map(list, columns), strict=True))
            message = {"header": {"stamp": stamp, "frame_id": ""}, "name": list(joints), **fields}
            writer.write_message(topic, schema, message, log_time=at, publish_time=at)
        writer.finish()
    return path


def joint_states(path: Path) -> Path:
    values = zip(T, ANGLE, SPEED, TORQUE, strict=True)
    return bag(path, [("/joint_states", t, {"elbow_joint": [q, v, m]}) for t, q, v, m in values])


def mat(path: Path) -> Path:
    """A structure with a matrix that lies down, beside what is no column of the log."""
    log = {"t_ms": 1e3 * T, "q": ANGLE[None, :], "dq": SPEED[:, None], "tau": TORQUE, "gains": np.eye(3)}
    io.savemat(path, {"log": log, "note": "a test", "settings": np.arange(4.0)}, do_compression=True)
    return path


def tdms(path: Path) -> Path:
    clock = {"wf_increment": 0.01, "wf_start_offset": 0.0}
    columns = [("Motor Angle", np.degrees(ANGLE), "deg"), ("Motor Speed", SPEED * 30 / np.pi, "rpm")]
    columns.append(("Motor Torque", 1e3 * TORQUE, "mN.m"))
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [ChannelObject("Log", name, values, {**clock, "unit_string": unit}) for name, values, unit in columns]
            + [ChannelObject("Log", "comment", ["begin", "end"])]
        )
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {"mcap": joint_states, "mat": mat, "tdms": tdms}


def is_the_motion(found: Telemetry) -> None:
    assert found.time_s == pytest.approx(T, abs=1e-6)
    for channel, values in (
        ("motor_position_rad", ANGLE),
        ("motor_speed_rad_s", SPEED),
        ("motor_torque_nm", TORQUE),
    ):
        assert found[channel] == pytest.approx(values, abs=1e-9)


@pytest.mark.parametrize("kind", WRITERS)
def test_one_motion_in_every_format_is_the_same(tmp_path: Path, kind: str) -> None:
    found = read_telemetry(WRITERS[kind](tmp_path / f"log.{kind}"))
    is_the_motion(found)
    is_the_motion(read_telemetry(tmp_path / f"log.{kind}", channels=found.recognised))


@pytest.mark.parametrize("kind", WRITERS)
def test_a_broken_file_is_refused_or_read_and_never_more(tmp_path: Path, kind: str) -> None:
    """Cut off, or with bytes changed anywhere: as the limited process takes what strangers send."""
    whole = WRITERS[kind](tmp_path / f"log.{kind}").read_bytes()
    draw = np.random.default_rng(5)
    refused = 0
    for number in range(24):
        content = bytearray(whole[: int(draw.integers(20, len(whole)))] if number % 2 else whole)
        for place in draw.integers(8, len(content), 0 if number % 2 else 40):
            content[place] = draw.integers(256)
        (tmp_path / "broken").write_bytes(content)
        try:
            read_telemetry(tmp_path / "broken")
        except TelemetryError:
            refused += 1
    assert refused > 0


def test_joints_of_a_bag_are_said_and_one_is_chosen_by_its_lines(tmp_path: Path) -> None:
    """Two publishers on one topic: rows of the other joints are no rows of this one."""
    messages: list[tuple[str, float, dict[str, list[float]]]] = []
    for t, q, v, m in zip(T, ANGLE, SPEED, TORQUE, strict=True):
        messages.append(("/joint_states", t, {"wrist_joint": [q, v, m], "elbow_joint": [2 * q, 2 * v, 2 * m]}))
        messages.append(("/joint_states", t + 0.004, {"gripper": [0.0, 0.0, 0.0]}))
    path = bag(tmp_path / "log.mcap", messages)
    found = recognise_columns(path)
    assert "there are columns of 3 axes (wrist, elbow, gripper)" in found.open
    lines = found.map.splitlines()
    start = lines.index("# of the axis elbow instead:") + 1
    elbow = [line.removeprefix("# ") for line in lines[start : start + 3]]
    read = read_telemetry(path, channels="\n".join([*lines[:2], *elbow]))
    assert read.time_s == pytest.approx(T, abs=1e-6)
    assert read["motor_torque_nm"] == pytest.approx(2 * TORQUE)
    is_the_motion(read_telemetry(path, channels="\n".join(lines[:5])))


def test_clocks_of_two_topics_are_not_mixed(tmp_path: Path) -> None:
    messages: list[tuple[str, float, dict[str, list[float]]]] = []
    for t, q, v, m in zip(T, ANGLE, SPEED, TORQUE, strict=True):
        messages += [("/left", t, {"elbow": [q, v, m]}), ("/right", t + 0.001, {"elbow": [q, v, m]})]
    path = bag(tmp_path / "log.mcap", messages)
    lines = '[time_s]\ncolumn = "/left time"\n[motor_torque_nm]\ncolumn = "/{} effort[elbow]"\n'
    assert read_telemetry(path, channels=lines.format("left")).rows == ROWS
    with pytest.raises(TelemetryError, match="topics with clocks of their own: /left, /right"):
        read_telemetry(path, channels=lines.format("right"))


def test_a_bag_without_joint_states_says_what_it_has(tmp_path: Path) -> None:
    with (tmp_path / "log.mcap").open("wb") as file:
        writer = Writer(file)
        schema = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        writer.write_message("/torque", schema, {"data": 1.0}, log_time=1, publish_time=1)
        writer.finish()
    with pytest.raises(TelemetryError, match=r"without joint states .*; it has /torque \(std_msgs/msg/Float64\)"):
        read_telemetry(tmp_path / "log.mcap")


@pytest.mark.parametrize("missing", ["nptdms", "mcap_ros2.decoder"])
def test_what_is_not_installed_is_named(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(TelemetryError, match=r'this is a log; .* pip install "gearcase\[logs\]"'):
        loaded(missing, "a log")


@pytest.mark.parametrize(
    ("start", "words"),
    [
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64", r"save\('log.mat', '-v7'\)"),
        (b"MDF     4.10    ", "export its channels as MAT"),
        (b"SQLite format 3", "ros2 bag convert"),
        (b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
        (b"PK\x03\x04", "export the sheet as CSV"),
    ],
)
def test_a_format_that_is_not_read_says_what_to_do(tmp_path: Path, start: bytes, words: str) -> None:
    (tmp_path / "log").write_bytes(start + bytes(600))
    with pytest.raises(TelemetryError, match=words):
        read_telemetry(tmp_path / "log")


def test_a_trace_of_blocks_is_a_table_of_its_variables(tmp_path: Path) -> None:
    """CODESYS: one block a variable, each with stamps of its own, in a unit that no key says."""
    lines = ["[key]; [value]", "Version; 0x03050000", "BufferEntries; 300"]
    for number, (name, values) in enumerate((("Axis.fActPosition", ANGLE), ("Axis.fActTorque", TORQUE))):
        lines += [f"{number}.Variable; {name}", f"{number}.YAxis; 0", f"{number}.Data; "]
        lines += [f"; {1e3 * t:.0f}; {value:.12g}" for t, value in zip(T, values, strict=True)]
    path = tmp_path / "trace.csv"
    path.write_text("\r\n".join(lines))
    map_ = recognise_columns(path)
    assert "time_s has no unit" in map_.open
    text = map_.map.replace('"time", unit = "..."', '"time", unit = "ms"').replace(
        'unit = "..."}  # N', 'unit = "N.m"}  # N'
    )
    found = read_telemetry(path, channels=text.replace('unit = "..."}  # rad', 'unit = "rad"}  # rad'))
    assert found.time_s == pytest.approx(T)
    assert found["motor_position_rad"] == pytest.approx(ANGLE)
    assert found["motor_torque_nm"] == pytest.approx(TORQUE)
