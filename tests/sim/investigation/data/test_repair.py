"""Rows that were never measured are left out and named; what an encoder slips by is put back."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import geared
from signals.telemetry import Telemetry
from sim.chain.model import Array
from sim.description.axis_document import read_axis
from sim.investigation.data.sample_defects import jumps, spikes
from sim.investigation.data.validation import Fault, examine

AXIS = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.15, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
        "stages": [{"name": "output", "ratio": 10, "stiffness_n_m_per_rad": 1e4}],
        "load": {"inertia_kg_m2": 15.0},
    }
)
GOOD = geared(0.15, 10.0, 15.0, 1e4, 1)
ROW = 6100
BODY = read_axis({"motor": {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0}, "load": {"inertia_kg_m2": 0.0}})


def faults(**channels: Array) -> tuple[Fault, ...]:
    return examine(AXIS, changed(**channels)).faults


def changed(**channels: Array) -> Telemetry:
    return replace(GOOD, channels={**GOOD.channels, **channels})


@pytest.mark.parametrize("slip", [2e-4, -1e-3, 2e-2])
def test_a_load_encoder_that_slips_is_named_and_put_back(slip: float) -> None:
    after = np.arange(GOOD.rows) >= ROW
    data_check = examine(AXIS, changed(load_position_rad=GOOD["load_position_rad"] + slip * after))
    (fault,) = data_check.faults
    assert (fault.mechanism, fault.location) == ("encoder_error", "load")
    assert fault.parameters["slip_rad"] == pytest.approx(slip, abs=2e-5)
    assert fault.parameters["time_s"] == pytest.approx(ROW / 1000)
    mended, whole = data_check.measurement.load_angle, examine(AXIS, GOOD).measurement.load_angle
    assert mended is not None
    assert whole is not None
    assert np.abs(mended - whole).max() < 2e-5


def test_a_motor_encoder_that_slips_is_told_from_the_load_s() -> None:
    after = np.arange(GOOD.rows) >= ROW
    (fault,) = faults(motor_position_rad=GOOD["motor_position_rad"] + 0.05 * after)
    assert (fault.mechanism, fault.location) == ("encoder_error", "motor")
    assert fault.parameters["slip_rad"] == pytest.approx(0.05, rel=0.01)


@pytest.mark.parametrize("gap", [2e-4, 2e-3])
def test_play_is_no_slip(gap: float) -> None:
    """The load follows one flank or the other, and crosses in 5 ms."""
    side = np.tanh(np.gradient(GOOD["motor_position_rad"]) * 1000 / 0.3)
    assert faults(load_position_rad=GOOD["load_position_rad"] - 0.5 * gap * side) == ()


def test_a_stick_of_hysteresis_and_a_slow_drift_are_no_slip() -> None:
    t = GOOD.time_s
    wound = np.tanh(np.gradient(GOOD["motor_position_rad"]) * 1000 / 20.0)
    assert faults(load_position_rad=GOOD["load_position_rad"] - 3e-4 * wound + 1e-4 * t / t[-1]) == ()


@pytest.mark.parametrize("size", [2.0, 500.0])
def test_single_values_of_the_torque_are_left_out_and_named(size: float) -> None:
    torque = GOOD["motor_torque_nm"].copy()
    rows = [2000, 5000, 7000, 9001]
    torque[rows] += size
    data_check = examine(AXIS, changed(motor_torque_nm=torque))
    (fault,) = data_check.faults
    assert (fault.mechanism, fault.location) == ("lost_samples", "motor")
    assert fault.parameters["fraction"] * GOOD.rows == pytest.approx(4)
    assert "4 rows" in fault.explanation
    assert "2 to 2.001, 5 to 5.001" in fault.explanation
    difference = data_check.measurement.torque - examine(AXIS, GOOD).measurement.torque
    assert np.abs(difference).max() < 0.5  # of 500, had it been smoothed


@pytest.mark.parametrize("rows", [20, 300, 900])
def test_a_torque_that_drops_to_zero_is_lost(rows: int) -> None:
    torque = GOOD["motor_torque_nm"].copy()
    torque[ROW : ROW + rows] = 0.0
    data_check = examine(AXIS, changed(motor_torque_nm=torque))
    (fault,) = data_check.faults
    assert (fault.mechanism, fault.location) == ("lost_samples", "motor")
    assert fault.parameters["fraction"] == pytest.approx(rows / GOOD.rows, abs=1.5 / GOOD.rows)  # one lies half in
    at = np.abs(data_check.measurement.time_s - (ROW + 0.5 * rows) / 1000) < 0.4 * rows / 1000
    assert not data_check.measurement.weight[at].any()


@pytest.mark.parametrize("channel", ["load_position_rad", "motor_position_rad"])
@pytest.mark.parametrize("zero", [True, False])
def test_an_encoder_that_stays_for_a_while_is_lost_and_has_not_slipped(channel: str, zero: bool) -> None:
    values = GOOD[channel].copy()
    fast = 1000 + int(np.argmax(np.gradient(values)[1000:-1000]))
    values[fast : fast + 60] = 0.0 if zero else values[fast]
    assert {f.mechanism for f in faults(**{channel: values})} == {"lost_samples"}


def test_a_motor_that_rests_has_not_lost_its_torque() -> None:
    """Standing with the drive off reads the same zero for long."""
    t = GOOD.time_s
    rests = (t > 5.0) & (t < 7.0)
    angle = np.where(rests, np.interp(5.0, t, GOOD["motor_position_rad"]), GOOD["motor_position_rad"])
    torque = np.where(rests, 0.0, GOOD["motor_torque_nm"])
    steps = np.concatenate([[0.0], np.where(rests[1:], 0.0, np.diff(GOOD["motor_position_rad"]))])
    whole = angle[0] + np.cumsum(steps)
    channels = {"motor_torque_nm": torque, "motor_position_rad": whole}
    assert all("motor_torque_nm" not in f.explanation for f in examine(AXIS, Telemetry(t, channels)).faults)


def test_noise_with_heavy_tails_and_knocks_that_ring_are_no_spikes() -> None:
    rng = np.random.default_rng(4)
    assert not spikes(rng.laplace(size=60_000)).any()
    after = np.arange(200.0)
    knock = np.exp(-after / 30) * np.sin(after * 0.8)
    noise = rng.standard_normal(20_000)
    noise[9000:9200] += 40 * knock
    assert not spikes(noise).any()


def test_a_change_of_speed_is_no_jump() -> None:
    """A collision changes the speed within one row, and the place goes on."""
    t = np.arange(4000) / 1000
    place = np.abs(t - 2.0) + 1e-6 * np.random.default_rng(5).standard_normal(t.size)
    good = np.ones(t.size, dtype=np.bool_)
    assert jumps(place, good) == ()
    ((row, size),) = jumps(place + 1e-3 * (t >= 3.0), good)
    assert row == 2999
    assert size == pytest.approx(2e-3, rel=0.02)


@pytest.mark.parametrize("hold", [True, False])
def test_short_runs_of_lost_rows_are_one_finding_of_their_true_share(hold: bool) -> None:
    """Also where the axis rests or creeps on a coarse encoder, and an even clock makes rounding out of its steps."""
    t, rng = GOOD.time_s, np.random.default_rng(4)
    angle = 8.0 * np.tanh(3.0 * np.sin(2.0 * t))  # creeps at both ends
    step = 2.0 * np.pi / 2**17
    torque = (
        0.3 * np.gradient(np.gradient(angle, t), t)
        + np.tanh(np.gradient(angle, t))
        + 0.05 * rng.standard_normal(t.size)
    )
    lost = np.zeros(t.size, dtype=np.bool_)
    while lost.mean() < 0.02:
        first = int(rng.integers(1, t.size - 20))
        lost[first : first + int(rng.integers(1, 9))] = True
    rows = np.maximum.accumulate(np.where(lost, 0, np.arange(t.size))) if hold else np.flatnonzero(~lost)
    channels = {"motor_torque_nm": torque[rows], "motor_position_rad": (np.round(angle / step) * step)[rows]}
    data_check = examine(BODY, Telemetry(t if hold else t[rows], channels))
    assert [(f.mechanism, f.location) for f in data_check.faults] == [("lost_samples", None)]
    assert data_check.faults[0].parameters["fraction"] == pytest.approx(float(lost.mean()), rel=0.1)
