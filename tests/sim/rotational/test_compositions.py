"""Compositions beyond the reference examples, against equations written down here and integrated by scipy."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim.rotational.component import Component
from sim.rotational.components import (
    Accelerate,
    BearingFriction,
    Clutch,
    Constant,
    Inertia,
    LossyGear,
    Move,
    Position,
    Ramp,
    Sine,
    Speed,
    Step,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate

Array = NDArray[np.float64]
TWO_PI = 2 * np.pi


def lossy_acceleration(torque: float, load: float, w: float, ratio: float, table: Array) -> float:
    """Acceleration of the driving shaft (0.3 kg m2) of a rolling lossy gear with 2 kg m2 behind it: the branch whose
    own torque agrees with it."""
    i = int(np.clip(np.searchsorted(table[:, 0], abs(w), side="right") - 1, 0, len(table) - 2))
    share = (abs(w) - table[i, 0]) / (table[i + 1, 0] - table[i, 0])
    eta1, eta2, *bearing = (table[i] + share * (table[i + 1] - table[i]))[1:]
    bf1, bf2 = np.abs(bearing)
    way, turn = np.sign(w), (bf1 - bf2) / (eta1 - 1 / eta2)
    for gain, offset, driven in ((eta1, bf1, True), (1 / eta2, bf2, False)):
        a = (load + ratio * (gain * torque - way * offset)) / (2.0 / ratio + ratio * gain * 0.3)
        if (way * (torque - 0.3 * a) >= turn) == driven:
            return float(a)
    raise AssertionError("no branch agrees")


@pytest.mark.parametrize("ratio", [2.5, -2.5])
def test_losses_over_speed_driven_and_driving_back(ratio: float) -> None:
    table = np.array([[0, 0.9, 0.7, 0.2, 0.4], [5, 0.9, 0.7, 0.5, 0.6], [12, 0.9, 0.7, 0.3, 0.9]])
    train = DriveTrain.series(
        torque=Torque(Sine(3, 7 / TWO_PI)),
        motor=Inertia(J=0.3, w=12.5),
        gear=LossyGear(ratio=ratio, lossTable=table),
        load=Inertia(J=2.0),
        back=Torque(Sine(6, 3 / TWO_PI, phase=np.pi / 2)),
    )

    def rate(t: float, w: Array) -> list[float]:
        return [lossy_acceleration(3 * np.sin(7 * t), 6 * np.cos(3 * t), w[0], ratio, table)]

    result = simulate(train, 0.5, 50.0)
    truth = solve_ivp(rate, (0, 0.5), [12.5], rtol=1e-9, atol=1e-10, max_step=5e-3, t_eval=result.time_s)
    assert truth.y[0].min() > 1  # it rolls, first at speeds beyond the table
    np.testing.assert_allclose(result["motor.w"], truth.y[0], atol=1e-4)


@pytest.mark.parametrize("seed", range(12))
def test_drawn_bearing_friction_over_speed(seed: int) -> None:
    """Lines that fall below zero beyond their table count by their absolute value."""
    rng = np.random.default_rng(seed)
    rows = int(rng.integers(2, 4))
    speeds = np.cumsum([0.0, *rng.uniform(2, 8, rows - 1)])
    table = np.column_stack([speeds, np.tile(rng.uniform(0.5, 1, 2), (rows, 1)), rng.uniform(0, 1.5, (rows, 2))])
    ratio, load, start = rng.choice([2.0, -3.0, 0.5]), rng.uniform(-5, 5), rng.uniform(5, 40) * rng.choice([-1, 1])
    train = DriveTrain.series(
        torque=Torque(Sine(3, 7 / TWO_PI)),
        motor=Inertia(J=0.3, w=start),
        gear=LossyGear(ratio=ratio, lossTable=table),
        load=Inertia(J=2.0),
        back=Torque(Constant(load)),
    )

    def rate(t: float, w: Array) -> list[float]:
        return [lossy_acceleration(3 * np.sin(7 * t), load, w[0], ratio, table)]

    def rest(_: float, w: Array) -> float:
        return float(w[0])

    rest.terminal = True  # type: ignore[attr-defined]
    result = simulate(train, 0.4, 50.0)
    truth = solve_ivp(rate, (0, 0.4), [start], rtol=1e-9, atol=1e-10, max_step=5e-3, t_eval=result.time_s, events=rest)
    np.testing.assert_allclose(result["motor.w"][: truth.t.size], truth.y[0], atol=1e-5)


@pytest.mark.parametrize("ratio", [3.0, -3.0])
def test_a_lossy_gear_breaks_away_at_the_higher_of_two_limits(ratio: float) -> None:
    """Of eta 0.8 and 0.6 with bearing friction 0.5 and 1.5 N m, T = (1 - 1/0.6) T + 1.5 is met last, at 0.9 N m."""
    train = DriveTrain.series(
        torque=Torque(Ramp(height=2, duration=2)),
        motor=Inertia(J=0.1),
        gear=LossyGear(ratio=ratio, lossTable=[0, 0.8, 0.6, 0.5, 1.5]),
        load=Inertia(J=1),
    )
    (event,) = simulate(train, 2.0, 50.0).events
    assert (event.component, event.to_name) == ("gear", "forward")
    assert event.time_s == pytest.approx(0.9, abs=1e-12)


def test_clutches_in_series_close_one_after_the_other() -> None:
    """Friction of 1e-3 rad/s regularity in their place comes as near as that."""
    smooth = 1e-3
    train = DriveTrain.series(
        torque=Torque(Sine(10, 0.2)),
        J1=Inertia(J=1, w=10),
        c1=Clutch(fn_max=20, f_normalized=Sine(1, 0.5, phase=np.pi / 2)),
        J2=Inertia(J=1, w=0),
        c2=Clutch(fn_max=20, f_normalized=Step(startTime=0.4)),
        J3=Inertia(J=1, w=0),
        c3=Clutch(fn_max=20, f_normalized=Step(startTime=0.9)),
        J4=Inertia(J=1, w=0),
    )
    result = simulate(train, 1.5, 100.0)

    def rate(t: float, w: Array) -> Array:
        force = 20 * np.array([max(0.0, np.cos(np.pi * t)), t >= 0.4, t >= 0.9])
        through = 0.5 * force * np.tanh(-np.diff(w) / smooth)
        return np.append(10 * np.sin(TWO_PI * 0.2 * t), through) - np.append(through, 0.0)

    w = np.array([10.0, 0.0, 0.0, 0.0])
    for begin, end in ((0.0, 0.4), (0.4, 0.9), (0.9, 1.5)):
        times = result.time_s[(result.time_s > begin - 1e-9) & (result.time_s < end - 1e-9)]
        done = solve_ivp(rate, (begin, end - 1e-12), w, "Radau", rtol=1e-6, atol=1e-7, t_eval=times, dense_output=True)
        assert done.sol is not None
        w = done.sol(end)
        ours = np.stack([result[f"J{i}.w"][np.searchsorted(result.time_s, times - 1e-9)] for i in range(1, 5)])
        np.testing.assert_allclose(ours, done.y, atol=2 * smooth)


def test_friction_over_a_bent_table() -> None:
    table = np.array([[0, 2.0], [3, 1.2], [8, 1.9], [20, 4.0]])
    train = DriveTrain.series(
        torque=Torque(Sine(1.5, 5 / TWO_PI)), shaft=Inertia(J=0.5, w=30.0), bearing=BearingFriction(tau_pos=table)
    )
    result = simulate(train, 1.0, 100.0)

    def rate(t: float, w: Array) -> list[float]:
        friction = np.interp(w[0], *table.T) if w[0] < 20 else 4.0 + (w[0] - 20) * 2.1 / 12
        return [(1.5 * np.sin(5 * t) - friction) / 0.5]

    truth = solve_ivp(rate, (0, 1), [30.0], rtol=1e-9, atol=1e-10, max_step=5e-3, t_eval=result.time_s)
    np.testing.assert_allclose(result["shaft.w"], truth.y[0], atol=1e-6)


@pytest.mark.parametrize(
    ("source", "angle"),
    [
        (Position(Sine(0.2, 2.0), exact=True), lambda t: 0.2 * np.sin(2 * TWO_PI * t)),
        (Speed(Ramp(height=2, duration=0.5), exact=True), lambda t: np.where(t < 0.5, 2 * t**2, 0.5 + 2 * (t - 0.5))),
        (Accelerate(Constant(3.0), phi=1.0, w=-2.0), lambda t: 1 - 2 * t + 1.5 * t**2),
        (Move(Constant(1.0), Constant(-2.0), Constant(3.0)), lambda t: 1 - 2 * t + 1.5 * t**2),
    ],
)
def test_a_moved_flange_goes_where_it_is_told(source: Component, angle: object) -> None:
    result = simulate(DriveTrain.series(source=source, shaft=Inertia(J=2.0)), 1.0, 100.0)
    assert callable(angle)
    np.testing.assert_allclose(result["shaft.phi"], angle(result.time_s), atol=1e-11)


def test_a_ramp_of_no_duration_is_a_step() -> None:
    shafts = [DriveTrain.series(t=Torque(s), shaft=Inertia(J=1)) for s in (Ramp(2, 0, 1, 0.53), Step(2, 1, 0.53))]
    ramp, step = (simulate(train, 1.0, 10.0)["shaft.w"] for train in shafts)
    np.testing.assert_array_equal(ramp, step)
