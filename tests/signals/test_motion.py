"""The motion is found in loudness alone, at any length and with noise, and never where there is none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from signals.analysis import Analysis
from signals.condition import UNKNOWN, OperatingCondition
from signals.errors import ConditionError
from signals.motion import HOP_HZ, MotionSource, even_times, find_motion
from signals.recording import Recording
from tests.signals.synthetic import RATE_HZ, Joint, sound


def analysed(joint: Joint, condition: OperatingCondition = UNKNOWN) -> Analysis:
    return Analysis(Recording(sound(joint), RATE_HZ), condition)


@settings(deadline=None, max_examples=15)
@given(
    stroke_s=st.floats(2.0, 4.5),
    start_s=st.floats(0.3, 1.9),
    seed=st.integers(0, 10**6),
    noise=st.sampled_from([0.0, 0.3, 1.0]),
    label=st.sampled_from(["normal", "play", "notch"]),
)
def test_reversals_are_found_to_the_hundredth_second(
    stroke_s: float, start_s: float, seed: int, noise: float, label: str
) -> None:
    joint = Joint(label=label, stroke_s=stroke_s, start_s=start_s, seed=seed, noise=noise)
    motion = analysed(joint).motion
    assert motion.source is MotionSource.SOUND
    assert motion.period_s == pytest.approx(2 * stroke_s, rel=0.01)
    for time in motion.reversal_times_s:
        assert np.abs(joint.reversals_s - time).min() < 0.05
    assert motion.cycles == pytest.approx(joint.duration_s / (2 * stroke_s), rel=0.01)


def test_two_reversals_are_enough_for_the_period_and_one_for_itself() -> None:
    two = analysed(Joint(duration_s=5.0, stroke_s=3.1, start_s=0.9)).motion
    assert two.period_s == pytest.approx(6.2, abs=0.06)
    one = analysed(Joint(duration_s=3.5, stroke_s=3.1, start_s=1.7)).motion
    assert one.period_s is None
    assert len(one.reversal_times_s) == 1
    assert one.reversal_times_s[0] == pytest.approx(1.7, abs=0.05)


@pytest.mark.parametrize("duration_s", [0.1, 1.0, 5.0, 20.0])
def test_steady_noise_seldom_has_a_motion(duration_s: float) -> None:
    """Dips of steady noise are taken for standstills in at most one recording of twenty."""
    found = 0
    for seed in range(40):
        samples = np.random.default_rng(seed).normal(0, 0.1, int(duration_s * RATE_HZ)).astype(np.float32)
        motion = Analysis(Recording(samples, RATE_HZ), UNKNOWN).motion
        found += motion.source is not MotionSource.NONE
    assert found <= 2


@settings(deadline=None)
@given(stroke=st.floats(0.5, 5), count=st.integers(5, 40), lost=st.integers(0, 4), where=st.floats(0.2, 0.8))
def test_even_times_survive_one_that_is_extra_and_one_that_is_lost(
    stroke: float, count: int, lost: int, where: float
) -> None:
    rng = np.random.default_rng(count)
    true = 1 + stroke * np.arange(count)
    seen = true + rng.uniform(-0.02, 0.02, count) * stroke
    extra = true[1] + where * stroke
    kept = np.delete(seen, lost) if count > 8 else seen
    found = even_times(np.sort(np.append(kept, extra)))
    assert np.median(np.diff(found)) == pytest.approx(stroke, rel=0.02)
    assert np.abs(true[:, None] - found).min(axis=0).max() < 0.06 * stroke


def level_with_dips(duration_s: float, dips: list[tuple[float, float]], depth_db: float = 20.0) -> np.ndarray:
    """A loudness with dips given by their middle and length [s], and half a decibel of scatter."""
    level = np.random.default_rng(0).normal(0, 0.5, int(duration_s * HOP_HZ))
    for middle, length in dips:
        level[int((middle - length / 2) * HOP_HZ) : int((middle + length / 2) * HOP_HZ)] -= depth_db
    return level.astype(np.float32)


def test_irregular_reversals_have_no_period() -> None:
    dips = [(1.2, 0.4), (2.4, 0.5), (7.0, 0.4), (9.0, 0.6), (17.0, 0.4)]
    motion = find_motion(level_with_dips(20.0, dips), UNKNOWN)
    assert motion.period_s is None
    np.testing.assert_allclose(motion.reversal_times_s, [middle for middle, _ in dips], atol=0.02)
    faint = find_motion(level_with_dips(20.0, dips, depth_db=1.0), UNKNOWN)
    assert faint.reversal_times_s == ()


def test_a_long_dwell_and_a_slow_stroke_are_told_from_a_reversal() -> None:
    dwelling = find_motion(level_with_dips(24.0, [(k * 4.0 + 2, 2.4) for k in range(6)]), UNKNOWN)
    assert dwelling.period_s == pytest.approx(8.0, abs=0.03)
    level = level_with_dips(28.0, [(k * 3.5 + 1.5, 0.4) for k in range(8)], depth_db=32.0)
    time = np.arange(level.size) / HOP_HZ
    slow = (np.floor((time - 1.5) / 3.5) % 2 == 0) & (level > -20)
    level[slow] -= 17
    assert find_motion(level, UNKNOWN).period_s == pytest.approx(7.0, abs=0.03)


def test_unequal_strokes_are_kept_as_they_are() -> None:
    """Out in 2 s, back in 3 s: the reversals alternate and the cycle is 5 s."""
    level = np.zeros(int(22 * HOP_HZ), dtype=np.float32)
    times = [1.0, 3.0, 6.0, 8.0, 11.0, 13.0, 16.0, 18.0]
    for time in times:
        level[int((time - 0.2) * HOP_HZ) : int((time + 0.2) * HOP_HZ)] = -15
    motion = find_motion(level, UNKNOWN)
    assert motion.period_s == pytest.approx(5.0, abs=0.02)
    np.testing.assert_allclose(motion.reversal_times_s, times, atol=0.02)


def test_what_is_given_is_used() -> None:
    joint = Joint()
    given_times = tuple(t for t in joint.reversals_s if 0 < t < 20)
    motion = analysed(joint, OperatingCondition(reversal_times_s=given_times)).motion
    assert motion.source is MotionSource.GIVEN
    assert motion.reversal_times_s == given_times
    assert motion.period_s == pytest.approx(2 * joint.stroke_s)
    with_period = analysed(joint, OperatingCondition(motion_period_s=6.21)).motion
    assert with_period.period_s == 6.21
    assert with_period.period_in_sound_s == pytest.approx(6.2, abs=0.03)
    assert analysed(joint, OperatingCondition(steady=True)).motion.source is MotionSource.NONE


@pytest.mark.parametrize(
    "wrong",
    [
        {"speed_rad_s": -1.0},
        {"payload_kg_m2": float("nan")},
        {"motion_period_s": 0.0},
        {"reversal_times_s": (2.0, 1.0)},
        {"reversal_times_s": (1.0, float("inf"))},
        {"mesh_orders": (0.0,)},
    ],
)
def test_impossible_conditions_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConditionError, match=next(iter(wrong))):
        OperatingCondition(**wrong)  # type: ignore[arg-type]
