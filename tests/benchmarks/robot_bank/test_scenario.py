"""Logs of the bank hold what they say and nothing else; kept short here."""

from __future__ import annotations

import json
import tomllib
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot_bank.drive import bristles
from benchmarks.robot_bank.effects import LEVELS
from benchmarks.robot_bank.multibody import Array, torques
from benchmarks.robot_bank.scenario import Scenario, generate, write

SHORT_S = 4.0


@lru_cache
def _made(kind: str) -> Scenario:
    """Return one short case of a kind."""
    return generate(21, kind, "half", SHORT_S)


def _table(scenario: Scenario, folder: Path) -> tuple[Array, dict[str, Array]]:
    """Return time [s] and the channels (n, 6) of the written files in SI units at the joints, by robot.toml's order."""
    channels = tomllib.loads((folder / "channels.toml").read_text())
    lines = (folder / "log.csv").read_text().splitlines()
    delimiter = scenario.recorder.delimiter
    header = [] if channels.get("header") is False else lines.pop(0).split(delimiter)
    values = np.array([[float(cell) for cell in line.split(delimiter)] for line in lines])
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "rad": 1.0, "deg": np.pi / 180, "rad/s": 1.0, "deg/s": np.pi / 180}

    def column(name: str | int) -> Array:
        return values[:, name - 1 if isinstance(name, int) else header.index(name)]

    read = {}
    for channel in ("motor_position_rad", "motor_torque_nm"):
        table = channels[channel]
        factors = table.get("factor", [units.get(table["unit"], 1.0)] * 6)
        read[channel] = np.column_stack([f * column(c) for f, c in zip(factors, table["column"], strict=True)])
    return column(channels["time_s"]["column"]) * units[channels["time_s"]["unit"]], read


@pytest.mark.parametrize("kind", ["payload", "torque_offset", "gravity_imbalance"])
def test_the_equations_of_the_truth_leave_the_noise_of_the_written_log(kind: str, tmp_path: Path) -> None:
    scenario = _made(kind)
    write(scenario, tmp_path)
    time, read = _table(scenario, tmp_path)
    order = list(scenario.recorder.order)
    names = [joint["name"] for joint in tomllib.loads((tmp_path / "robot.toml").read_text())["joints"]]
    assert names == [scenario.written.names[j] for j in order]
    motion, robot, gears = scenario.motion, scenario.robot, scenario.signals.gears
    rigid = torques(robot.arm.chain, robot.bodies(), motion.angles, motion.speeds, motion.accelerations, robot.gravity)
    for place, j in enumerate(order):
        since = time - time[0]
        position = read["motor_position_rad"][:, place] / gears[j]
        at = [np.interp(since, motion.time, course[:, j]) for course in (motion.angles, motion.accelerations)]
        # as far off as a rounded time stamp makes it
        slack = 8 * scenario.recorder.step + scenario.recorder.stamp * np.max(np.abs(motion.speeds[:, j]))
        np.testing.assert_allclose(position, at[0], atol=slack)
        drive = robot.drives[j]
        friction = (
            drive.dry * bristles(motion.angles[:, j], drive.way, drive.start) + drive.viscous * motion.speeds[:, j]
        )
        model = np.interp(since, motion.time, rigid[:, j] + friction) + drive.rotor * at[1]
        model += drive.imbalance * np.sin(at[0] + drive.imbalance_phase)
        hidden = [h for h in scenario.hidden if h["location"] == scenario.written.names[j]]
        if kind == "torque_offset" and hidden:
            model += hidden[0]["sizes"]["torque_n_m"] * gears[j]
        left = read["motor_torque_nm"][:, place] * gears[j] - model
        assert np.sqrt(np.mean(left**2)) == pytest.approx(scenario.recorder.torque_noise[j], rel=0.25)


def test_the_same_seed_writes_the_same_files(tmp_path: Path) -> None:
    write(_made("payload"), tmp_path / "one")
    write(generate(21, "payload", "half", SHORT_S), tmp_path / "other")
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert {"robot.toml", "arm.urdf", "channels.toml", "log.csv"} <= set(files)
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


@pytest.mark.parametrize("kind", ["coulomb_friction", "torque_ripple", "backlash", "payload_wrong"])
def test_what_is_hidden_is_at_one_joint_and_not_in_the_description(kind: str, tmp_path: Path) -> None:
    scenario = _made(kind)
    (hidden,) = scenario.answer()["hidden"]
    json.dumps(scenario.answer())
    write(scenario, tmp_path)
    robot = tomllib.loads((tmp_path / "robot.toml").read_text())
    if kind == "payload_wrong":
        assert not 0.7 < robot["payload"]["mass_kg"] / hidden["sizes"]["mass_kg"] < 1.4
        return
    assert hidden["location"] in [joint["name"] for joint in robot["joints"]]
    assert scenario.strength >= 0.9 * LEVELS["half"] or hidden["may_be_missed"]
    axes = {joint["name"]: joint["axis"] for joint in robot["joints"] if "axis" in joint}
    absent = {"coulomb_friction": "coulomb_friction_n_m", "viscous_friction": "viscous_friction_n_m_s_per_rad"}
    for joint, file in axes.items():
        motor = tomllib.loads((tmp_path / file).read_text())["motor"]
        for mechanism, key in absent.items():
            assert (motor[key] == 0) == (kind == mechanism and joint == hidden["location"])
