"""Every finding at a robot has the plot that shows it: sizes and units in the picture are those that were hidden."""

import re
from dataclasses import replace
from functools import lru_cache

import numpy as np

from benchmarks.robot_arms import Array, robot, swings, torque, two_links, with_mass
from signals.telemetry import Telemetry
from sim.investigation.report.panels import AS_DESCRIBED, EXTENDED, MEASURED, Panel
from sim.robot.investigation import investigate_robot
from sim.robot.motion import RobotLog
from sim.robot.report import finding_panels
from sim.robot.results import RobotInvestigation

DRY, VISCOUS, HANGS = 2.0, 1.5, 1.5


@lru_cache
def found() -> RobotInvestigation:
    """A turning and a sliding joint with friction, what hangs there, and a link that is heavier than described."""
    rng = np.random.default_rng(3)
    time, q, qd, qdd = swings(rng, 2, 15.0, 100.0, size=0.4)
    first, second = two_links()
    links = [first, replace(second, slides=True, axis=(1.0, 0.0, 0.0))]
    heavier = [replace(links[0], mass=1.08 * links[0].mass), links[1]]
    felt = torque(with_mass(heavier, HANGS, np.array([0.3, 0.0, 0.0])), q, qd, qdd)
    felt = felt + DRY * np.tanh(qd / 0.03) + VISCOUS * qd + 0.5 * qdd + 0.05 * rng.normal(size=q.shape)
    log = [Telemetry(time, {"motor_position_rad": q[:, k], "motor_torque_nm": felt[:, k]}) for k in range(2)]
    return investigate_robot(robot(links), [RobotLog("log", tuple(log))])


def line(panel: Panel, name: str) -> Array:
    return dict(panel.lines)[name]


def panel_of(mechanism: str, place: str) -> Panel:
    result = found()
    shown = zip(result.findings(), finding_panels(result), strict=True)
    (panel,) = [p for one, p in shown if (one.finding.mechanism, one.place) == (mechanism, place)]
    assert panel is not None
    return panel


def test_friction_stands_over_the_speed_of_its_joint_in_its_units() -> None:
    dry = panel_of("coulomb_friction", "joint1")
    assert dry.title == "Coulomb friction at joint1: torque over speed"
    assert (dry.x_label, dry.y_label) == ("speed of the joint [rad/s]", "torque of the joint [N m]")
    fast = np.abs(dry.x) > 0.3
    for name in (MEASURED, EXTENDED):
        np.testing.assert_allclose(line(dry, name)[fast], DRY * np.sign(dry.x[fast]), atol=0.15)
    assert not np.nan_to_num(line(dry, AS_DESCRIBED)).any()
    sliding = panel_of("viscous_friction", "joint2")
    assert sliding.title == "Viscous friction at joint2: force over speed"
    assert (sliding.x_label, sliding.y_label) == ("speed of the joint [m/s]", "force of the joint [N]")
    made = line(sliding, EXTENDED)
    np.testing.assert_allclose(made[np.isfinite(made)], VISCOUS * sliding.x[np.isfinite(made)], atol=0.3)


def test_numbers_of_a_sliding_joint_have_its_units() -> None:
    document = found().document()
    units = {(one.finding.mechanism, one.place): one.finding.parameters[0].unit for one in found().findings()}
    assert (units["coulomb_friction", "joint1"], units["coulomb_friction", "joint2"]) == ("N m", "N")
    assert (units["viscous_friction", "joint1"], units["viscous_friction", "joint2"]) == ("N m s/rad", "N s/m")
    (said,) = [
        one.finding.explanation
        for one in found().findings()
        if one.place == "joint2" and "Dry" in one.finding.explanation
    ]
    assert re.match(r"Dry friction of [\d.]+ N as felt at the joint", said)
    joints, gains = document["joints"], document["gain"]
    assert isinstance(joints, list)
    assert isinstance(gains, list)
    assert [joint["unit"] for joint in joints] == [gain["unit"] for gain in gains] == ["N m", "N"]
