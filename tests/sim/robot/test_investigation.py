"""A robot's log from the command line to the document, the report, and the description that explains it."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness.live import gearcase
from benchmarks.robot_arms import Link, channel_map, robot, swings, torque, two_links, with_mass, write_log, write_robot
from signals.telemetry import Telemetry
from sim.investigation.data.data_fault import InvestigationError
from sim.robot.investigation import investigate_robot
from sim.robot.motion import RobotLog
from sim.robot.robot import read_robot
from tests.shared_data import shared

KEYS = {
    "verdict", "findings", "unexplained", "parameters", "gain", "next_measurement", "extended_axis", "joints",
    "remarks", "provenance",
}  # fmt: skip
ARM = [Link((0.0, 0.0, 0.2), (0.0, 0.0, 1.0), 6.0, (0.0, 0.0, 0.1), 0.02 * np.eye(3)), *two_links()]
FRICTION = {"coulomb_friction": 2.0, "viscous_friction": 1.5}


def make(folder: Path, payload_kg: float = 0.0, *, briefly: bool = False) -> list[str]:
    """Two joints with friction and rotors, and what hangs there, that no description has, on a turret that is held, or
    moves for a tenth of a second.

    Arguments to investigate are returned.
    """
    rng = np.random.default_rng(3)
    time, q, qd, qdd = swings(rng, 3, 15.0, 100.0)
    q[:, 0], qd[:, 0], qdd[:, 0] = 0.3, 0.0, 0.0
    if briefly:
        u = np.clip((time - 7.0) / 0.1, 0.0, 1.0)
        q[:, 0] += 0.005 * u * u * (3.0 - 2.0 * u)
    links = with_mass(ARM, payload_kg, np.array([0.3, 0.0, 0.0])) if payload_kg else ARM
    felt = torque(links, q, qd, qdd) + 2.0 * np.tanh(qd / 0.03) + 1.5 * qd + 0.5 * qdd
    write_log(folder / "log.csv", time, q, felt + 0.05 * rng.normal(size=q.shape))
    (folder / "map.toml").write_text(channel_map(3))
    robot = write_robot(folder, ARM, ("base/turret", "base/shoulder", "base/elbow"))
    return ["--robot", str(robot), "--telemetry", str(folder / "log.csv"), "--channels", str(folder / "map.toml")]


def test_friction_and_payload_of_a_simulated_arm(tmp_path: Path) -> None:
    words = make(tmp_path, payload_kg=1.5)
    done = gearcase("investigate", *words, "--json", "--report", str(tmp_path / "out.html"), data_dir=tmp_path / "data")
    assert done.code == 0, done.stderr
    document = json.loads(done.stdout, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert set(document) == KEYS
    assert document["verdict"] == "named"
    found = {(f["mechanism"], f["location"]): f for f in document["findings"]}
    named = {place for place, f in found.items() if f["probability"] >= 0.9}
    assert named == {("payload", "payload")} | {(m, j) for m in FRICTION for j in ("base/shoulder", "base/elbow")}
    numbers = {p["name"]: p for p in found["payload", "payload"]["parameters"]}
    assert list(numbers) == ["mass_kg", "center_x_m", "center_y_m", "center_z_m"]
    assert numbers["mass_kg"]["low"] < 1.5 < numbers["mass_kg"]["high"]
    for mechanism, true in FRICTION.items():
        for joint in ("base/shoulder", "base/elbow"):
            size = found[mechanism, joint]["parameters"][0]
            assert size["value"] == pytest.approx(true, rel=0.1)
    assert {p["name"] for p in document["parameters"]} >= {
        "base/shoulder.motor.inertia_kg_m2",
        "base/elbow.motor.inertia_kg_m2",
    }
    assert all(g["joint"] in ("base/shoulder", "base/elbow") and g["rms_after"] < 0.2 for g in document["gain"])
    assert [j["name"] for j in document["joints"]] == ["base/turret", "base/shoulder", "base/elbow"]
    assert document["joints"][0]["verdict"] == "nothing_missing"
    assert "held still" in document["joints"][0]["remarks"][0]

    page = (tmp_path / "out.html").read_text()
    HTMLParser().feed(page)
    assert "base/elbow" in page
    assert not re.search(r"""(src|href)=["']http""", page)
    assert not re.search(r"\bnan\b", page, re.IGNORECASE)

    (tmp_path / "extended.toml").write_text(json.dumps(document["extended_axis"]))
    extended = read_robot(tmp_path / "extended.toml")
    assert extended.payload.mass_kg == pytest.approx(1.5, rel=0.2)
    assert extended.joints[1].axis.motor.coulomb_friction_n_m == pytest.approx(2.0, rel=0.1)
    assert all(joint.described for joint in extended.joints)


def test_a_robot_of_which_all_joints_move_too_briefly_is_refused() -> None:
    time = np.arange(1500) / 100.0
    u = np.clip((time - 7.0) / 0.1, 0.0, 1.0)
    way = 0.005 * u * u * (3.0 - 2.0 * u)
    rng = np.random.default_rng(6)
    noises = [0.1 * rng.normal(size=time.size) for _ in two_links()]
    joints = tuple(Telemetry(time, {"motor_position_rad": way, "motor_torque_nm": noise}) for noise in noises)
    with pytest.raises(InvestigationError, match=r"no joint can be examined\. joint1: The joint moved too briefly"):
        investigate_robot(robot(two_links(), (0.0, 0.0, 0.0)), [RobotLog("short.csv", joints)])


def test_a_joint_that_the_log_lacks_is_logged_or_held(tmp_path: Path) -> None:
    """The turret stands at 0.3 rad, about the vertical: said so, the answer is that of the log with it."""
    words = make(tmp_path)
    whole = json.loads(gearcase("investigate", *words, "--json", data_dir=tmp_path / "data").stdout)
    path = tmp_path / "robot.toml"
    path.write_text(path.read_text().replace('[[joints]]\nname = "base/turret"\n', ""))
    text = channel_map(3).replace("[2, 3, 4]", "[3, 4]").replace("[5, 6, 7]", "[6, 7]")
    (tmp_path / "map.toml").write_text(text)
    done = gearcase("investigate", *words, "--json", data_dir=tmp_path / "data")
    assert done.code == 2
    assert "where these joints of the URDF are: base/turret" in done.stderr
    (held,) = re.findall(r"\[\[held\]\]\n.*\n.*", done.stderr)
    path.write_text(path.read_text() + held.replace("...", "0.3"))
    done = gearcase("investigate", *words, "--json", data_dir=tmp_path / "data")
    assert done.code == 0, done.stderr
    document = json.loads(done.stdout)
    assert [f["location"] for f in document["findings"]] == [f["location"] for f in whole["findings"]]
    assert document["findings"][0]["parameters"][0]["value"] == pytest.approx(
        whole["findings"][0]["parameters"][0]["value"], rel=0.01
    )
    assert "held still as the robot's description says: base/turret at 0.3 rad" in document["remarks"][0]
    path.write_text(json.dumps(document["extended_axis"]))
    assert read_robot(path).held == {"base/turret": 0.3}


@pytest.mark.parametrize("words", [["--axis", "axis.toml"], ["--sound", "s.wav"]])
def test_a_robot_with_what_belongs_to_an_axis_is_wrong_usage(tmp_path: Path, words: list[str]) -> None:
    assert gearcase("investigate", *make(tmp_path), *words, data_dir=tmp_path / "data").code == 2


def test_without_a_map_the_refusal_has_one(tmp_path: Path) -> None:
    done = gearcase("investigate", *make(tmp_path)[:4], data_dir=tmp_path / "data")
    assert done.code == 2
    for line in ('schema = "gearcase-channels/1"', "motor_position_rad = {column = [..., ..., ...]"):
        assert line in done.stderr


UR10E_MAP = """schema = "gearcase-channels/1"
header = false
[time_s]
column = 1
[motor_position_rad]
column = [2, 3, 4, 5, 6, 7]
[motor_torque_nm]
column = [14, 15, 16, 17, 18, 19]
unit = "A"
factor = [10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232]
"""
UR10E = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]


def ur10e(folder: Path) -> Path:
    """Write the robot's description and return it."""
    urdf = shared("data", "robots", "ur10e", "ur10e.urdf")
    (folder / "ur10e.urdf").write_bytes(urdf.read_bytes())
    joints = "".join(f'[[joints]]\nname = "{name}"\n' for name in UR10E)
    (folder / "robot.toml").write_text(f'schema = "gearcase-robot/1"\nurdf = "ur10e.urdf"\n{joints}')
    return folder / "robot.toml"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "holds"), [("harmonics_20s.csv", 0.0), ("without_payload.csv", 0.0), ("with_payload.csv", 2.805)]
)
def test_friction_and_payload_of_a_real_arm(tmp_path: Path, log: str, holds: float) -> None:
    (tmp_path / "map.toml").write_text(UR10E_MAP)
    words = ["--robot", str(ur10e(tmp_path)), "--channels", str(tmp_path / "map.toml")]
    words += ["--telemetry", str(shared("data", "robots", "ur10e", log)), "--json"]
    done = gearcase("investigate", *words, data_dir=tmp_path / "data")
    assert done.code == 0, done.stderr
    findings = json.loads(done.stdout)["findings"]
    found = {(f["mechanism"], f["location"]): f for f in findings if f["probability"] >= 0.9}
    assert {(m, joint) for m in FRICTION for joint in UR10E} <= set(found)
    assert (("payload", "payload") in found) == bool(holds)
    if holds:
        mass = found["payload", "payload"]["parameters"][0]
        assert mass["low"] < holds < mass["high"]


GAINS = (10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232)  # N m per ampere


@pytest.mark.slow
@pytest.mark.parametrize("log", ["harmonics_20s.csv", "without_payload.csv", "with_payload.csv"])
def test_unseen_torque_of_a_real_arm_is_told_as_well_as_by_least_squares(tmp_path: Path, log: str) -> None:
    """Of each joint: dry friction that turns over a share of its largest speed, viscous friction, offset and rotor, on
    the same rows and folds, of what the rigid body leaves of the torque."""
    rows = np.loadtxt(shared("data", "robots", "ur10e", log), delimiter=",")
    channels = [{"motor_position_rad": rows[:, 1 + j], "motor_torque_nm": GAINS[j] * rows[:, 13 + j]} for j in range(6)]
    time_s = rows[:, 0] - rows[0, 0]
    joints = tuple(Telemetry(time_s, each) for each in channels)
    found = investigate_robot(read_robot(ur10e(tmp_path)), [RobotLog(log, joints)])
    for joint in found.joints:
        assert joint.investigation.data_check is not None
        m = joint.investigation.data_check.measurement
        assert m.known_torque is not None
        counting = np.flatnonzero((m.weight > 0.5) & (np.arange(m.samples) > 0.1 * m.rate_hz))
        left = []
        for width in (0.003, 0.01, 0.03, 0.1):
            turned = np.tanh(m.speed / (width * np.abs(m.speed).max()))
            columns = np.stack([turned, m.speed, np.ones(m.samples), m.acceleration], axis=1)
            torque = m.torque - m.known_torque
            errors = []
            for fold in np.array_split(counting, 4):
                others = np.setdiff1d(counting, fold)
                numbers = np.linalg.lstsq(columns[others], torque[others], rcond=None)[0]
                errors.append(torque[fold] - columns[fold] @ numbers)
            left.append(float(np.sqrt(np.mean(np.concatenate(errors) ** 2))))
        (gain,) = joint.investigation.gain
        assert gain.rms_after < 1.15 * min(left), joint.name
