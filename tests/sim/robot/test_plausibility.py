"""A log that is not of the robot described is refused with what would fit, and no log that is."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from benchmarks.robot_arms import Array, Link, random_arm, robot, swings, torque, two_links, with_mass
from sim.investigation.data.data_fault import InvestigationError
from sim.robot.motion import Motion
from sim.robot.plausibility import check_joints, check_robot
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Payload, Robot

LINKS = [
    Link((0.0, 0.0, 0.3), (0.0, 0.0, 1.0), 6.0, (0.0, 0.02, 0.05), 0.02 * np.eye(3)),
    *two_links(),
    Link((0.3, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, (0.0, 0.08, 0.0), 0.002 * np.eye(3)),
]


def moved(links: list[Link] = LINKS, seed: int = 1) -> Motion:
    _, q, qd, qdd = swings(np.random.default_rng(seed), len(links), 10.0, 25.0)
    felt = torque(links, q, qd, qdd) + 1.0 * np.tanh(qd / 0.03) + 0.5 * qd + 0.2 * qdd
    rows = np.ones(len(q), dtype=np.bool_)
    return Motion(np.arange(len(q)) / 25.0, 25.0, q, qd, qdd, felt, rows, np.ones(len(links), dtype=np.bool_))


def check(motion: Motion, one: Robot | None = None) -> None:
    one = robot(LINKS) if one is None else one
    check_robot(one, RigidBody.of(one), motion)


def ordered(motion: Motion, order: list[int]) -> Motion:
    ways = {name: getattr(motion, name)[:, order] for name in ("position", "speed", "acceleration", "torque")}
    return replace(motion, **ways)


def signed(motion: Motion, signs: Array) -> Motion:
    return replace(motion, torque=motion.torque * signs)


@pytest.mark.parametrize("seed", range(4))
def test_a_log_of_the_robot_is_taken_with_masses_that_are_off_and_what_hangs_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    off = [replace(link, mass=link.mass * (1.0 + 0.05 * rng.normal())) for link in LINKS]
    check(moved(off, seed))
    check(moved(with_mass(off, 2.0, np.array([0.05, 0.0, 0.1])), seed))
    check(moved(off, seed), robot(LINKS, payload=Payload(2.0, (0.05, 0.0, 0.1))))
    check(moved(seed=seed), robot(LINKS, gravity=(0.17, 0.0, -9.81)))  # a base that is levelled by the eye


@pytest.mark.parametrize("slides", [(), (0,), (1, 2)])
def test_a_log_of_any_arm_is_taken(slides: tuple[int, ...]) -> None:
    links = random_arm(np.random.default_rng(5), 4, slides)
    check(moved(links), robot(links))
    check(moved(with_mass(links, 2.0, np.array([0.05, 0.0, 0.1]))), robot(links))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (partial(ordered, order=[3, 2, 1, 0]), "in another order they are: joint4, joint3, joint2, joint1"),
        (partial(ordered, order=[0, 2, 1, 3]), "in another order they are: joint1, joint3, joint2, joint4"),
        (partial(signed, signs=np.array([1.0, -1.0, 1.0, 1.0])), "turn the factor of joint2 in the map"),
        (partial(signed, signs=-np.ones(4)), "with the other sign they are: turn the factor of "),
        (lambda m: replace(m, **{w: np.degrees(getattr(m, w)) for w in ("position", "speed", "acceleration")}), "URDF"),
    ],
)
def test_a_refusal_says_what_would_fit(change: partial[Motion], said: str) -> None:
    with pytest.raises(InvestigationError) as refused:
        check(change(moved()))
    assert said in str(refused.value)


def test_a_robot_on_the_ceiling_is_said() -> None:
    with pytest.raises(InvestigationError, match=r"gravity_m_s2 = \[-?0\.\d+, -?0\.\d+, -9\.8"):
        check(moved(), robot(LINKS, gravity=(0.0, 0.0, 9.81)))


@pytest.mark.parametrize("payload", [0.0, 2.0])
def test_a_base_that_was_mounted_askew_is_said_and_one_that_is_levelled_badly_is_not(payload: float) -> None:
    """Gravity of a base that leans by an angle about y, on joints whose torques no other masses would make."""
    links = with_mass(LINKS, payload, np.array([0.05, 0.0, 0.1])) if payload else LINKS
    leaning = {a: (9.81 * np.sin(np.radians(a)), 0.0, -9.81 * np.cos(np.radians(a))) for a in (4.0, 30.0)}
    check(moved(links), robot(LINKS, gravity=leaning[4.0]))
    with pytest.raises(InvestigationError, match=r"gravity_m_s2 = \[-?0\.\d+, -?0\.\d+, -9\.8"):
        check(moved(links), robot(LINKS, gravity=leaning[30.0]))


def test_the_urdf_of_another_robot_is_refused() -> None:
    other = random_arm(np.random.default_rng(9), 4)
    with pytest.raises(InvestigationError, match="may be of another robot"):
        check(moved(), robot([replace(link, mass=5.0 * link.mass) for link in other]))


def test_a_joint_of_which_nobody_says_where_it_was_is_refused_with_what_would_say_it() -> None:
    whole = robot(LINKS)
    lacking = replace(whole, joints=whole.joints[:-1])
    with pytest.raises(InvestigationError) as refused:
        check_joints(lacking, RigidBody.of(lacking))
    text = str(refused.value)
    assert "where these joints of the URDF are: joint4. The torques of all logged joints depend on" in text
    assert text.endswith('[[held]]\nname = "joint4"\nposition_rad = ...')
    for known in (whole, replace(lacking, held={"joint4": 0.0})):
        check_joints(known, RigidBody.of(known))


def test_a_joint_that_carries_next_to_nothing_refuses_no_log() -> None:
    """Two centimetres of the centre of its link turn all that it asks for; so far links of a description may be off."""
    described, real = (
        [*LINKS[:-1], replace(LINKS[-1], center=(0.0, off, 0.0), inertia=1e-4 * np.eye(3))] for off in (0.01, -0.01)
    )
    motion, one = moved(real), robot(described)
    few = slice(None, None, 5)
    rigid = RigidBody.of(one).torque(motion.position[few], motion.speed[few], motion.acceleration[few])[:, -1]
    assert np.corrcoef(rigid, torque(real, motion.position, motion.speed, motion.acceleration)[few, -1])[0, 1] < -0.5
    check(motion, one)


def test_what_friction_holds_at_rest_is_no_sign_of_another_robot() -> None:
    """Each joint moves in its turn and stands the rest of the time: there its friction takes what its load asks for."""
    motion = moved()
    count = len(LINKS)
    turn = np.arange(len(motion.time_s)) * count // len(motion.time_s)
    moves = turn[:, None] == np.arange(count)
    still = {name: getattr(motion, name) * moves for name in ("speed", "acceleration")}
    position = np.where(moves, motion.position, motion.position[:1])
    asked = torque(LINKS, position, still["speed"], still["acceleration"])
    own = 3.0 * np.tanh(still["speed"] / 0.03) + 0.5 * still["speed"] + 0.2 * still["acceleration"]
    held = np.random.default_rng(3).uniform(-3.0, 3.0, (1, count)) * ~moves
    resting = replace(motion, position=position, torque=np.where(moves, asked + own, asked + held), **still)
    check(resting)
    with pytest.raises(InvestigationError):
        check(ordered(resting, [1, 0, 2, 3]))
