"""What is not affine: numbers that depend on one row of the state by a curve, in an otherwise linear law."""

import numpy as np
import pytest

from sim.errors import RunError
from sim.piecewise_affine.system import System, curve_value
from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    Brake,
    Clutch,
    ConstantTorque,
    EddyCurrentTorque,
    Inertia,
    InverseSpeedDependentTorque,
    LossyGear,
    OneWayClutch,
    QuadraticSpeedDependentTorque,
    SignTorque,
    Sine,
    Spring,
)
from sim.rotational.curves import Curve, Shape
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate
from tests.sim.rotational.modelica_examples import heat_losses, simple_gear_shift

STRIBECK = [[0, 0.5], [1, 0.3], [4, 0.6]]
BENT: list[Component] = [
    LossyGear(ratio=2, lossTable=[[0, 0.8, 0.8, 1, 1], [1, 0.7, 0.6, 2, 2]]),
    BearingFriction(tau_pos=STRIBECK),
    Clutch(fn_max=2, mu_pos=STRIBECK, f_normalized=Sine(1, 2)),
    OneWayClutch(fn_max=2, mu_pos=STRIBECK, f_normalized=Sine(1, 2)),
    Brake(fn_max=2, mu_pos=STRIBECK, f_normalized=Sine(1, 2)),
    QuadraticSpeedDependentTorque(-1, 10),
    InverseSpeedDependentTorque(-1, 2, TorqueDirection=False),
    SignTorque(-1, reg="CoSine"),
    EddyCurrentTorque(1, 10),
]


@pytest.mark.parametrize("part", BENT, ids=lambda part: type(part).__name__)
def test_equations_are_affine_in_the_values_of_their_curves(part: Component) -> None:
    """What the compiled engine takes for granted of every component that has curves."""
    system = System(DriveTrain.series(left=Inertia(J=1), part=part, right=Inertia(J=2)))
    i = system.names.index("part")
    rng = np.random.default_rng(4)
    curves = 0
    for number in range(system.branch_counts[i]):
        probe = rng.uniform(0.1, 2, 12)
        v = system.rows[i]
        v.curves, v.probe = [], tuple(probe)
        branch = part.branch(v, number)
        constant, units = system._probed(i, number, ())[0], np.eye(12)
        parts = [system._probed(i, number, tuple(unit))[0].minus(constant) for unit in units]
        curves += len(system.curved(i, number).curves)
        for flange, row in branch.torques.items():
            pieces = [piece.branch.torques[flange] for piece in (constant, *parts)]
            wanted = pieces[0] + sum(c * (p - pieces[0]) for c, p in zip(probe, pieces[1:], strict=True))
            np.testing.assert_allclose(row, wanted, atol=1e-12)
        wanted = constant.holds + sum(c * p.holds for c, p in zip(probe, parts, strict=True))
        np.testing.assert_allclose(np.array([*branch.holds, *branch.strict]).reshape(wanted.shape), wanted, atol=1e-12)
        wanted = constant.equations + sum(c * p.equations for c, p in zip(probe, parts, strict=True))
        np.testing.assert_allclose(np.array(branch.equations).reshape(wanted.shape), wanted, atol=1e-12)
    assert curves


def test_a_table_is_straight_between_its_rows_and_beyond_them() -> None:
    curve = Curve(Shape.TABLE, ((0.0, 0.5), (1.0, 0.3), (4.0, 0.6)))
    values = [curve_value(curve, s) for s in (-1.0, 0.0, 0.5, 1.0, 2.0, 4.0, 5.0)]
    assert values == pytest.approx([0.5, 0.5, 0.4, 0.3, 0.4, 0.6, 0.7])


def test_the_driver_changes_where_both_pieces_of_the_loss_meet() -> None:
    """(1 - eta1) tau + bf1 = (1 - 1/eta2) tau + bf2."""
    eta1, eta2, bf1, bf2 = 0.8, 0.7, 0.3, 0.5
    tau = curve_value(Curve(Shape.DRIVER, ((0.0, eta1, eta2, bf1, bf2),)), 3.0)
    assert (1 - eta1) * tau + bf1 == pytest.approx((1 - 1 / eta2) * tau + bf2)


def test_a_brake_is_free_from_the_instant_that_nothing_presses_it() -> None:
    """Modelica's SimpleGearShift: while the clutch takes hold the brake lets go, slips, and is free at 2.1 s."""
    events = simulate(simple_gear_shift(), 2.2, 100.0).events
    assert [event[2:4] for event in events if event.component == "brake"] == [(0, 1), (1, 2)]
    assert events[2] == (pytest.approx(2.1, abs=1e-12), "brake", 1, 2, "forward", "free")


def test_an_efficiency_that_reaches_zero_is_named() -> None:
    gear = LossyGear(ratio=1, lossTable=[[0, 0.9, 0.9, 0.1, 0.1], [10, 0.5, 0.5, 0.1, 0.1]])
    train = DriveTrain.series(torque=ConstantTorque(5), left=Inertia(J=1), gear=gear, right=Inertia(J=1, w=1))
    train = train.add("more", ConstantTorque(20), flange="right.flange_b")
    with pytest.raises(RunError, match=r"LossyGear\.lossTable: the efficiency is not above zero at 22\.5 rad/s"):
        simulate(train, 60.0, 10.0)


def test_heat_losses_keep_the_balance_of_energy() -> None:
    """What the source puts in is in motion, in springs, or lost: Modelica's HeatLosses, through its first events."""
    rate = 40_000.0
    result = simulate(heat_losses(), 0.2, rate)
    parts = heat_losses().components
    stored = sum(0.5 * part.J * result[f"{name}.w"] ** 2 for name, part in parts.items() if isinstance(part, Inertia))
    for name in ("springDamper", "spring3"):
        part = parts[name]
        stiffness = part.c if isinstance(part, Spring) else 1e4
        stored = stored + 0.5 * stiffness * result[f"{name}.phi_rel"] ** 2
    taken = result["elastoBacklash.tau"] * result["elastoBacklash.w_rel"]  # stored and lost
    losses = [channel for channel in result.channels if channel.endswith("lossPower")]
    losses.remove("elastoBacklash.lossPower")
    lost = taken + sum(result[channel] for channel in losses)
    power = result["torque.tau"] * result["inertia1.w"] - lost
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]))]) / rate
    assert len(result.events) > 10
    assert np.abs(stored - work).max() < 1e-4 * np.abs(stored).max()
