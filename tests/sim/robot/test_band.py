"""Noise of encoders in accelerations, which makes inertias seem smaller than they are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from casebase.signals.telemetry import Telemetry
from sim.robot.band import Band
from sim.robot.motion import Motion
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Robot
from sim.robot.shared_fit import shared_fits
from tests.sim.robot.arms import Array, random_arm, robot, swings, torque
from tests.sim.robot.test_shared_fit import off

RATE = 125.0
SWINGS_HZ = 0.5  # the fastest of five harmonics
COARSE_RAD = 40e-6  # of an encoder
DRAWS = 4


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


def wrong(one: Robot, motion: Motion, rigid: Array) -> tuple[list[float], list[float]]:
    """Of each joint: rms error of what the others say of its torque [N m], and the largest in deviations of what it is
    said to be, of all directions in which it may be wrong."""
    (fit,) = shared_fits(one, RigidBody.of(one), [motion])
    rms, far = [], []
    for joint in range(3):
        error = (fit.known[:, joint] - rigid[:, joint])[motion.counts]
        ways, size, _ = np.linalg.svd(fit.errors[joint][motion.counts, :-1], full_matrices=False)
        there = size > 0.05 * size[0]
        rms.append(float(np.sqrt(np.mean(error**2))))
        far.append(float(np.max(np.abs(ways.T @ error / size)[there])))
    return rms, far


def test_the_band_ends_where_noise_drowns_the_motion() -> None:
    for encoder_rad, most_hz in ((COARSE_RAD, 3.0), (0.1 * COARSE_RAD, 6.0), (0.0, np.inf)):
        one, motion, _ = log(0, encoder_rad)
        band = Band.of(RigidBody.of(one), motion)
        assert SWINGS_HZ < band.cut_hz <= min(most_hz, motion.cut_hz)
        assert (band.stride == 0) == (encoder_rad == 0.0)


def test_noise_of_encoders_bends_no_masses() -> None:
    """Taken for motion, it left errors of up to ten of their deviations; without it there is less than half."""
    better, distances = [], []
    for seed in range(DRAWS):
        one, motion, rigid = log(seed, COARSE_RAD)
        rms, far = wrong(one, motion, rigid)
        as_motion, _ = wrong(one, replace(motion, acceleration_noise=np.zeros((0, 0))), rigid)
        better.append(np.array(rms) / np.array(as_motion))
        distances += far
    assert np.median(better) < 0.5
    assert np.max(distances) < 4.0


@pytest.mark.parametrize("harmonic", [1, 5])
def test_what_is_slower_passes_the_band_as_it_is(harmonic: int) -> None:
    band = Band(2.0, 62.5, 7)
    time = np.arange(1500) / 62.5
    wave = np.sin(2.0 * np.pi * 0.1 * harmonic * time)
    inside = slice(20, -20)
    np.testing.assert_allclose(band.smooth(wave)[inside], wave[:: band.stride][inside], atol=0.01)
    fast = np.sin(2.0 * np.pi * 8.0 * time)
    assert np.abs(band.smooth(fast)[inside]).max() < 0.01
