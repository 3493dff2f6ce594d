"""The next motion keeps its limits, and its log tells more than another of the present motion."""

from pathlib import Path

import numpy as np
import pytest

from sim.robot.investigation import investigate_robot
from sim.robot.log import read_log
from sim.robot.next_motion import next_motion
from sim.robot.robot import read_robot
from sim.robot.trajectory import Harmonics, Limits, Trajectory
from tests.sim.robot.arms import (
    Array,
    channel_map,
    swings,
    torque,
    two_links,
    with_mass,
    write_log,
    write_robot,
)

ARM, NOISE_NM = two_links(), 0.05


@pytest.mark.parametrize("seed", range(5))
def test_a_motion_is_from_rest_to_rest_within_its_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, width = rng.uniform(-3.0, 0.0, 3), np.array([2.0, 0.5, 0.0])  # the last was held
    speed, acceleration = rng.uniform(0.3, 3.0, (2, 3))
    drawn = Limits(("a", "b", "c"), low, low + width, speed, acceleration).drawn(rng, 12.0)
    way = drawn.trajectory()
    assert way.time_s[[0, -1]].tolist() == [0.0, 12.0]
    for ends in (way.speed[[0, -1]], way.acceleration[[0, -1]]):
        assert ends == pytest.approx(np.zeros((2, 3)), abs=1e-12)
    assert np.all((way.position >= low - 1e-9) & (way.position <= low + width + 1e-9))
    assert np.all(np.abs(way.speed) <= speed * (1 + 1e-9))
    assert np.all(np.abs(way.acceleration) <= acceleration * (1 + 1e-9))
    assert np.ptp(way.position[:, 2]) == 0.0
    for each, rate in ((way.position, way.speed), (way.speed, way.acceleration)):
        assert np.gradient(each, way.time_s, axis=0)[1:-1] == pytest.approx(rate[1:-1], abs=0.01 * np.abs(rate).max())
    again = Harmonics.of_document(drawn.document()).trajectory()
    assert again.position == pytest.approx(way.position, abs=1e-5)
    head, first, *rest = way.csv().splitlines()
    assert head == "time_s,a/position,b/position,c/position,a/velocity,b/velocity,c/velocity"
    assert np.array(first.split(","), dtype=float)[1:4] == pytest.approx(way.position[0], abs=1e-6)
    assert len(rest) == 1200


def felt(q: Array, v: Array, a: Array) -> Array:
    """Torque of the arm with friction and rotors."""
    return torque(ARM, q, v, a) + 2.0 * np.tanh(v / 0.03) + 1.5 * v + 0.5 * a


def known_after(*motions: tuple[Array, Array, Array]) -> Array:
    """Deviations of dry and viscous friction of both joints and of a payload, by least squares over logs of motions.

    Beside them rotors, offsets and 5 % of each link's mass are unknown; all by differences of the equations of motion.
    """
    information = np.diag([0.0] * 8 + [1.0, 1.0] + [0.0])
    for q, v, a in motions:
        asked = torque(ARM, q, v, a)
        columns = []
        for joint in range(2):
            for shape in (np.tanh(v / 0.03), v, a, np.ones_like(v)):
                columns.append(np.where(np.arange(2) == joint, shape, 0.0))
        for k, link in enumerate(ARM):
            heavier = [*ARM]
            heavier[k] = type(link)(link.origin, link.axis, 1.05 * link.mass, link.center, 1.05 * link.inertia)
            columns.append(torque(heavier, q, v, a) - asked)
        columns.append((torque(with_mass(ARM, 0.1, np.array([0.3, 0.0, 0.0])), q, v, a) - asked) / 0.1)
        table = np.stack(columns, axis=-1).reshape(-1, len(columns)) / NOISE_NM
        information = information + table.T @ table
    return np.sqrt(np.diag(np.linalg.inv(information)))[[0, 1, 4, 5, 10]]


@pytest.fixture
def log(tmp_path: Path) -> tuple[Path, Path, tuple[Array, Array, Array]]:
    rng = np.random.default_rng(3)
    time, *motion = swings(rng, 2, 12.0, 100.0, size=0.3)
    measured = felt(*motion) + NOISE_NM * rng.normal(size=motion[0].shape)
    return write_robot(tmp_path, ARM), write_log(tmp_path / "log.csv", time, motion[0], measured), tuple(motion)


def test_its_log_narrows_intervals_more_than_another_of_the_present_motion(
    log: tuple[Path, Path, tuple[Array, Array, Array]],
) -> None:
    """Held against least squares of equations of motion that share nothing with the product."""
    robot = read_robot(log[0])
    found = next_motion(investigate_robot(robot, [read_log(robot, log[1], channel_map(2))]))
    assert found is not None
    assert found.gain > 0.0
    way: Trajectory = found.motion.trajectory()
    new, again = (known_after(log[2], motion) for motion in ((way.position, way.speed, way.acceleration), log[2]))
    assert way.time_s[-1] == pytest.approx(12.0)
    assert np.mean(np.log(new / again)) < 0.0
