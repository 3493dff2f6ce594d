"""Logs made ready: derivatives, ends, gaps, joints that stand, and each refusal."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robot_arms import Array, robot, two_links
from signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.investigation.data.data_fault import InvestigationError
from sim.robot.motion import Motion
from sim.robot.robot import Joint

RATE = 100.0
TIME = np.arange(801) / RATE
ROBOT = robot(two_links())


def log(*positions: Array, time: Array = TIME) -> list[Telemetry]:
    return [Telemetry(time, {"motor_position_rad": q, "motor_torque_nm": 2.0 * q}) for q in positions]


CUBIC = 0.5 + 0.2 * TIME - 0.1 * TIME**2 + 0.01 * TIME**3
SWING = np.sin(TIME)


def test_derivatives_of_a_cubic_are_exact_where_rows_count() -> None:
    m = Motion.of(ROBOT, log(CUBIC, SWING))
    t = m.time_s[m.counts]
    np.testing.assert_allclose(m.position[m.counts, 0], 0.5 + 0.2 * t - 0.1 * t**2 + 0.01 * t**3, atol=1e-9)
    np.testing.assert_allclose(m.speed[m.counts, 0], 0.2 - 0.2 * t + 0.03 * t**2, atol=1e-9)
    np.testing.assert_allclose(m.acceleration[m.counts, 0], -0.2 + 0.06 * t, atol=1e-8)
    np.testing.assert_allclose(m.torque[m.counts, 1], 2.0 * np.sin(t), atol=1e-3)
    assert m.moves.all()


def test_what_is_logged_at_a_motor_is_taken_to_the_joint_by_the_described_ratio() -> None:
    axis = read_axis(
        {"name": "geared", "motor": {}, "stages": [{"name": "output", "ratio": 50.0}], "load": {"inertia_kg_m2": 1.0}}
    )
    geared = replace(ROBOT, joints=(Joint("joint1", axis, described=True), ROBOT.joints[1]))
    first, second = log(CUBIC, SWING)
    at_motor = {"motor_position_rad": 50.0 * CUBIC, "motor_torque_nm": 2.0 * CUBIC / 50.0}
    m, direct = Motion.of(geared, [replace(first, channels=at_motor), second]), Motion.of(ROBOT, [first, second])
    np.testing.assert_allclose(m.position, direct.position, atol=1e-9)
    np.testing.assert_allclose(m.torque, direct.torque, atol=1e-9)


def test_rows_count_whose_neighbours_are_measured_at_all_joints() -> None:
    """At the ends, and beside what one joint has lost, accelerations are guesses: a sum of squares is full of them."""
    lost = np.zeros(TIME.size, dtype=np.bool_)
    lost[400:420] = True
    first, second = log(CUBIC, SWING)
    m = Motion.of(ROBOT, [first, replace(second, lost={"motor_torque_nm": lost})])
    counting = m.time_s[m.counts]
    assert counting[0] > 0.05
    assert counting[-1] < TIME[-1] - 0.05
    assert not np.any((counting > 3.95) & (counting < 4.25))
    assert np.any(counting < 3.8)
    assert np.any(counting > 4.4)
    short = np.zeros(TIME.size, dtype=np.bool_)
    short[400] = True  # a line over one row is as good as the row
    again = Motion.of(ROBOT, [first, replace(second, lost={"motor_torque_nm": short})])
    assert again.counts.sum() == Motion.of(ROBOT, [first, second]).counts.sum()


def test_joints_that_start_and_end_otherwise_count_where_both_are() -> None:
    first, second = log(CUBIC, SWING)
    late = Telemetry(TIME[100:-50], {name: values[100:-50] for name, values in second.channels.items()})
    counting = Motion.of(ROBOT, [first, late]).time_s[Motion.of(ROBOT, [first, late]).counts]
    assert counting[0] > 1.05
    assert counting[-1] < TIME[-1] - 0.55


def test_a_joint_that_is_held_is_no_joint_that_moves() -> None:
    held = 0.3 + 1e-5 * np.random.default_rng(0).normal(size=TIME.size)
    assert Motion.of(ROBOT, log(CUBIC, held)).moves.tolist() == [True, False]
    with pytest.raises(InvestigationError, match="no joint moves"):
        Motion.of(ROBOT, log(held, held))


@pytest.mark.parametrize("rate", [10.0, 1000.0])
def test_slow_and_fast_logs_have_their_rows_thinned_to_what_the_motion_needs(rate: float) -> None:
    time = np.arange(int(30.0 * rate) + 1) / rate
    m = Motion.of(ROBOT, log(np.sin(0.5 * time), np.cos(0.5 * time), time=time))
    assert 4.0 <= m.rate_hz <= 52.0
    inner = m.time_s[m.counts]
    np.testing.assert_allclose(m.acceleration[m.counts, 0], -0.25 * np.sin(0.5 * inner), atol=1e-3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: replace(one, channels={"motor_torque_nm": one["motor_torque_nm"]}), "needs motor_position_rad"),
        (lambda one: replace(one, channels={**one.channels, "motor_position_rad": 60.0 * SWING}), 'write unit = "deg"'),
        (lambda one: replace(one, channels={**one.channels, "motor_position_rad": 1e4 * SWING}), "is the column right"),
    ],
)
def test_a_refusal_names_the_joint(change: Callable[[Telemetry], Telemetry], said: str) -> None:
    first, second = log(CUBIC, SWING)
    with pytest.raises(InvestigationError, match=r"^joint2: ") as refused:
        Motion.of(ROBOT, [first, change(second)])
    assert said in str(refused.value)


def test_too_little_that_counts_is_said_with_what_is_needed() -> None:
    few = TIME[:110]
    with pytest.raises(InvestigationError, match="at least 2 s"):
        Motion.of(ROBOT, log(few, few, time=few))
    slow = np.arange(60) / 10.0
    with pytest.raises(InvestigationError, match=r"at 10 rows per second .* s are needed"):
        Motion.of(ROBOT, log(np.sin(slow), np.cos(slow), time=slow))
