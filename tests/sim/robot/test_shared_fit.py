"""What the joints share, on robots of which all is known: intervals hold, nothing is made up."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.robot_arms import Array, Link, random_arm, robot, swings, torque, with_mass
from sim.investigation.assessment.intervals import NINETY
from sim.robot.motion import Motion
from sim.robot.rigid_body import RigidBody
from sim.robot.shared_fit import LOAD_LOSS, SharedFit, built_up, shared_fits

DRAWS = 8
RATE = 25.0


@dataclass(frozen=True)
class Draw:
    """A fit with what is true: payload [kg], its centre [m], tilt [rad], delay [s], rigid torque, (rows, joints)."""

    fit: SharedFit
    mass: float
    center: Array
    tilt: float
    late: float
    rigid: Array


def off(rng: np.random.Generator, link: Link, share: float = 0.05) -> Link:
    """The link as it is, where its description is off by several percent of mass and of where that is."""
    x, y, z = np.array(link.center) + share * 0.15 * rng.normal(size=3)
    scale = 1.0 + share * rng.normal()
    return replace(link, mass=link.mass * scale, inertia=link.inertia * scale, center=(float(x), float(y), float(z)))


def log(
    rng: np.random.Generator, links: Sequence[Link], gravity: Array, gains: Array, late: float
) -> tuple[Motion, Array]:
    """Measured with dry and viscous friction, rotors, noise; the rigid torque beside it."""
    time, q, qd, qdd = swings(rng, len(links), 12.0, RATE)
    rigid = torque(links, q, qd, qdd, tuple(gravity))
    rigid -= late * np.gradient(rigid, axis=0) * RATE
    dry = rigid + 2.0 * np.tanh(qd / 0.03 / np.abs(qd).max(axis=0)) + 1.5 * qd + 0.5 * qdd
    felt = gains * (dry + 0.05 * rng.normal(size=q.shape))
    rows, joints = np.ones(time.size, dtype=np.bool_), np.ones(len(links), dtype=np.bool_)
    return Motion(time, RATE, q, qd, qdd, felt, rows, joints), rigid


@cache
def draw(seed: int, mass: float) -> Draw:
    rng = np.random.default_rng(seed)
    described = random_arm(rng, 3)
    actual = [off(rng, link) for link in described]
    center = 0.1 * rng.normal(size=3)
    tilt, late = 0.02 * rng.normal(size=2), 0.005 * rng.normal()
    gravity = 9.81 * np.array([tilt[0], tilt[1], -1.0])
    gains = 1.0 + 0.05 * rng.normal(size=3)
    motion, rigid = log(rng, with_mass(actual, mass, center) if mass else actual, gravity, gains, late)
    one = robot(described)
    (fit,) = shared_fits(one, RigidBody.of(one), [motion])
    return Draw(fit, mass, center, float(np.linalg.norm(tilt)), late, gains * rigid)


def draws(mass: float) -> list[Draw]:
    return [draw(seed, mass) for seed in range(DRAWS if mass else DRAWS // 2)]


def share(inside: Sequence[bool]) -> float:
    return float(np.mean(inside))


LEAST = 0.75  # of 8 intervals of 90 %: fewer have a chance of 4 %


def test_intervals_of_the_payload_hold() -> None:
    fits = [(d, d.fit.payload) for d in draws(2.0)]
    assert share([abs(p.mass_kg - d.mass) < NINETY * p.mass_deviation_kg for d, p in fits]) >= LEAST
    moments = [abs(p.numbers[1:] - d.mass * d.center) < NINETY * np.sqrt(np.diag(p.covariance)[1:]) for d, p in fits]
    assert np.mean(moments) >= LEAST


def test_no_payload_is_made_up_of_masses_that_are_off() -> None:
    assert sum(d.fit.payload.probability >= 0.5 for d in draws(0.0)) == 0


def test_what_the_other_joints_say_of_a_joint_is_as_good_as_it_says() -> None:
    inside = []
    for d in [*draws(0.0), *draws(2.0)]:
        for joint, errors in enumerate(d.fit.errors):
            wrong = d.fit.known[:, joint] - d.rigid[:, joint]
            inside.append(float(np.mean(np.abs(wrong) < NINETY * np.sqrt(np.sum(errors**2, axis=1)))))
    assert np.mean(inside) >= LEAST


def test_the_tilt_of_the_base_is_found_beside_a_payload() -> None:
    """A payload tilts with the base: what both do together is neither's alone."""
    wrong = [abs(float(np.linalg.norm(d.fit.tilt_rad)) - d.tilt) for d in draws(2.0)]
    assert np.median(wrong) < 0.2 * np.median([d.tilt for d in draws(2.0)])


def test_a_log_without_payload_beside_it_narrows_the_payload() -> None:
    rng = np.random.default_rng(1)
    described = random_arm(rng, 3)
    actual = [off(rng, link) for link in described]
    gravity, gains = np.array([0.0, 0.0, -9.81]), np.ones(3)
    empty, _ = log(rng, actual, gravity, gains, 0.0)
    loaded, _ = log(rng, with_mass(actual, 2.0, np.array([0.05, 0.0, 0.1])), gravity, gains, 0.0)
    one = robot(described)
    body = RigidBody.of(one)
    (alone,) = shared_fits(one, body, [loaded])
    first, beside = shared_fits(one, body, [empty, loaded])
    assert beside.payload.mass_deviation_kg < 0.5 * alone.payload.mass_deviation_kg
    assert abs(beside.payload.mass_kg - 2.0) < 2.0 * NINETY * beside.payload.mass_deviation_kg
    assert first.payload.probability < 0.5 < beside.payload.probability


def test_without_weight_a_payload_is_told_by_its_inertia() -> None:
    rng = np.random.default_rng(2)
    links = random_arm(rng, 3)
    one = robot(links, gravity=(0.0, 0.0, 0.0))
    motion, _ = log(rng, with_mass(links, 4.0, np.array([0.1, 0.0, 0.2])), np.zeros(3), np.ones(3), 0.0)
    (fit,) = shared_fits(one, RigidBody.of(one), [motion])
    assert abs(fit.payload.mass_kg - 4.0) < 2.0 * NINETY * fit.payload.mass_deviation_kg
    assert not fit.tilt_rad.any()


def test_what_a_load_that_stays_the_same_loses_is_friction_as_felt() -> None:
    """Of a vertical slide dry friction would else be a doubt about the gear, and nothing would be said of it."""
    slide = [Link((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 6.0, (0.0, 0.0, 0.1), 0.02 * np.eye(3), slides=True)]
    motion, _ = log(np.random.default_rng(4), slide, np.array([0.0, 0.0, -9.81]), np.ones(1), 0.0)
    one = robot(slide)
    (fit,) = shared_fits(one, RigidBody.of(one), [motion])
    way, lost = np.sign(motion.speed[:, 0]), fit.errors[0][:, -1]
    assert abs(np.mean(lost * way)) < 0.05 * LOAD_LOSS * 6.0 * 9.81
    assert np.std(lost) > 0.0


def alone(seed: int, at: int, **own: float) -> tuple[Motion, Array, SharedFit]:
    """An arm as described of which one joint has something that no other feels; its log, rigid torque and fit.

    `late`: its torque comes later [s]; `weight`: what pulls at it along its own angle [N m].
    """
    rng = np.random.default_rng(seed)
    links = random_arm(rng, 3)
    motion, rigid = log(rng, links, np.array([0.0, 0.0, -9.81]), np.ones(3), 0.0)
    felt = motion.torque.copy()
    felt[:, at] += own.get("weight", 0.0) * np.sin(motion.position[:, at])
    felt[:, at] = np.interp(motion.time_s - own.get("late", 0.0), motion.time_s, felt[:, at])
    motion = replace(motion, torque=felt)
    one = robot(links)
    (fit,) = shared_fits(one, RigidBody.of(one), [motion])
    return motion, rigid, fit


def test_friction_that_builds_up_after_a_reversal_is_no_delay_and_no_mass() -> None:
    """A curve over the speed alone left a delay of 10 to 26 ms of it."""
    rng = np.random.default_rng(4)
    links = random_arm(rng, 3)
    motion, rigid = log(rng, links, np.array([0.0, 0.0, -9.81]), np.ones(3), 0.0)
    dry = np.stack([built_up(q, 2e-3) for q in motion.position.T], axis=1)
    felt = rigid + 3.0 * dry + 1.5 * motion.speed + 0.5 * motion.acceleration + 0.05 * rng.normal(size=rigid.shape)
    one = robot(links)
    (fit,) = shared_fits(one, RigidBody.of(one), [replace(motion, torque=felt)])
    assert fit.payload.probability < 0.5
    for joint, errors in enumerate(fit.errors):
        wrong = np.sqrt(np.mean((fit.known[:, joint] - rigid[:, joint]) ** 2))
        assert wrong < 2.0 * NINETY * np.sqrt(np.mean(np.sum(errors**2, axis=1)))


def test_the_torque_of_one_joint_alone_is_late() -> None:
    _, _, fit = alone(5, 1, late=0.02)
    assert [one.probability > 0.5 for one in fit.late] == [False, True, False]
    assert abs(fit.late[1].delay_s - 0.02) < 0.01
    _, _, fit = alone(5, 1)
    assert not any(one.probability > 0.5 for one in fit.late)


def test_a_weight_at_one_joint_alone_does_not_mislead_the_others() -> None:
    _, rigid, fit = alone(6, 0, weight=20.0)
    for joint in (1, 2):
        wrong = np.sqrt(np.mean((fit.known[:, joint] - rigid[:, joint]) ** 2))
        assert wrong < 2.0 * NINETY * np.sqrt(np.mean(np.sum(fit.errors[joint] ** 2, axis=1)))
