"""Sizes by simulation at the recording's own state: the state is kept, and what is found is of the right order."""

import numpy as np
import pytest

from app import sizing
from app.generation import simulate_case
from app.sizing import Taken, design_for
from casebase.signals.motion import Motion
from sim.design import moved, plan
from sim.errors import ParameterError
from sim.paper import PAPER_AXIS

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
    monkeypatch.setattr(sizing, "RUNS", 14)
    monkeypatch.setattr(sizing, "LISTENERS", 1)
    planned = sorted(plan(PAPER_AXIS, {"play": 12}, 99, duration_s=6.5), key=lambda each: each.size or 0.0)
    motion = TAKEN.motion_like(0.3, np.random.default_rng(2))
    design = design_for(PAPER_AXIS, "play", TAKEN, seed=5)
    found = [
        design.size_of(simulate_case(moved(each, motion, TAKEN.payload_kg_m2)).extraction)
        for each in (*planned[:2], *planned[-2:])
    ]
    values = [each.value for each in found if each is not None]
    assert max(values[:2]) < min(values[2:])
    assert all(each.low < each.value < each.high for each in found if each is not None)


def test_what_has_no_size_or_no_motion_is_refused() -> None:
    with pytest.raises(ParameterError, match="play, notch have one"):
        design_for(PAPER_AXIS, "normal", TAKEN)
    with pytest.raises(ParameterError, match="say --period"):
        Taken.of(PAPER_AXIS, Motion(), 10.0)
