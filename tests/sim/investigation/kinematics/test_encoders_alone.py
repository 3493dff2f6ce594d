"""Two encoders without a torque: what they differ by is told, and what they cannot tell is said."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.encoder_logs import RATIO, axis, log, strokes
from benchmarks.real_drives.drives import drives
from signals.telemetry import Telemetry
from sim.description.axis import Axis, MechanismEntry
from sim.description.axis_document import read_axis
from sim.experiment.virtual_measurement import measure
from sim.investigation.data.validation import InvestigationError
from sim.investigation.investigate import investigate
from sim.investigation.kinematics.encoders_alone import NOT_TOLD
from sim.investigation.results import Finding, Investigation
from tests.shared_data import shared
from tests.sim import axes

SPEEDS = strokes([0.5, 1.0, 2.0])
ONE_SPEED = strokes([1.0, 1.0])
PART = strokes([0.3, 0.5, 1.0], way_rad=1.0)
COARSE = 2.0 * np.pi / 2500


def named(result: Investigation) -> dict[str, Finding]:
    return {f.mechanism: f for f in result.findings}


def holds(finding: Finding, value: float, wider: float = 1.0) -> bool:
    """Whether an interval, `wider` times as wide, has a value in it."""
    size = finding.parameters[0]
    return abs(value - size.value) <= wider * max(size.high - size.value, size.value - size.low)


@pytest.mark.parametrize("driven", [SPEEDS, ONE_SPEED, PART], ids=["speeds", "one speed", "part of a turn"])
@pytest.mark.parametrize("step", [COARSE, COARSE / 50], ids=["coarse", "fine"])
def test_nothing_is_found_where_nothing_is(driven: np.ndarray, step: float) -> None:
    """Of encoders that are noisy and round, at 5 seeds each; the noise of one is slow as well."""
    said = [investigate(axis(), log(driven, seed=seed, step=step)) for seed in range(5)]
    assert [r.verdict for r in said] == ["nothing_missing"] * 5
    assert all(r.findings == () and NOT_TOLD in r.remarks for r in said)


@pytest.mark.parametrize("driven", [SPEEDS, PART], ids=["turns", "part of a turn"])
@pytest.mark.parametrize("lag_s", [0.0, 2e-3])
def test_a_gap_is_lost_motion_and_a_late_channel_is_not(driven: np.ndarray, lag_s: float) -> None:
    found = named(investigate(axis(), log(driven, gap=1e-3, lag_s=lag_s)))
    assert set(found) == {"backlash"}
    assert found["backlash"].probability >= 0.9
    assert holds(found["backlash"], 1e-3, wider=2.0)
    assert found["backlash"].indistinguishable_from == ("hysteresis",)
    late = investigate(axis(), log(driven, lag_s=2e-3))
    assert late.findings == ()
    assert any("behind by 2.0" in remark for remark in late.remarks)


def test_at_one_speed_lost_motion_and_a_late_channel_are_the_same() -> None:
    for record in (log(ONE_SPEED, gap=2e-3), log(ONE_SPEED, lag_s=1e-3)):
        found = named(investigate(axis(), record))["backlash"]
        assert found.probability <= 0.5
        assert "time_delay" in found.indistinguishable_from
        assert holds(found, 2e-3, wider=3.0)


def test_runout_and_a_gap_are_found_side_by_side_and_explain_unseen_rows() -> None:
    result = investigate(axis(), log(SPEEDS, gap=1e-3, runout=2e-3))
    found = named(result)
    assert set(found) == {"backlash", "eccentricity"}
    assert found["eccentricity"].indistinguishable_from == ("encoder_error",)
    assert found["eccentricity"].parameters[0].value == pytest.approx(2e-3, rel=0.01)
    (gain,) = result.gain
    assert (gain.channel, gain.significant) == ("load_position_rad", True)
    assert gain.rms_after < 0.02 * gain.rms_before


def test_in_less_than_a_turn_nothing_is_said_once_per_turn() -> None:
    result = investigate(axis(), log(PART, gap=1e-3, runout=2e-3))
    assert set(named(result)) == {"backlash"}
    assert any("a whole turn" in remark for remark in result.remarks)


def test_lost_motion_that_described_friction_winds_up_is_not_surely_a_gap() -> None:
    """100 N m either way on 1e5 N m/rad are 2 mrad of lost motion."""
    record = log(SPEEDS, gap=2e-3)
    assert named(investigate(axis(), record))["backlash"].probability >= 0.9
    wound = named(investigate(axis(coulomb_friction_n_m=100.0), record)).get("backlash")
    assert wound is None or wound.probability <= 0.5


def test_the_extended_axis_has_nothing_left_to_find() -> None:
    record = log(SPEEDS, gap=1e-3, runout=2e-3)
    extended = investigate(axis(), record).extended
    assert {(m.name, m.location) for m in extended.mechanisms} == {("backlash", "output"), ("eccentricity", "output")}
    assert investigate(extended, record).findings == ()


@pytest.mark.parametrize(
    "entry",
    [
        MechanismEntry("eccentricity", "output", {"amplitude_rad": 6e-4, "phase_rad": 0.7}),
        MechanismEntry("encoder_error", "load", {"amplitude_rad": 6e-4, "phase_rad": 0.7}),
        MechanismEntry("backlash", "output", {"gap_rad": 8e-4}),
    ],
)
def test_the_simulators_own_effects_are_found_and_known_again(entry: MechanismEntry) -> None:
    plain = axes.axis(period_s=7.5, load_speed_rad_s=2.0)
    telemetry = two_encoders(measure(replace(plain, mechanisms=(entry,)), 15.0).telemetry)
    (found,) = investigate(plain, telemetry).findings
    assert entry.name in (found.mechanism, *found.indistinguishable_from)
    assert found.parameters[0].value == pytest.approx(next(iter(entry.parameters.values())), rel=0.2)
    again = investigate(replace(plain, mechanisms=(entry,)), telemetry)
    assert not any(f.mechanism == found.mechanism for f in again.findings)


def two_encoders(t: Telemetry) -> Telemetry:
    return Telemetry(t.time_s, {name: t[name] for name in ("motor_position_rad", "load_position_rad")})


RATE_HZ, GAP, GIVES = 50.0, 0.010, 0.004


def pulled_by_hand(let_go: bool = True, seed: int = 0, times: int = 4) -> Telemetry:
    """The load between two sides of a gap: pulled `GIVES` beyond either, then back at it."""
    rng = np.random.default_rng(seed)
    rest, pull = 0.5 * GAP, 0.5 * GAP + GIVES
    course = [0.0]
    for _ in range(times):
        course += [pull, rest, -pull, -rest] if let_go else [pull, -pull]
    rows = [np.full(round(0.8 * RATE_HZ), place) for place in (0.0, 0.0, *course)]
    load = np.concatenate([*rows, np.full(50, course[-1])])
    load = np.convolve(load, np.full(7, 1 / 7), "same") + 1e-4 * rng.standard_normal(load.size)
    motor = 3.0 + 2e-4 * rng.standard_normal(load.size)
    return Telemetry(np.arange(load.size) / RATE_HZ, {"motor_position_rad": motor, "load_position_rad": load})


def test_a_load_pulled_against_its_motor_tells_the_gap() -> None:
    found = named(investigate(axis(), pulled_by_hand()))["backlash"]
    gap = found.parameters[0]
    assert found.probability >= 0.9
    assert gap.low == pytest.approx(GAP, rel=0.05)
    assert gap.high == pytest.approx(GAP + 2 * GIVES, rel=0.05)
    held = investigate(axis(), as_reference(pulled_by_hand(seed=1)))
    assert named(held)["backlash"].parameters[0].value == pytest.approx(gap.value, rel=0.02)


def as_reference(t: Telemetry) -> Telemetry:
    channels = {"reference_position_rad": np.full(t.rows, 3.0), "load_position_rad": t["load_position_rad"]}
    return Telemetry(t.time_s, channels)


def test_a_load_that_rings_behind_a_motor_that_stops_was_not_pulled() -> None:
    stops = np.concatenate([SPEEDS, np.full(800, SPEEDS[-1])])
    record = log(stops)
    t = np.maximum(record.time_s - SPEEDS.size / 200.0, 0.0)
    rings = record["load_position_rad"] + 0.01 * np.exp(-t) * np.sin(2 * np.pi * 3.0 * t)
    moved = {**record.channels, "load_position_rad": rings}
    assert investigate(axis(), replace(record, channels=moved)).findings == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: {**c, "load_position_rad": 0.0 * c["load_position_rad"]}, "does not move"),
        (lambda c: {**c, "load_position_rad": np.degrees(c["load_position_rad"])}, "in degrees"),
        (lambda c: {**c, "motor_position_rad": 0.7 * c["motor_position_rad"]}, "is the ratio another"),
        (lambda c: {**c, "load_position_rad": -c["load_position_rad"]}, "turn its sign"),
        (lambda c: {**c, "load_position_rad": c["load_position_rad"] % (2.0 * np.pi)}, "unwrap"),
        (lambda c: {**c, "load_position_rad": 1e9 * np.arange(c["load_position_rad"].size)}, "times as far"),
        (lambda c: {"motor_position_rad": c["motor_position_rad"]}, "motor_torque_nm.*load_position_rad"),
        (lambda c: {"load_position_rad": c["load_position_rad"]}, "reference_position_rad"),
        (lambda c: {"reference_position_rad": c["motor_position_rad"], "load_position_rad": c["load_position_rad"]},
         "log motor_position_rad or motor_torque_nm"),
    ],
)  # fmt: skip
def test_what_cannot_be_right_is_refused_in_words(change: object, words: str) -> None:
    record = log(SPEEDS)
    with pytest.raises(InvestigationError, match=words):
        investigate(axis(), replace(record, channels=change(record.channels)))  # type: ignore[operator]


def test_a_motor_angle_told_at_the_output_is_taken_for_what_it_is() -> None:
    geared = read_axis({**axis().to_mapping(), "stages": [{"name": "output", "ratio": 345.0}]})
    record = log(SPEEDS, gap=1e-3)
    told = {**record.channels, "motor_position_rad": record["motor_position_rad"] / RATIO}
    result = investigate(geared, replace(record, channels=told))
    assert any("an angle of the output" in remark for remark in result.remarks)
    assert named(result)["backlash"].parameters[0].value == pytest.approx(1e-3, rel=0.02)


def test_a_coupling_of_a_direct_drive_can_have_play_and_only_the_encoder_an_error_once_per_turn() -> None:
    direct = read_axis(
        {
            "motor": {"inertia_kg_m2": 1.0},
            "load": {"inertia_kg_m2": 1.0},
            "transmission": {"stiffness_n_m_per_rad": 1e4},
        }
    )
    record = log(SPEEDS, gap=1e-3, runout=2e-3)
    channels = {**record.channels, "motor_position_rad": record["motor_position_rad"] / RATIO}
    result = investigate(direct, replace(record, channels=channels))
    assert {(f.mechanism, f.location) for f in result.findings} == {("backlash", "load"), ("encoder_error", "load")}
    assert investigate(result.extended, replace(record, channels=channels)).findings == ()


def real(name: str) -> tuple[Axis, Telemetry]:
    shared("data", "drives")
    drive = next(one for one in drives() if one.name == name)
    return drive.description(), drive.telemetry()


def test_a_real_servos_lost_motion_and_repeatable_error() -> None:
    """Published: 10.2 mrad between the directions, 87 mrad from peak to peak of what repeats."""
    found = named(investigate(*real("servo encoders")))
    assert found["backlash"].parameters[0].value == pytest.approx(10.2e-3, rel=0.3)
    assert holds(found["backlash"], 10.2e-3)
    assert found["eccentricity"].probability >= 0.9
    assert "0.0863 rad" in found["eccentricity"].explanation


def test_a_real_servo_pulled_by_hand() -> None:
    """Published: 14.78 steps of 4096 per turn loaded, 7.03 unloaded."""
    found = named(investigate(*real("servo pulled")))["backlash"]
    gap, step = found.parameters[0], 2.0 * np.pi / 4096
    assert found.probability >= 0.9
    assert gap.low == pytest.approx(7.03 * step, rel=0.1)
    assert gap.low < gap.value < gap.high
    assert gap.value == pytest.approx(14.78 * step, rel=0.3)
    assert gap.high >= 14.78 * step
