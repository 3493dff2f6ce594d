"""The second generator obeys mechanics, its own law of friction, and what it writes; its logs are kept short here."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.robot_bank.multibody import Array
from tests.robot_bank.score import judge
from tests.robot_bank.second import dynamics, servo
from tests.robot_bank.second.builds import BUILDS, Build, draw_build
from tests.robot_bank.second.cases import KINDS, Scenario, generate, write
from tests.robot_bank.second.description import draw_written, write_urdf
from tests.robot_bank.second.dynamics import STEP_S
from tests.robot_bank.second.plan import SHARES, plan
from tests.robot_bank.second.programs import KINDS as PROGRAMS
from tests.robot_bank.second.programs import LEAD_S, draw_program
from tests.robot_bank.second.servo import Drive, Friction, Servo

SHORT_S = 4.0
DOWN = np.array([0.0, 0.0, -9.81])
FRICTION = Friction(dry=3.0, loss=0.0, viscous=4.0, power=0.8, way=1e-4)


@lru_cache
def _made(kind: str) -> Scenario:
    return generate(31, kind, "half", SHORT_S)


def _build(name: str) -> Build:
    return draw_build(np.random.default_rng(5), name)


def _single(rotor: float = 0.5) -> tuple[mujoco.MjModel, Build]:
    """Return an upright axis alone, that nothing loads, and what it was drawn as."""
    build = _build("scara")
    one = replace(
        build, sliding=(False,), directions=build.directions[:1], points=build.points[:1], bodies=build.bodies[:1]
    )
    return dynamics.model(one, one.bodies, DOWN, np.array([rotor])), one


def _held(wanted: Array, friction: Friction, moving: mujoco.MjModel, **changes: float) -> servo.Run:
    """Let one joint follow angles (m,)."""
    loop = Servo(20.0, 200.0, 2000.0, 0.0, 1.0, 1e-7, 200.0, 1e4)
    drive = replace(Drive(friction, loop, 0.5, 100.0, 100.0), **changes)
    none = np.zeros((len(wanted), 1))
    program = wanted[:, None], np.gradient(wanted, STEP_S)[:, None]
    return servo.run(moving, [drive], program, none, none, 0.0, np.zeros(1))


@pytest.mark.parametrize("elastic", [False, True])
@pytest.mark.parametrize("name", BUILDS)
def test_a_robot_left_alone_keeps_its_energy(name: str, elastic: bool) -> None:
    build = _build(name)
    rotors = 0.2 * dynamics.inertias(dynamics.model(build, build.bodies, DOWN), build.home[None])[0]
    moving = dynamics.model(build, build.bodies, DOWN, rotors, elastic)
    moving.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    moving.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    if elastic:
        moving.jnt_stiffness[1::2] = 2000 * rotors
    data = mujoco.MjData(moving)
    data.qpos[:: 2 if elastic else 1] = build.home
    data.qvel[:: 2 if elastic else 1] = 0.3 * build.speed
    mujoco.mj_forward(moving, data)
    before, motion = float(data.energy.sum()), float(data.energy[1])
    for _ in range(800):
        mujoco.mj_step(moving, data)
    assert float(data.energy.sum()) == pytest.approx(before, abs=1e-4 * max(motion, abs(before)))


@pytest.mark.parametrize("speed", [-2.0, -0.05, 0.3, 1.5])
def test_at_a_steady_speed_friction_is_that_of_its_formula(speed: float) -> None:
    moving, _ = _single()
    time = np.arange(0, 3, STEP_S)
    for friction in (FRICTION, replace(FRICTION, inner=30.0, stribeck=2.0, stribeck_speed=0.2, asymmetry=0.2)):
        run = _held(speed * time, friction, moving)
        sign = np.sign(speed)
        dry = 3.0 + friction.stribeck * np.exp(-((speed / 0.2) ** 2))
        expected = sign * (dry + 4.0 * abs(speed) ** 0.8) * (1 + friction.asymmetry * sign)
        assert float(np.mean(run.torques[-800:])) == pytest.approx(expected, rel=5e-3)
        assert float(friction.steady(np.array([speed]))[0]) == pytest.approx(expected)


def test_friction_gives_way_like_a_spring_before_it_slides() -> None:
    moving, _ = _single()
    time = np.arange(0, 2, STEP_S)
    # a hundredth of the way over which it builds up, and back
    run = _held(1e-6 * np.sin(np.pi * time) ** 2, replace(FRICTION, viscous=0.0), moving)
    assert np.max(np.abs(run.angles)) > 3e-7
    np.testing.assert_allclose(run.side, (run.angles - run.angles[0]) / 1e-4, atol=2e-4)


@pytest.mark.parametrize("gap", [0.0, 2e-3])
def test_an_elastic_gear_carries_the_weight_of_its_link_and_nothing_while_its_motor_crosses_the_play(
    gap: float,
) -> None:
    build = _build("five")
    one = replace(
        build, sliding=(False,), directions=build.directions[1:2], points=build.points[1:2], bodies=build.bodies[1:2]
    )
    rigid = dynamics.model(one, one.bodies, DOWN)
    moving = dynamics.model(one, one.bodies, DOWN, np.array([0.5]), elastic=True)
    time = np.arange(0, 8, STEP_S)
    # to one side of upright, a stay, to the other side, a stay
    ways = np.interp(time, [0, 4, 5.5, 8], [0.8, 0.8, -0.8, -0.8])
    loop = Servo(20.0, 40.0, 200.0, 0.0, 1.0, 1e-7, 200.0, 1e3)
    free = replace(FRICTION, dry=0.0, viscous=0.0)
    drive = Drive(free, loop, 0.5, 20.0, 100.0, stiffness=3000.0, damping=30.0, gap=gap)
    none = np.zeros((len(time), 1))
    hold = dynamics.asked(rigid, ways[:1, None], none[:1], none[:1])[0]
    run = servo.run(moving, [drive], (ways[:, None], np.gradient(ways, STEP_S)[:, None]), none, none, 0.0, hold)
    still = [round(3.99 / STEP_S), len(time) - 1]
    weight = dynamics.asked(rigid, run.angles[still], none[still], none[still])
    assert float(weight[0, 0] * weight[1, 0]) < 0
    np.testing.assert_allclose(run.carried[still], weight, rtol=0.03)
    np.testing.assert_allclose(run.torques[still], weight, rtol=0.03)
    assert np.any(run.carried == 0) == (gap > 0)


@pytest.mark.parametrize("kind", [*PROGRAMS, "mixture"])
def test_programs_begin_at_rest_and_keep_to_what_joints_can_do(kind: str) -> None:
    for name in ("heavy", "scara", "five"):
        build = _build(name)
        rigid = dynamics.model(build, build.bodies, DOWN)
        program = draw_program(np.random.default_rng(3), build, rigid, 10.0, kind)
        begin = round(LEAD_S / STEP_S)
        assert len(program.angles) == round(10.0 / STEP_S) + 2 * begin
        assert np.all(program.speeds[: begin - 200] == 0)
        assert np.all(np.abs(program.speeds) <= 1.1 * build.speed)
        assert np.all(np.abs(program.angles) <= build.limit)


def test_the_servos_follow() -> None:
    scenario = _made("null")
    inside = scenario.run.time >= 0
    missed = (scenario.run.angles - scenario.program.angles)[inside]
    swing = np.std(scenario.program.angles[inside], axis=0)
    # late by what the speed loop takes, not by more
    speeds = np.sqrt(np.mean(scenario.program.speeds[inside] ** 2, axis=0))
    assert np.all(np.sqrt(np.mean(missed**2, axis=0)) < 0.3 * swing + 0.15 * speeds)


def _newton_euler(urdf: str, names: tuple[str, ...], motion: tuple[Array, Array, Array], gravity: Array) -> Array:
    """Return the torques (m, n) of a URDF, from the base to the flange and back, link by link in their own frames.

    J. Y. S. Luh, M. W. Walker, R. P. C. Paul, On-line computational scheme for mechanical manipulators, 1980.
    """
    robot = Xml.fromstring(urdf)
    joints = {str(joint.get("name")): joint for joint in robot.findall("joint")}
    links = {str(link.get("name")): link for link in robot.findall("link")}

    def vector(element: Xml.Element | None, key: str) -> Array:
        assert element is not None
        return np.array([float(part) for part in str(element.get(key)).split()])

    out = []
    for angles, speeds, rises in zip(*motion, strict=True):
        spin, turn, rise = np.zeros(3), np.zeros(3), -gravity
        going = []
        for j, name in enumerate(names):
            joint = joints[name]
            origin, axis = joint.find("origin"), vector(joint.find("axis"), "xyz")
            child = links[str(joint.find("child").get("link"))]  # type: ignore[union-attr]
            slides = joint.get("type") == "prismatic"
            fixed = Rotation.from_euler("xyz", vector(origin, "rpy")).as_matrix()
            rotation = fixed if slides else fixed @ Rotation.from_rotvec(axis * angles[j]).as_matrix()
            place = vector(origin, "xyz") + (fixed @ axis * angles[j] if slides else 0.0)
            rise = rotation.T @ (rise + np.cross(turn, place) + np.cross(spin, np.cross(spin, place)))
            spin, turn = rotation.T @ spin, rotation.T @ turn
            if slides:
                rise = rise + axis * rises[j] + 2 * np.cross(spin, axis * speeds[j])
            else:
                turn = turn + axis * rises[j] + np.cross(spin, axis * speeds[j])
                spin = spin + axis * speeds[j]
            inertial = child.find("inertial")
            assert inertial is not None
            center = vector(inertial.find("origin"), "xyz")
            main = Rotation.from_euler("xyz", vector(inertial.find("origin"), "rpy")).as_matrix()
            entries = inertial.find("inertia").attrib  # type: ignore[union-attr]
            inertia = main @ np.diag([float(entries[key]) for key in ("ixx", "iyy", "izz")]) @ main.T
            mass = float(vector(inertial.find("mass"), "value")[0])
            force = mass * (rise + np.cross(turn, center) + np.cross(spin, np.cross(spin, center)))
            moment = inertia @ turn + np.cross(spin, inertia @ spin) + np.cross(center, force)
            going.append((rotation, place, axis, slides, force, moment))
        torque = np.zeros(len(names))
        force, moment = np.zeros(3), np.zeros(3)
        for j in range(len(names) - 1, -1, -1):
            rotation, place, axis, slides, own, own_moment = going[j]
            force, moment = force + own, moment + own_moment
            torque[j] = axis @ (force if slides else moment)
            force, moment = rotation @ force, rotation @ moment + np.cross(place, rotation @ force)
        out.append(torque)
    return np.array(out)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", BUILDS)
def test_the_urdf_asks_for_the_torques_of_the_robot_that_it_was_written_from(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    build = draw_build(rng, name)
    written = draw_written(rng, build)
    urdf = write_urdf(build, build.bodies, written, np.ones(build.joints))
    gravity = rng.standard_normal(3) * 5
    motion = (
        build.home + build.range * rng.uniform(-1, 1, (5, build.joints)),
        build.speed * rng.uniform(-1, 1, (5, build.joints)),
        3 * build.speed * rng.uniform(-1, 1, (5, build.joints)),
    )
    asked = dynamics.asked(dynamics.model(build, build.bodies, gravity), *motion)
    np.testing.assert_allclose(
        _newton_euler(urdf, written.names, motion, gravity), asked, atol=1e-6 * float(np.max(np.abs(asked)))
    )


def test_motors_make_what_the_urdf_asks_for_and_what_their_drives_take() -> None:
    made = (generate(seed, "null", "half", SHORT_S) for seed in range(31, 60))
    scenario = next(one for one in made if not one.robot.elastic)
    run, robot = scenario.run, scenario.robot
    few = slice(round(LEAD_S / STEP_S), -round(LEAD_S / STEP_S), 97)
    effort = np.ones(robot.build.joints)
    urdf = write_urdf(robot.build, robot.bodies(), scenario.written, effort)
    motion = run.angles[few], run.speeds[few], run.accelerations[few]
    carried = _newton_euler(urdf, scenario.written.names, motion, robot.gravity)
    takes = np.column_stack([drive.rotor * motion[2][:, j] for j, drive in enumerate(robot.drives)])
    for j, drive in enumerate(robot.drives):
        own = drive.friction
        speed, side = motion[1][:, j], run.side[few][:, j]
        rubbing = (own.dry + own.loss * np.abs(carried[:, j])) * side
        rubbing += own.viscous * np.sign(speed) * np.abs(speed) ** own.power
        takes[:, j] += rubbing * (1 + own.warming * run.time[few] / SHORT_S)
    torques = run.torques[few] * [drive.constant for drive in robot.drives]
    rated = np.array([drive.rated for drive in robot.drives])
    # what shakes the motors is not known here
    assert np.all(np.sqrt(np.mean((torques - carried - takes) ** 2, axis=0)) < 5e-3 * rated)


def test_the_same_seed_writes_the_same_files(tmp_path: Path) -> None:
    write(_made("payload"), tmp_path / "one")
    write(generate(31, "payload", "half", SHORT_S), tmp_path / "other")
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert {"robot.toml", "robot.urdf", "channels.toml", "log.csv"} <= set(files)
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("null", "payload")])
def test_what_is_hidden_is_at_one_joint_and_not_in_the_description(kind: str, tmp_path: Path) -> None:
    scenario = _made(kind)
    answer = scenario.answer()
    (hidden,) = answer["hidden"]
    json.dumps(answer)
    write(scenario, tmp_path)
    robot = tomllib.loads((tmp_path / "robot.toml").read_text())
    assert hidden["location"] in [joint["name"] for joint in robot["joints"]]
    axes = {joint["name"]: joint["axis"] for joint in robot["joints"] if "axis" in joint}
    absent = {"coulomb_friction": "coulomb_friction_n_m", "viscous_friction": "viscous_friction_n_m_s_per_rad"}
    for joint, file in axes.items():
        motor = tomllib.loads((tmp_path / file).read_text())["motor"]
        for mechanism, key in absent.items():
            assert (motor[key] == 0) == (kind == mechanism and joint == hidden["location"])


def test_what_is_there_and_nobody_hid_is_neither_right_nor_wrong() -> None:
    answer = {
        "hidden": [],
        "neutral": [{"mechanism": "load_dependent_loss", "location": "A2"}],
        "friction": {},
        "noise": {},
    }

    def said(location: str) -> str:
        finding = {"mechanism": "load_dependent_loss", "location": location, "probability": 0.9, "parameters": []}
        return judge(answer, {"verdict": "named", "findings": [finding]}).outcome

    assert said("A2") == "right"
    assert said("A1") == "invented"


def test_a_third_of_the_bank_hides_nothing() -> None:
    entries = plan(150, 3)
    assert {kind: sum(entry.kind == kind for entry in entries) for kind in KINDS} == SHARES
    assert 3 * SHARES["null"] == sum(SHARES.values()) == 150
