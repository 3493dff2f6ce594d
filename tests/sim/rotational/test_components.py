"""What every component and every signal of the catalogue must keep to."""

from itertools import pairwise

import numpy as np
import pytest

import sim.rotational.components as parts
from sim.piecewise_affine.system import System
from sim.rotational.component import Component, Signal
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate

SINE = parts.Sine(amplitude=2.0, f=3.0)
SPECIMENS = {type(part): part for part in (
    parts.Inertia(J=2), parts.Spring(c=100), parts.Damper(d=1), parts.SpringDamper(c=100, d=1),
    parts.ElastoBacklash(c=100, d=1, b=0.01), parts.ElastoBacklash2(c=100, d=1, b=0.01), parts.IdealGear(ratio=-3),
    parts.IdealPlanetary(ratio=1.5), parts.LossyGear(ratio=3, lossTable=[[0, 0.9, 0.8, 0.1, 0.2]]),
    parts.BearingFriction(tau_pos=[[0, 0.1], [1, 0.2]], peak=1.2), parts.Brake(fn_max=1),
    parts.Clutch(fn_max=1, f_normalized=SINE), parts.OneWayClutch(fn_max=1), parts.Fixed(), parts.Torque(SINE),
    parts.Torque2(SINE), parts.ConstantTorque(1), parts.TorqueStep(1, startTime=0.1),
    parts.LinearSpeedDependentTorque(-1, 10), parts.Position(SINE), parts.Speed(SINE), parts.ConstantSpeed(1),
    parts.Accelerate(SINE), parts.Move(SINE, SINE, SINE), parts.Disc(deltaPhi=0.3), parts.RelativeStates(),
    parts.IdealGearR2T(ratio=4), parts.IdealRollingWheel(radius=0.3), parts.Mass(m=2), parts.AngleSensor(),
    parts.SpeedSensor(), parts.AccSensor(), parts.RelAngleSensor(), parts.RelSpeedSensor(), parts.RelAccSensor(),
    parts.TorqueSensor(), parts.PowerSensor(), parts.MultiSensor(),
)}  # fmt: skip


@pytest.mark.parametrize("kind", parts.COMPONENTS, ids=lambda kind: kind.__name__)
def test_a_component_keeps_to_its_contract(kind: type[Component]) -> None:
    """It simulates between two driven shafts, its channels have units, its flange torques sum to the inertia's."""
    part = SPECIMENS[kind]
    train = DriveTrain.series(torque=parts.Torque(SINE), left=parts.Inertia(J=1), part=part)
    through = [flange for flange in part.flanges if flange not in part.grounded]
    for i, flange in enumerate(through[1:]):
        train = train.add(f"right{i}", parts.Inertia(J=1), flange_a=f"part.{flange}")
    result = simulate(train, 0.5, 200.0)
    assert kind.__doc__
    for name in (name for name in result.channels if name.startswith("part.")):
        assert result.units[name]
        assert np.all(np.isfinite(result[name]))


STEADY = [kind for kind, part in SPECIMENS.items() if kind not in (parts.Inertia, parts.Mass, parts.Fixed)]


@pytest.mark.parametrize("kind", STEADY, ids=lambda kind: kind.__name__)
def test_torques_of_a_component_are_in_balance(kind: type[Component]) -> None:
    """No component makes angular momentum: with its support, the torques into a massless component sum to zero.

    A gear has its support for that; an inertia stores, a brake or bearing has its support.
    """
    part = SPECIMENS[kind]
    system = System(DriveTrain({"part": part, "wall": parts.Fixed()}, (("part." + part.flanges[-1], "wall.flange"),)))
    for piece in system.pieces[0]:
        total = sum(piece.branch.torques.values())
        if set(part.flanges) <= set(piece.branch.torques):
            np.testing.assert_allclose(total, 0, atol=1e-12)


SIGNALS: list[Signal] = [
    parts.Constant(3.0),
    parts.Sine(2.0, 3.0, phase=0.4, offset=1.0, startTime=0.31),
    parts.ExpSine(2.0, 3.0, phase=0.4, offset=1.0, startTime=0.31, damping=1.7),
    parts.Step(2.0, 1.0, 0.5),
    parts.Ramp(3.0, 0.7, -1.0, 0.2),
    parts.Pulse(2.0, 0.3, 40, 1.0, 0.1),
    parts.Sampled(np.array([0.0, 2.0, -1.0, 4.0]), 3.0, startTime=0.2),
    parts.Product(parts.Sine(2.0, 3.0, offset=0.5), parts.Step(-1.0, 1.0, 0.6)),
]


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda signal: type(signal).__name__)
def test_a_signal_obeys_its_own_equation_between_breakpoints(signal: Signal) -> None:
    """Continued from the start of a piece by its damped oscillation, it is the signal to the piece's end."""
    edges = [0.0, *signal.breakpoints(0.0, 2.0), 2.0]
    for begin, end in pairwise(edges):
        times = np.linspace(begin, end, 20, endpoint=False)
        level, swing, rate = signal.pieces(np.array([begin]))[0]
        elapsed, omega = times - begin, signal.omega
        rate += signal.damping * swing
        turned = swing * np.cos(omega * elapsed) + (np.sin(omega * elapsed) * rate / omega if omega else rate * elapsed)
        turned *= np.exp(-signal.damping * elapsed)
        np.testing.assert_allclose(signal(times), level + turned, atol=1e-12)
