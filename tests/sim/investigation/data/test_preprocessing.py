from dataclasses import replace

import numpy as np
import pytest

from sim.investigation.data.preprocessing import (
    LOAD_MOTION_CUT_HZ,
    PIER,
    Bridge,
    gaussian_kernel,
    prepare,
)


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_kernels_are_exact_on_a_cubic(derivative: int) -> None:
    rate, t0 = 500.0, 1.7
    kernel = gaussian_kernel(40.0, rate, derivative)
    half = kernel.size // 2
    t = t0 + np.arange(-half, half + 1) / rate
    line = 2.0 + 3.0 * t
    parabola = line + 0.5 * 7.0 * t * t
    cubic = parabola + (t - t0) ** 3
    if derivative == 0:
        assert kernel @ cubic == pytest.approx(2.0 + 3.0 * t0 + 3.5 * t0 * t0, rel=1e-9)
    elif derivative == 1:
        assert kernel @ parabola == pytest.approx(3.0 + 7.0 * t0, rel=1e-9)
    else:
        assert kernel @ cubic == pytest.approx(7.0, rel=1e-9)


def test_the_low_pass_halves_the_power_at_its_cut() -> None:
    kernel = gaussian_kernel(25.0, 2000.0, 0)
    k = np.arange(kernel.size) - kernel.size // 2
    response = np.sum(kernel * np.cos(2 * np.pi * 25.0 / 2000.0 * k))
    assert response**2 == pytest.approx(0.5, abs=5e-3)


def test_standstill_does_not_count() -> None:
    t = np.arange(4000) / 1000.0
    angle = np.where(t < 2.0, 30.0 * t, 60.0)
    prepared = prepare(1000.0, np.zeros(t.size), angle, angle / 10.0)
    assert prepared.weight[prepared.time_s > 2.2].max() == 0.0
    assert prepared.load_weight[prepared.time_s > 2.2].max() == 0.0  # dry friction at the load holds what it likes
    assert prepared.weight[(prepared.time_s > 0.5) & (prepared.time_s < 1.8)].min() == 1.0


def test_at_the_motor_of_a_gear_rest_counts_once_it_has_moved() -> None:
    """Before, nobody knows what friction holds; at the load the encoder does not see how far it gives way."""
    t = np.arange(6000) / 1000.0
    angle = np.clip(30.0 * (t - 2.0), 0.0, 60.0)
    prepared = replace(prepare(1000.0, np.zeros(t.size), angle, angle / 10.0), rests=True)
    assert prepared.weight[prepared.time_s < 1.8].max() == 0.0
    assert prepared.weight[prepared.time_s > 2.2].min() == 1.0
    assert prepared.load_weight[prepared.time_s > 4.2].max() == 0.0


def test_the_guide_rests_while_the_load_turns_back_later_than_the_motor() -> None:
    """As far as the slow kernel of its encoder spreads the kinks of a load that sticks."""
    t = np.arange(8000) / 1000.0
    late = 0.3
    prepared = prepare(1000.0, np.zeros(t.size), 40.0 * np.sin(t), 4.0 * np.sin(t - late))
    turned = np.pi / 2 + late
    near = np.abs(prepared.time_s - turned) < 0.5 / LOAD_MOTION_CUT_HZ
    assert prepared.load_weight[near].max() == 0.0
    assert prepared.weight[near].min() == 1.0
    assert prepared.load_weight[np.abs(prepared.time_s - np.pi) < 0.5].min() == 1.0


def test_lost_rows_are_bridged_by_what_is_on_either_side() -> None:
    lost = np.zeros(1000, dtype=np.bool_)
    lost[:30] = lost[400:460] = lost[-10:] = True
    bridge = Bridge.over(lost)
    rng = np.random.default_rng(3)
    one, other = rng.standard_normal((2, lost.size))
    assert bridge.across(np.full(lost.size, 2.0)) == pytest.approx(2.0)
    assert bridge.across(one + 3.0 * other) == pytest.approx(bridge.across(one) + 3.0 * bridge.across(other))
    assert (bridge.across(one)[~lost] == one[~lost]).all()
    left, right = one[400 - PIER : 400].mean(), one[460 : 460 + PIER].mean()
    middle = bridge.across(one)[400:460]
    assert middle == pytest.approx(np.interp(np.arange(400, 460), [399, 460], [left, right]))
    assert bridge.across(one)[0] == pytest.approx(one[30 : 30 + PIER].mean())
    assert Bridge.over(np.ones(5, dtype=np.bool_)).across(one[:5]) == pytest.approx(one[:5])


def test_the_load_s_motion_keeps_what_teeth_shake() -> None:
    """What is left at the load is cut off after the model; cut off before, teeth at 84 Hz came out at a third."""
    t = np.arange(4000) / 1000.0
    m = prepare(1000.0, np.zeros(t.size), t, 1e-5 * np.cos(2 * np.pi * 84.0 * t))
    assert m.load_angle is not None
    assert np.abs(m.load_angle).max() > 0.9e-5


@pytest.mark.parametrize("frequency_hz", [0.0, 10.0, 50.0, 84.0])
def test_what_is_left_at_the_load_is_thinned_below_its_cut(frequency_hz: float) -> None:
    t = np.arange(4003) / 1000.0
    m = prepare(1000.0, np.zeros(t.size), t, t)
    wave = np.cos(2 * np.pi * frequency_hz * m.time_s + 0.3)
    share = float(m.passed_at_load(np.array([frequency_hz]))[0])
    assert share == pytest.approx({0.0: 1.0, 10.0: 1.0, 50.0: 0.5**0.5, 84.0: 0.19}[frequency_hz], abs=6e-3)
    thinned, row = m.thinned(wave), m.load_stride
    np.testing.assert_allclose(thinned[10:-10], share * wave[::row][10:-10], atol=1e-9)
    np.testing.assert_allclose(m.thinned(m.time_s), m.time_s[::row], atol=1e-9)
