"""Generated recordings of a joint within a moving robot have the loads of the equations of motion."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.acoustics.audibility import perform_fault
from sim.acoustics.microphone import Microphone
from sim.description.axis import Axis, Load, MechanismEntry, Motion, Motor, Stage
from sim.experiment.design_of_experiments import Planned, plan
from sim.experiment.pose_load import PoseLoad
from sim.experiment.scenario import SETTLING_S, Scenario, scenario_of
from sim.experiment.specimen import Specimen
from sim.robot import joint_plan
from sim.robot.joint_plan import plan_joint, pose_load
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Joint, Payload, Robot, RobotError
from sim.robot.urdf import read_urdf
from tests.sim.robot import arms
from tests.sim.robot.arms import GRAVITY, Link, torque, two_links, with_mass

Array = NDArray[np.float64]
LENGTH, MASS = 0.5, 4.0
DRIVE = Axis(
    "drive",
    Motor(2e-4, viscous_friction_n_m_s_per_rad=1e-3),
    Load(1.0),
    (Stage("gear", driver_teeth=20, driven_teeth=1000, stiffness_n_m_per_rad=5e4, damping_n_m_s_per_rad=50.0),),
    motion=Motion(4.0, 1.0, 0.4),
)


def robot(links: list[Link], gravity: tuple[float, float, float] = GRAVITY, axis: Axis = DRIVE) -> Robot:
    """The first joint is described."""
    plain = arms.robot(links, gravity)
    return replace(plain, joints=(Joint("joint1", axis, described=True), *plain.joints[1:]))


def turntable(axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> list[Link]:
    """Two bars without mass, one after the other along x, that turn about parallel axes; a point mass at the end."""
    first = Link((0.0, 0.0, 0.5), axis, 0.0, (0.0, 0.0, 0.0))
    return [first, Link((LENGTH, 0.0, 0.0), axis, MASS, (LENGTH, 0.0, 0.0))]


def load(given: Robot, first: list[float], last: list[float]) -> tuple[float, PoseLoad]:
    return pose_load(given, RigidBody.of(given), 0, np.array(first), np.array(last))


def scenario(inertia: float, along: PoseLoad | None) -> Scenario:
    """The motion of `DRIVE`: 1.6 rad about 0."""
    axis = replace(DRIVE, load=Load(inertia))
    return Scenario(axis, inertia, Specimen(5), Microphone(), 4.0, start_phase=0.3, pose_load=along)


def test_an_outstretched_arm_is_heavier_to_turn_than_a_folded_one() -> None:
    """m r^2 of a point mass, r by the law of cosines; about a vertical axis nothing else is asked for."""
    for bent in (0.0, 2.0, 3.0):
        inertia, along = load(robot(turntable()), [-0.8, bent], [0.8, bent])
        r2 = 2.0 * LENGTH**2 * (1.0 + np.cos(bent))
        assert inertia == pytest.approx(MASS * r2, rel=1e-6)
        assert along.own_inertia_kg_m2 == along.inertia_kg_m2
        assert along.inertia_kg_m2 == pytest.approx(np.full(len(along.inertia_kg_m2), MASS * r2), rel=1e-6)
        assert not np.any(along.gravity_n_m)
        assert not np.any(along.centrifugal_kg_m2)


def test_in_a_kept_pose_about_a_vertical_axis_it_is_the_recording_of_the_axis_alone() -> None:
    inertia, along = load(robot(turntable()), [-0.8, 1.0], [0.8, 1.0])
    alone, carried = scenario(inertia, None).perform(), scenario(inertia, along).perform()
    assert carried == pytest.approx(alone, abs=1e-4 * float(np.abs(alone).max()))


def test_weight_turns_its_sign_with_gravity() -> None:
    """m g r cos(angle) of an outstretched arm about a level axis; hung from the ceiling, the other way."""
    arm = turntable((0.0, -1.0, 0.0))
    (_, down), (_, up) = (load(robot(arm, (0.0, 0.0, g)), [-0.8, 0.0], [0.8, 0.0]) for g in (-9.81, 9.81))
    weight = MASS * 9.81 * 2.0 * LENGTH * np.cos(np.linspace(-0.8, 0.8, len(down.gravity_n_m)))
    assert down.gravity_n_m == pytest.approx(weight, rel=1e-6)
    assert up.gravity_n_m == pytest.approx(-weight, rel=1e-6)


def test_the_load_follows_the_pose_as_the_equations_of_motion_say() -> None:
    """Both joints move; the motor turns its rotor and, through the gear, what Newton and Euler say of the links."""
    arm, first, last = two_links(), np.array([-0.8, -0.5]), np.array([0.8, 1.9])
    inertia, along = load(robot(arm), list(first), list(last))
    made = scenario(inertia, along)
    motion = made.motion()
    together = (last - first) / (last - first)[0]
    ways = [first + np.outer(motion[0] - first[0], together), *(np.outer(each, together) for each in motion[1:])]
    links = torque(arm, *ways)[:, 0]
    assert np.ptp(along.own_inertia_kg_m2) > 0.4 * inertia
    assert made.load_torque(motion) == pytest.approx(links, abs=1e-4 * np.abs(links).max())
    run, heard = made.simulate(), slice(round(SETTLING_S * 8000), None)
    ratio, motor = DRIVE.ratio, DRIVE.motor
    friction = motor.viscous_friction_n_m_s_per_rad * ratio * motion[1]
    expected = links / ratio + motor.inertia_kg_m2 * ratio * motion[2] + friction
    assert run.angle_rad[heard, -1] == pytest.approx(motion[0][heard], abs=5e-3)
    left = (run.motor_torque_n_m - expected)[heard]
    assert np.sqrt(np.mean(left**2)) < 0.03 * np.sqrt(np.mean(expected[heard] ** 2))


def test_a_part_of_the_load_that_hangs_on_a_spring_is_a_part_of_it() -> None:
    """A soft tool leaves the motor torque, but for its ringing, that of the load in one piece."""
    inertia, along = load(robot(two_links()), [-0.8, -0.5], [0.8, 1.9])
    whole = scenario(inertia, along)
    soft = MechanismEntry("structural_resonance", "load", {"share": 0.3, "frequency_hz": 200.0, "damping_ratio": 0.3})
    parted = replace(whole, axis=replace(whole.axis, mechanisms=(soft,)))
    one, other = (each.simulate().motor_torque_n_m[round(SETTLING_S * 8000) :] for each in (whole, parted))
    assert np.sqrt(np.mean((one - other) ** 2)) < 0.03 * np.sqrt(np.mean(one**2))


def test_of_a_described_payload_a_case_carries_between_nothing_and_all() -> None:
    arm, center = two_links(), (0.3, 0.0, 0.1)
    given = replace(robot(arm), payload=Payload(2.0, center))
    for each in plan_joint(given, 0, {"normal": 4}, 2):
        along = each.scenario.pose_load
        assert along is not None
        assert 0.0 < along.payload_kg < 2.0
        carrying = with_mass(arm, along.payload_kg, np.array(center))
        ends = np.array([along.first_rad, along.last_rad])
        held = torque(carrying, ends, np.zeros((2, 2)), np.zeros((2, 2)))[:, 0]
        assert [along.gravity_n_m[0], along.gravity_n_m[-1]] == pytest.approx(held, rel=1e-5)
        assert scenario_of(json.loads(json.dumps(each.scenario.to_mapping()))) == each.scenario


def carried(planned: Planned) -> Array:
    return planned.scenario.load_torque(planned.scenario.motion(200.0))


def test_faults_of_a_joint_under_weight_are_where_they_can_be_heard() -> None:
    """Where weight keeps one flank, play makes no sound, and nor does damage of the other flank."""
    planned = plan_joint(robot(two_links()), 0, {"play": 6, "notch": 6}, 1)
    for each in planned[:6]:
        assert carried(each).min() < 0.0 < carried(each).max()
    one_sided = [each for each in planned[6:] if carried(each).min() > 0.0 or carried(each).max() < 0.0]
    assert one_sided
    for each in one_sided:
        assert each.mechanism is not None
        assert each.mechanism.parameters["flank"] == np.sign(carried(each).mean())
    assert perform_fault(one_sided[0].scenario).ratio > 0.0


def test_a_motion_stays_within_what_the_joints_can_do() -> None:
    text = arms.urdf(two_links(), reach=0.7)
    for each in plan_joint(replace(robot(two_links()), urdf=read_urdf(text.encode())), 0, {"normal": 8}, 1):
        along, motion = each.scenario.pose_load, each.scenario.motion()
        assert along is not None
        assert np.abs([along.first_rad, along.last_rad]).max() <= 0.7 + 1e-9
        assert (motion[0].min(), motion[0].max()) == pytest.approx(sorted(along.ends_rad), abs=1e-6)
        other = abs(along.last_rad[1] - along.first_rad[1]) / abs(along.last_rad[0] - along.first_rad[0])
        assert other * np.abs(motion[1]).max() <= 3.0 + 1e-9


def test_the_plan_of_a_joint_is_that_of_its_axis_but_for_the_load() -> None:
    counts = {"normal": 2, "notch": 2}
    whole = plan_joint(robot(two_links()), 0, counts, 3)
    assert plan_joint(robot(two_links()), 0, counts, 3, only=range(1, 3)) == whole[1:3]
    for one, other in zip(whole, plan(DRIVE, counts, 3), strict=True):
        assert (one.label, one.size, one.scenario.specimen) == (other.label, other.size, other.scenario.specimen)
        assert one.scenario.microphone == other.scenario.microphone
    assert "pose_load" not in plan(DRIVE, counts, 3)[0].scenario.to_mapping(), "an axis' own cases keep their keys"


def test_a_motor_that_cannot_lift_the_arm_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint_plan, "DRAWS", 5)
    weak = replace(DRIVE, motor=replace(DRIVE.motor, torque_limit_n_m=1e-3))
    with pytest.raises(RobotError, match=r"joints\[0\].axis: in none of 5 motions .* motor.torque_limit_n_m"):
        plan_joint(robot(two_links(), axis=weak), 0, {"normal": 1})
