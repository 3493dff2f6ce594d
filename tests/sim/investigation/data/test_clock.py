"""A record over an even clock: what was measured stays, what was logged again goes, what is missing is marked."""

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import one_body
from signals.telemetry import Telemetry
from sim.investigation.data.validation import evened

GOOD = one_body(0.3, 1.0, 0.0, 1)


def rows_of(t: Telemetry, rows: np.ndarray, time_s: np.ndarray | None = None) -> Telemetry:
    return Telemetry(t.time_s[rows] if time_s is None else time_s, {k: v[rows] for k, v in t.channels.items()})


def test_rows_of_an_even_clock_stay_to_the_last_digit_and_those_that_are_missing_are_marked() -> None:
    kept = np.delete(np.arange(GOOD.rows), np.arange(5, 9000, 9))
    record = evened(rows_of(GOOD, kept, 1764165785.0 + np.round(GOOD.time_s[kept], 6)))
    assert np.array_equal(np.flatnonzero(record.measured), kept)
    assert record.remarks == ()
    for name, values in record.telemetry.channels.items():
        np.testing.assert_array_equal(values[kept], GOOD[name][kept])


def test_rows_that_come_in_bursts_are_interpolated_at_their_median_interval() -> None:
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.choice([0.002, 0.03, 0.05], 2000))
    record = evened(Telemetry(time, {"motor_position_rad": np.sin(0.5 * time)}))
    clock = record.telemetry.time_s
    assert record.telemetry.interval_s == pytest.approx(0.03, rel=1e-6)
    assert np.abs(record.telemetry["motor_position_rad"] - np.sin(0.5 * (time[0] + clock))).max() < 1e-4
    assert record.measured.all()
    assert "interpolated every 30 ms" in record.remarks[0]


def test_rows_far_from_any_that_was_measured_do_not_count() -> None:
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.01, 0.03, 1000))
    time[600:] += 0.5
    record = evened(Telemetry(time, {"motor_position_rad": np.sin(time)}))
    gone = record.telemetry.time_s[~record.measured] + time[0]
    assert time[599] < gone.min()
    assert gone.max() < time[600]
    assert gone.size > 15


@pytest.mark.parametrize("scatter_s", [0.0, 5e-4])
@pytest.mark.parametrize("asked", [1.4, 2.0, 6.0])
def test_a_packet_that_is_logged_again_is_left_out_wherever_the_axis_moves(asked: float, scatter_s: float) -> None:
    """A recorder that asks so many times as often as packets come, by a clock that is even or not."""
    rng = np.random.default_rng(6)
    packet = (np.floor(np.arange(GOOD.rows) / asked) * asked).astype(np.int64)
    record = evened(rows_of(GOOD, packet, GOOD.time_s + rng.uniform(0.0, scatter_s, GOOD.rows)))
    assert record.repeated == pytest.approx(GOOD.rows * (1.0 - 1.0 / asked), rel=0.01)
    assert record.measured.mean() > 0.99
    off = record.telemetry["motor_position_rad"] - np.interp(
        record.telemetry.time_s, GOOD.time_s, GOOD["motor_position_rad"]
    )
    assert np.ptp(off) < 0.15  # 60 rad/s, and a packet may be a row and a half old
    assert "the same packet" in record.remarks[0]


def test_an_axis_at_rest_repeats_its_rows() -> None:
    time = np.arange(4000) / 500.0
    angle = np.round(np.clip(3.0 * np.sin(time), -1.0, 1.0), 4)
    record = evened(Telemetry(time, {"motor_position_rad": angle, "motor_torque_nm": np.gradient(angle)}))
    assert record.repeated == 0
    assert record.measured.all()


@pytest.mark.parametrize("late", [True, False])
def test_the_motion_tells_packets_that_were_read_late_from_rows_at_uneven_times(late: bool) -> None:
    rng = np.random.default_rng(8)
    stamps = GOOD.time_s + rng.uniform(0.0, 3e-4, GOOD.rows)
    angle = np.interp(GOOD.time_s if late else stamps, GOOD.time_s, GOOD["motor_position_rad"])
    record = evened(Telemetry(stamps, {**GOOD.channels, "motor_position_rad": angle}))
    assert (record.remarks == ()) is late
    if late:
        np.testing.assert_array_equal(record.telemetry["motor_position_rad"], angle)
