"""Sizes by simulation at the recording's own state: the state is kept, and what is found is of the right order."""

import numpy as np
import pytest
from scipy import signal

from app.simulated import severity_by_simulation as sizing
from app.simulated.generation import condition_of, simulate_case
from app.simulated.severity_by_simulation import Design, Taken, design_for, profile_of
from casebase.labels import PARAMETERS
from signals.analysis import Analysis
from signals.bump_profile import EDGES_HZ, bump_ratios_db
from signals.condition import OperatingCondition
from signals.features import catalogue
from signals.motion import Motion
from signals.recording import Recording
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import moved, plan
from sim.experiment.paper_axis import PAPER_AXIS

TAKEN = Taken(speed_rad_s=2.4, payload_kg_m2=30.0, period_s=3.0, slow_s=0.7, duration_s=6.5)


def test_every_motion_is_as_slow_around_its_reversal_as_the_recording() -> None:
    random = np.random.default_rng(0)
    for ramp in random.uniform(0.15, 0.6, 50):
        motion = TAKEN.motion_like(ramp, random)
        assert (motion.period_s, motion.load_speed_rad_s) == (3.0, 2.4)
        slow = motion.dwell_s + sizing.SLOW_SHARE * motion.acceleration_time_s
        assert 0.79 * TAKEN.slow_s < slow < 1.21 * TAKEN.slow_s


def test_the_described_motion_is_used_where_the_recording_has_it() -> None:
    same = Taken.of(PAPER_AXIS, Motion(period_s=4.25), 10.0)
    assert same.motion_like(0.5, np.random.default_rng(0)) == PAPER_AXIS.motion
    assert Taken.of(PAPER_AXIS, Motion(period_s=3.0), 10.0).described is None
    assert Taken.of(PAPER_AXIS, Motion(period_s=4.2), 10.0, 2.0).described is None


def test_another_motion_keeps_specimen_and_size_and_the_notch_within_full_speed() -> None:
    random = np.random.default_rng(1)
    for each in plan(PAPER_AXIS, {"notch": 20}, 3):
        there = moved(each, TAKEN.motion_like(0.3, random), TAKEN.payload_kg_m2)
        scenario, entry = there.scenario, there.mechanism
        assert entry is not None
        assert (there.size, scenario.specimen) == (each.size, each.scenario.specimen)
        motion = scenario.axis.motion
        way = motion.load_speed_rad_s * (motion.period_s / 2 - motion.dwell_s - 2 * motion.acceleration_time_s)
        assert abs(entry.parameters["angle_rad"] - scenario.middle_rad) <= 0.4 * way + 1e-9


def test_a_gap_is_sized_from_its_sound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few runs are enough to tell the smallest gaps from the largest, which differ by a factor of 15."""
    monkeypatch.setattr(sizing, "RUNS", 16)
    monkeypatch.setattr(sizing, "LISTENERS", 1)
    planned = sorted(plan(PAPER_AXIS, {"play": 12}, 99, duration_s=6.5), key=lambda each: each.size or 0.0)
    motion = TAKEN.motion_like(0.3, np.random.default_rng(2))
    design = design_for(PAPER_AXIS, "play", TAKEN, seed=5)
    found = [
        design.size_of(case.recording, condition_of(case.scenario))
        for case in (simulate_case(moved(each, motion, TAKEN.payload_kg_m2)) for each in (*planned[:2], *planned[-2:]))
    ]
    assert max(each.value for each in found[:2]) < min(each.value for each in found[2:])
    assert all(each.low < each.value < each.high for each in found)


def test_of_a_fault_that_is_not_heard_only_the_largest_is_said() -> None:
    """Cases without a bump are those of the smallest sizes; hiss has none."""
    random = np.random.default_rng(3)
    hiss = Recording(random.standard_normal(48_000).astype(np.float32), 8000.0)
    condition = OperatingCondition(speed_rad_s=2.4, motion_period_s=3.0)
    silent = profile_of(hiss, condition, TAKEN.half_s)
    sizes = np.geomspace(2e-4, 3e-3, 60)
    profiles = np.tile(silent, (60, 1))
    bump = profiles.shape[1] - bump_ratios_db(Analysis(hiss, condition)).size - len(catalogue())
    profiles[:, bump + list(catalogue()).index("play_bump_12_200_hz")] = np.where(sizes < 5e-4, -3.0, 3.0)
    design = Design("play", TAKEN, profiles, sizes, np.arange(60))
    found = design.size_of(hiss, condition)
    assert found.at_most
    assert found.low == 0
    assert 4e-4 < found.high < 5e-4


def test_the_bump_over_the_reversal_is_the_same_through_every_housing() -> None:
    """Once per cycle a blow away from the reversals; two housings colour blow and reversals alike."""
    rate, period = 8000, 2.0
    time = np.arange(8 * rate) / rate
    random = np.random.default_rng(5)
    standstill = np.abs((time + 0.5) % 1.0 - 0.5) < 0.1
    sound = np.where(standstill, 1e-3, 1e-2) * random.standard_normal(time.size)
    for at in (*range(1, 8), *(cycle * period + 1.45 for cycle in range(4))):
        sound += 0.5 * np.exp(-(((time - at) / 0.01) ** 2)) * np.sin(2 * np.pi * 112.0 * (time - at))
    condition, bands = OperatingCondition(motion_period_s=period), len(EDGES_HZ) - 1
    found = []
    for housing in (signal.iirpeak(60.0, 1.0, fs=rate), signal.iirpeak(180.0, 1.0, fs=rate)):
        heard = Recording(signal.lfilter(*housing, sound).astype(np.float32), float(rate))
        found.append(bump_ratios_db(Analysis(heard, condition)))
        assert found[-1][-1] == pytest.approx(0.45, abs=0.03)
    blow = slice(EDGES_HZ.index(80.0), EDGES_HZ.index(160.0))
    np.testing.assert_allclose(found[0][:bands][blow], found[1][:bands][blow], atol=1.0)
    assert (found[0][2 * bands : 3 * bands][blow] > 10).all(), "the other direction has no bump"


def test_what_has_no_size_or_no_motion_is_refused() -> None:
    with pytest.raises(ParameterError, match=f"{', '.join(PARAMETERS)} have one"):
        design_for(PAPER_AXIS, "normal", TAKEN)
    with pytest.raises(ParameterError, match="say --period"):
        Taken.of(PAPER_AXIS, Motion(), 10.0)
