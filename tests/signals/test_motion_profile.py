"""A motion back and forth: given, it has to be one; measured, it is what the angle does."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest

from signals.errors import ConditionError, TelemetryError
from signals.measured_motion import measured_motion
from signals.motion_profile import MotionProfile

TRAPEZOID = MotionProfile("trapezoid", 3.0, 2.0, 0.5, 0.2)
PROFILES = (TRAPEZOID, MotionProfile("s_curve", 3.0, 2.0, 0.5, 0.2), MotionProfile("sine", 3.0, 2.0, dwell_s=0.2))
near = partial(pytest.approx, rel=0.03)
CLOCK = np.arange(20000) * 0.001


def angle_of(profile: MotionProfile) -> np.ndarray:
    """Return an angle that begins in the middle of a rest, by the integral of the speed, with an encoder's steps."""
    half = profile.period_s / 2
    count = np.floor(CLOCK / half)
    speed = profile.speeds(CLOCK - count * half - profile.dwell_s / 2) * np.where(count % 2, -1, 1)
    return np.asarray(np.round(np.cumsum(speed) * 0.001 / 5e-4) * 5e-4)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda each: each.kind)
def test_a_way_is_as_long_as_the_stroke(profile: MotionProfile) -> None:
    time = np.linspace(0, profile.moving_s, 5001)
    speed = profile.speeds(time)
    assert np.trapezoid(speed, time) == pytest.approx(3.0, rel=1e-5)
    assert (speed.max(), speed[0], profile.speeds(np.array([99.0]))[0]) == pytest.approx((2.0, 0.0, 0.0), abs=1e-6)


def test_periods_are_those_of_the_closed_forms() -> None:
    assert [each.period_s for each in PROFILES] == pytest.approx([4.4, 4.4, 2 * (math.pi / 2 * 1.5 + 0.2)])
    assert TRAPEZOID.speeds(np.array([0.25, 1.0, 1.75])) == pytest.approx([1.0, 2.0, 1.0])


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"acceleration_time_s": None}, "acceleration_time_s"),
        ({"stroke_rad": 0.9}, "stroke_rad"),
        ({"load_speed_rad_s": -1.0}, "load_speed_rad_s"),
        ({"dwell_s": math.nan}, "dwell_s"),
        ({"dwell_s": 400.0}, "cycle"),
    ],
)
def test_what_is_no_motion_is_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(ConditionError, match=named):
        MotionProfile(**vars(TRAPEZOID) | wrong)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda each: each.kind)
def test_an_angle_has_the_motion_that_it_was_made_of(profile: MotionProfile) -> None:
    found = measured_motion(CLOCK, angle_of(profile))
    seen = found.profile
    assert (seen.kind, seen.stroke_rad, seen.load_speed_rad_s) == (profile.kind, *map(near, (3.0, 2.0)))
    assert seen.acceleration_time_s == (None if profile.kind == "sine" else near(0.5))
    assert seen.dwell_s == pytest.approx(0.2, abs=0.02)
    assert found.profile.period_s == pytest.approx(profile.period_s, rel=0.002)
    half = profile.period_s / 2
    expected = half * np.arange(1, len(found.reversal_times_s) + 1)
    np.testing.assert_allclose(found.reversal_times_s, expected, atol=0.02)


def test_a_reversal_near_an_end_of_the_log_counts() -> None:
    found = measured_motion(CLOCK, np.cos(2 * np.pi * (CLOCK - 2) / 12))
    assert found.reversal_times_s == pytest.approx((2.0, 8.0, 14.0), abs=0.01)


def test_an_angle_without_one_motion_is_refused() -> None:
    with pytest.raises(TelemetryError, match="back and forth"):
        measured_motion(CLOCK, 2 * CLOCK)
    with pytest.raises(TelemetryError, match="same two positions"):
        measured_motion(CLOCK, np.sin(CLOCK) * np.where(CLOCK < 10, 1, 0.8))
