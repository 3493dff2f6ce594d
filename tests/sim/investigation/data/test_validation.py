"""What cannot be right is refused in words; what can be repaired is named as a fault of the measurement."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import one_body
from signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.investigation.data.validation import InvestigationError, examine
from sim.investigation.investigate import investigate

AXIS = read_axis({"motor": {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0}, "load": {"inertia_kg_m2": 0.0}})
GEARED = read_axis(
    {
        "motor": {"inertia_kg_m2": 0.15},
        "stages": [{"name": "output", "ratio": 10, "stiffness_n_m_per_rad": 1e5}],
        "load": {"inertia_kg_m2": 15.0},
    }
)


def changed(telemetry: Telemetry, **channels: object) -> Telemetry:
    kept = {k: v for k, v in {**telemetry.channels, **channels}.items() if v is not None}
    return replace(telemetry, channels=kept)  # type: ignore[arg-type]


def test_a_sound_record_passes_without_fault() -> None:
    data_check = examine(AXIS, one_body(0.3, 1.0, 0.0, 1))
    assert data_check.faults == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: changed(t, motor_torque_nm=None), "motor_torque_nm"),
        (lambda t: changed(t, motor_position_rad=None), "motor_position_rad"),
        (lambda t: changed(t, motor_torque_nm=-t["motor_torque_nm"]), "sign"),
        (lambda t: changed(t, motor_torque_nm=1e3 * t["motor_torque_nm"]), "unit"),
        (lambda t: changed(t, motor_torque_nm=1e-3 * t["motor_torque_nm"]), "unit"),
        (lambda t: changed(t, motor_position_rad=1e3 * t["motor_position_rad"]), "unit"),
        (lambda t: changed(t, motor_position_rad=np.ones(t.rows)), "stands still"),
        (lambda t: changed(t, motor_torque_nm=np.full(t.rows, 0.2)), "stays at 0.2 N m in every row"),
        (lambda t: replace(t, time_s=1e3 * t.time_s), "samples per second"),
        (lambda t: replace(t, time_s=1e-3 * t.time_s), "samples per second"),
    ],
)
def test_what_cannot_be_right_is_refused_in_words(change: object, words: str) -> None:
    with pytest.raises(InvestigationError, match=words):
        examine(AXIS, change(one_body(0.3, 1.0, 0.0, 2)))  # type: ignore[operator]


@pytest.mark.parametrize(
    ("factor", "words"),
    [(-1.0, "other way round"), (1e3, "mrad"), (1e-3, "1000"), (180 / np.pi, "degrees"), (3.0, "ratio")],
)
def test_a_load_encoder_that_disagrees_with_the_ratio_is_refused(factor: float, words: str) -> None:
    telemetry = one_body(0.3, 0.0, 0.0, 3)
    load = factor * telemetry["motor_position_rad"] / 10
    with pytest.raises(InvestigationError, match=words):
        examine(GEARED, changed(telemetry, load_position_rad=load))


def test_missing_and_repeated_rows_are_named_lost_samples() -> None:
    telemetry = one_body(0.3, 1.0, 0.0, 5)
    rng = np.random.default_rng(5)
    keep = rng.random(telemetry.rows) > 0.01
    thinned = Telemetry(telemetry.time_s[keep], {k: v[keep] for k, v in telemetry.channels.items()})
    assert [f.mechanism for f in examine(AXIS, thinned).faults] == ["lost_samples"]
    held = np.arange(telemetry.rows)
    again = rng.choice(held[1:], 200, replace=False)
    held[again] = held[again - 1]
    repeated = Telemetry(telemetry.time_s, {k: v[held] for k, v in telemetry.channels.items()})
    assert [f.mechanism for f in examine(AXIS, repeated).faults] == ["lost_samples"]


def test_a_motor_that_sticks_and_breaks_away_has_lost_no_rows() -> None:
    """Torque of few bits may stay for a row while it sticks, and then it moves at once by many steps of its encoder."""
    rng = np.random.default_rng(4)
    time = np.arange(9000) / 500.0
    phase, forth = time % 0.6, np.where((time // 0.6) % 2 == 0, 1.0, -1.0)
    rate = 2.0 * np.clip(np.minimum(phase - 0.15, 0.6 - phase) / 0.02, 0.0, 1.0) * forth
    rate += np.where(time < 0.1, 1e-3, 0.0)  # at first it creeps
    angle = np.cumsum(rate) / 500.0
    torque = 150.0 * np.diff(rate, prepend=0.0) + np.sign(rate) + 0.05 * rng.standard_normal(time.size)
    logged = {
        "motor_position_rad": np.round(angle / 1e-6) * 1e-6,
        "motor_torque_nm": np.round(torque / 0.1) * 0.1,
    }
    assert "lost_samples" not in [f.mechanism for f in examine(AXIS, Telemetry(time, logged)).faults]


@pytest.mark.parametrize("length", [1, 29, 60])
def test_rows_are_held_however_long_the_motor_has_gone_on_meanwhile(length: int) -> None:
    telemetry = one_body(0.3, 1.0, 0.0, 5)
    first = int(np.argmax(np.gradient(telemetry["motor_position_rad"])))  # fast all around
    rows = np.arange(telemetry.rows)
    rows[first : first + length] = first - 1
    held = Telemetry(telemetry.time_s, {k: v[rows] for k, v in telemetry.channels.items()})
    counts = examine(AXIS, held).measurement.weight > 0.5
    assert not counts[first : first + length].any()
    assert counts.mean() > 0.4


def test_held_rows_are_bridged_and_most_rows_around_them_still_count() -> None:
    """Two in a hundred rows hold the last value, at any speed; what moved is known as well as before."""
    telemetry = one_body(0.3, 1.0, 0.0, 5)
    rows, rng = np.arange(telemetry.rows), np.random.default_rng(2)
    slow = int(np.argmin(np.abs(np.gradient(telemetry["motor_position_rad"]) - 0.003)))
    for start in (slow, *rng.integers(1, rows.size - 10, 50)):
        rows[start : start + 4] = rows[start - 1]
    held = Telemetry(telemetry.time_s, {k: v[rows] for k, v in telemetry.channels.items()})
    bridged, whole = examine(AXIS, held).measurement, examine(AXIS, telemetry).measurement
    assert bridged.weight.mean() > 0.4 * whole.weight.mean()
    assert np.abs(bridged.slow_acceleration - whole.slow_acceleration).max() < 5e-3 * np.abs(whole.acceleration).max()
    fast = np.abs(bridged.acceleration - whole.acceleration)[bridged.weight > 0.5]
    assert fast.max() < 0.02 * np.abs(whole.acceleration).max()


def test_a_cut_torque_channel_is_named_clipping() -> None:
    telemetry = one_body(0.3, 1.0, 0.0, 6)
    torque = telemetry["motor_torque_nm"]
    limit = 0.7 * np.abs(torque).max()
    faults = examine(AXIS, changed(telemetry, motor_torque_nm=np.clip(torque, -limit, limit))).faults
    assert [f.mechanism for f in faults] == ["clipping"]
    assert faults[0].parameters["torque_n_m"] == pytest.approx(limit)


@pytest.mark.parametrize("missing_s", [0.05, 0.5, 2.0])
def test_a_gap_in_the_record_is_no_fault_of_the_machine(missing_s: float) -> None:
    telemetry = one_body(0.3, 1.0, 0.0, 8)
    keep = np.abs(telemetry.time_s - 6.0) > 0.5 * missing_s
    torn = Telemetry(telemetry.time_s[keep], {k: v[keep] for k, v in telemetry.channels.items()})
    assert {f.mechanism for f in investigate(AXIS, torn).findings} <= {"lost_samples"}
