"""Noise of encoders in accelerations, which makes inertias seem smaller than they are."""

import numpy as np
from scipy.signal import lfilter

from benchmarks.robot_arms import Array, random_arm, robot, swings, torque
from signals.telemetry import Telemetry
from sim.robot.motion import Motion
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot
from sim.robot.shared_fit import shared_fits
from tests.sim.robot.test_shared_fit import off

RATE = 125.0
COARSE_RAD = 40e-6  # of an encoder


def log(seed: int, encoder_rad: float) -> tuple[Robot, Motion, Array]:
    """Torques with noise below 2 Hz, positions with noise of the encoders, masses off; the rigid torque of each row."""
    rng = np.random.default_rng(seed)
    described = random_arm(rng, 3)
    time, q, qd, qdd = swings(rng, 3, 24.0, RATE)
    rigid = torque([off(rng, link) for link in described], q, qd, qdd)
    slow = lfilter([1.0], [1.0, -np.exp(-4.0 * np.pi / RATE)], rng.normal(size=q.shape), axis=0)
    noise = 0.3 * slow / slow.std() + 0.1 * rng.normal(size=q.shape)
    felt = rigid + 2.0 * np.tanh(qd / 0.03 / np.abs(qd).max(axis=0)) + 1.5 * qd + 0.5 * qdd + noise
    seen = q + encoder_rad * rng.normal(size=q.shape)
    channels = [{"motor_position_rad": seen[:, j], "motor_torque_nm": felt[:, j]} for j in range(3)]
    one = robot(described)
    motion = Motion.of(one, [Telemetry(time, each) for each in channels])
    return one, motion, np.stack([np.interp(motion.time_s, time, each) for each in rigid.T], axis=1)


def wrong(one: Robot, motion: Motion, rigid: Array) -> list[float]:
    """Of each joint the error of what the others say of its torque, in deviations, the largest of all directions."""
    (fit,) = shared_fits(one, RigidBody.of(one), [motion])
    far = []
    for joint in range(3):
        error = (fit.known[:, joint] - rigid[:, joint])[motion.counts]
        ways, size, _ = np.linalg.svd(fit.errors[joint][motion.counts, :-1], full_matrices=False)
        there = size > 0.05 * size[0]
        far.append(float(np.max(np.abs(ways.T @ error / size)[there])))
    return far


def test_noise_of_encoders_bends_no_masses() -> None:
    """Made white, it left errors of up to ten of their deviations."""
    assert max(far for seed in range(4) for far in wrong(*log(seed, COARSE_RAD))) < 4.0
