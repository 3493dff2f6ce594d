"""A simulated measurement: what a drive and a microphone would give, the same for the same seed."""

import numpy as np
import pytest
from scipy.signal import butter, find_peaks, sosfiltfilt

from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.chain.motion_profile import back_and_forth
from sim.errors import SimulationError
from sim.experiment.virtual_measurement import TELEMETRY_RATE_HZ, Measurement, measure
from sim.mechanisms import Backlash, BearingDefect, ToothDamage, TorqueOffset
from sim.mechanisms.catalogue import with_mechanism
from tests.sim.axes import axis

SECONDS = 9.6  # four cycles


@pytest.fixture(scope="module")
def normal() -> Measurement:
    return measure(axis(), SECONDS, 1)


def _low(measured: Measurement) -> np.ndarray:
    """The sound below 200 Hz, as the paper listens."""
    return np.asarray(sosfiltfilt(butter(4, 200.0, fs=SAMPLE_RATE_HZ, output="sos"), measured.sound))


def _crest(measured: Measurement) -> float:
    low = _low(measured)
    return float(np.abs(low).max() / np.sqrt(np.mean(low**2)))


def test_the_load_follows_its_motion(normal: Measurement) -> None:
    telemetry, motion = normal.telemetry, axis().motion
    assert telemetry.sample_rate_hz == pytest.approx(TELEMETRY_RATE_HZ)
    wanted = back_and_forth(
        telemetry.time_s, motion.period_s, motion.load_speed_rad_s, motion.acceleration_time_s, motion.dwell_s
    )
    assert np.abs(telemetry["load_position_rad"] - wanted[0]).max() < 0.02 * np.ptp(wanted[0])
    np.testing.assert_allclose(telemetry["reference_position_rad"], 99.0 * wanted[0], atol=1e-9)


def test_the_profile_is_the_integral_of_its_speed_and_acceleration() -> None:
    t = np.linspace(0.0, 7.0, 70001)
    angle, speed, acceleration = back_and_forth(t, 2.4, 2.5, 0.25, 0.1)
    np.testing.assert_allclose(np.gradient(angle, t)[1:-1], speed[1:-1], atol=2e-3)
    np.testing.assert_allclose(np.gradient(speed, t)[1:-1], acceleration[1:-1], atol=2e-2)
    assert np.ptp(angle) == pytest.approx(2.5 * (1.2 - 0.1 - 0.25))


def test_newton_holds_in_the_telemetry(normal: Measurement) -> None:
    """Torque on the load less its friction accelerates its inertia."""
    telemetry, load = normal.telemetry, axis().load
    speed = telemetry["load_speed_rad_s"]
    net = telemetry["shaft_torque_nm"] - load.viscous_friction_n_m_s_per_rad * speed
    net -= load.coulomb_friction_n_m * np.sign(speed)
    acceleration = np.gradient(speed, telemetry.time_s)
    fast = np.abs(speed) > 0.2
    error = (net - load.inertia_kg_m2 * acceleration)[fast]
    assert np.sqrt(np.mean(error**2)) < 0.01 * np.sqrt(np.mean(net[fast] ** 2))


def test_a_notch_is_heard_once_per_cycle_and_play_at_every_reversal(normal: Measurement) -> None:
    """The paper's figures 5 to 7: both raise the crest factor; a notch comes half as often as play."""
    notch = measure(with_mechanism(axis(), ToothDamage("output", {"angle_rad": 1.2, "depth_rad": 2e-3})), SECONDS, 1)
    play = measure(with_mechanism(axis(), Backlash("output", {"gap_rad": 4e-3})), SECONDS, 1)
    assert _crest(notch) > 1.5 * _crest(normal)
    assert _crest(play) > 1.5 * _crest(normal)
    added = {}
    for name, each in (("notch", notch), ("play", play)):
        change = np.abs(_low(each) - _low(normal))
        peaks, _ = find_peaks(change, height=0.5 * change.max(), distance=int(0.5 * SAMPLE_RATE_HZ))
        added[name] = peaks[(peaks > 0.3 * SAMPLE_RATE_HZ) & (peaks < SAMPLE_RATE_HZ * 7.2)] / SAMPLE_RATE_HZ
    np.testing.assert_allclose(np.diff(added["notch"]), 2.4, atol=0.03)
    assert added["notch"].size == 3
    assert added["play"].size >= 6


def test_effects_of_the_measurement_reach_telemetry_and_leave_the_machine(normal: Measurement) -> None:
    offset = measure(with_mechanism(axis(), TorqueOffset("motor", {"torque_n_m": 0.5})), SECONDS, 1)
    change = offset.telemetry["motor_torque_nm"] - normal.telemetry["motor_torque_nm"]
    np.testing.assert_allclose(change, 0.5, atol=1e-12)
    assert offset.sound.tobytes() == normal.sound.tobytes()


def test_a_bearing_is_heard_at_its_order(normal: Measurement) -> None:
    """Between reversals the motor turns evenly: the change of the sound has lines at multiples of the order."""
    defect = measure(with_mechanism(axis(), BearingDefect("motor", {"order": 5.3, "torque_n_m": 0.2})), SECONDS, 1)
    cruise = slice(int(0.5 * SAMPLE_RATE_HZ), int(0.9 * SAMPLE_RATE_HZ))
    change = (defect.sound - normal.sound)[cruise].astype(np.float64)
    spectrum = np.abs(np.fft.rfft(change * np.hanning(change.size), 1 << 16))
    frequency = np.argmax(spectrum) * SAMPLE_RATE_HZ / (1 << 16)
    turns = 2.5 * 99.0 / (2 * np.pi)
    harmonic = frequency / (5.3 * turns)
    assert harmonic == pytest.approx(round(harmonic), abs=0.03)


@pytest.mark.parametrize("duration", [0.0, -1.0, 1e9, float("nan"), float("inf")])
def test_a_duration_that_cannot_be_is_refused_before_any_work(duration: float) -> None:
    with pytest.raises(SimulationError, match="duration_s"):
        measure(axis(), duration)
