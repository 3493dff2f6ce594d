"""The engines against each other, against the sample rate, and against a disturbance."""

from dataclasses import replace

import numpy as np
import pytest

from sim.errors import RunError
from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    ElastoBacklash,
    Gearbox,
    Inertia,
    LossyGear,
    QuadraticSpeedDependentTorque,
    Sine,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Trajectory
from sim.solver import simulate
from tests.sim.rotational import modelica_examples as examples

STATES = ("motor.phi", "motor.w", "gear.elastoBacklash.phi_rel", "gear.elastoBacklash.w_rel")


def axis(load: float = 20.0, **mesh: float) -> DriveTrain:
    """The paper's axis; more damped or with more play as wanted."""
    return DriveTrain.series(
        torque=Torque(Sine(12.0, 0.45)),
        motor=Inertia(J=0.6),
        gear=Gearbox(ratio=100, lossTable=[0, 0.9, 0.9, 0.9, 0.9], c=1e5, **mesh),
        load=Inertia(J=load),
    )


def difference(a: Trajectory, b: Trajectory, names: tuple[str, ...] = STATES, step: int = 1) -> float:
    """Largest difference of any channel relative to its range."""
    return max(float(np.abs(a[name][::step] - b[name]).max() / np.ptp(b[name])) for name in names)


@pytest.mark.parametrize(
    "train",
    [axis(d=200, b=1e-3), axis(50, d=200), axis(40, d=1000, b=1e-3)],
    ids=["backlash", "no backlash", "strongly damped"],
)
def test_exact_and_runge_kutta_agree_on_damped_axes(train: DriveTrain) -> None:
    exact, other = (simulate(train, 3.0, 200.0, engine=engine) for engine in ("exact", "runge-kutta"))
    assert difference(exact, other) < 1e-9
    assert [e[1:] for e in exact.events] == [e[1:] for e in other.events]
    assert (exact.engine, other.engine) == ("exact", "runge-kutta")


@pytest.mark.parametrize("build", [examples.friction, examples.coupled_clutches, examples.one_way_clutch])
def test_clutches_and_brakes_agree(build: object) -> None:
    train = build()  # type: ignore[operator]
    exact, other = (simulate(train, 1.4, 200.0, engine=engine) for engine in ("exact", "runge-kutta"))
    names = tuple(f"{name}.w" for name, part in train.components.items() if isinstance(part, Inertia))
    assert difference(exact, other, names) < 1e-9


def test_the_solution_does_not_depend_on_the_sample_rate() -> None:
    train = axis(d=200, b=1e-3)
    assert difference(simulate(train, 10.0, 8000.0), simulate(train, 10.0, 1000.0), step=8) < 1e-9


def test_the_error_of_a_long_damped_run_stays_small_at_any_rate() -> None:
    """Not one order of the step, but none: at a sixteenth of the rate the difference is rounding."""
    train = axis(40, d=1000, b=1e-3)
    fine = simulate(train, 30.0, 8000.0)
    for divisor in (2, 4, 16):
        assert difference(fine, simulate(train, 30.0, 8000.0 / divisor), step=divisor) < 1e-10


def test_undamped_backlash_is_chaotic() -> None:
    """A start 1e-12 rad away is another motion after some seconds, in any engine: that is the system, not the solver.

    With damping the same disturbance stays small. So runs with undamped backlash agree over the first seconds and
    only statistically later; compare features of them, not samples.
    """

    def growth(train: DriveTrain) -> np.ndarray:
        mesh = train["gear.elastoBacklash"]
        assert isinstance(mesh, ElastoBacklash)
        moved = train.replace("gear.elastoBacklash", replace(mesh, phi_rel=1e-12))
        pair = [simulate(one, 30.0, 200.0)["load.w"] for one in (train, moved)]
        return np.abs(pair[0] - pair[1]) / np.ptp(pair[0])

    wild, tame = growth(axis(d=0, b=1e-3)), growth(axis(d=1000, b=1e-3))
    assert wild[:400].max() < 1e-6
    assert wild[2000:].max() > 1e-3
    assert tame.max() < 1e-8


def test_events_do_not_storm_where_the_gap_is_negligible() -> None:
    result = simulate(axis(d=0, b=1e-11), 2.0, 500.0)
    assert not [event for event in result.events if event.component == "gear.elastoBacklash"]


def test_one_loss_law_in_one_row_or_many() -> None:
    """A table of equal rows is not affine by its form, but the same law: both engines agree."""
    row = [0.9, 0.8, 0.3, 0.5]

    def train(table: list[list[float]]) -> DriveTrain:
        return DriveTrain.series(
            torque=Torque(Sine(12.0, 1.0)),
            motor=Inertia(J=0.6),
            gear=LossyGear(ratio=5, lossTable=table),
            load=Inertia(J=20),
        )

    flat = simulate(train([[0, *row]]), 2.0, 200.0)
    bent = simulate(train([[0, *row], [50, 0.9, 0.8, 0.3, 0.5000001]]), 2.0, 200.0, engine="runge-kutta")
    np.testing.assert_allclose(bent["load.w"], flat["load.w"], atol=2e-8)
    assert [e[1:] for e in bent.events] == [e[1:] for e in flat.events]


def test_efficiency_that_depends_on_speed_needs_runge_kutta() -> None:
    train = DriveTrain.series(
        torque=Torque(Sine(12.0, 1.0)),
        motor=Inertia(J=0.6),
        gear=LossyGear(ratio=5, lossTable=[[0, 0.9, 0.9, 0.5, 0.5], [1, 0.6, 0.6, 1, 1], [2, 0.5, 0.5, 1, 1]]),
        load=Inertia(J=20),
    )
    assert not train.affine
    with pytest.raises(RunError, match="gear is not"):
        simulate(train, 1.0, engine="exact")
    result = simulate(train, 1.0, 500.0, engine="runge-kutta")
    power_in = result["torque.tau"] * result["motor.w"]
    assert result.engine == "runge-kutta"
    assert np.ptp(result["load.w"]) > 0.01
    assert result["gear.lossPower"].min() >= -1e-9
    assert power_in.max() > 0


def test_a_gear_shift_changes_the_ratio() -> None:
    """The brake holds the ring: 1/(1 + ratio) of the engine's speed; the clutch locks ring to sun: all of it."""
    result = simulate(examples.simple_gear_shift(), 3.0, 100.0)
    before, after = result.time_s < 2.0, result.time_s > 2.3
    np.testing.assert_allclose(result["load.w"][before], result["engine.w"][before] / 2.5, atol=1e-9)
    np.testing.assert_allclose(result["load.w"][after], result["engine.w"][after], atol=1e-9)


def test_quadratic_drag_ends_at_its_balance() -> None:
    drag: Component = QuadraticSpeedDependentTorque(tau_nominal=-20, w_nominal=10, TorqueDirection=False)
    train = DriveTrain.series(torque=Torque(Sine(5.0, 1e-6, phase=np.pi / 2)), shaft=Inertia(J=0.1), drag=drag)
    assert simulate(train, 5.0, 50.0)["shaft.w"][-1] == pytest.approx(5.0, rel=1e-6)


def test_coupled_friction_is_decided_together() -> None:
    """Two equal frictions on one shaft hold twice the torque of one and let go as one."""
    one = BearingFriction(tau_pos=[0, 2.0])
    train = DriveTrain.series(torque=Torque(Sine(5.0, 1.0)), a=one, shaft=Inertia(J=1), b=one)
    released = [event for event in simulate(train, 0.25).events if event.to_name == "forward"]
    assert {event.component for event in released} == {"a", "b"}
    assert {event.time_s for event in released} == {released[0].time_s}
    assert released[0].time_s == pytest.approx(np.arcsin(4 / 5) / (2 * np.pi), abs=1e-12)
