"""Components that came last: closed forms."""

import numpy as np
import pytest

from sim.rotational.components import (
    AccSensor,
    ConstantTorque,
    Damper,
    Disc,
    ExpSine,
    IdealGearR2T,
    IdealRollingWheel,
    Inertia,
    Mass,
    MultiSensor,
    RelativeStates,
    RelSpeedSensor,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate


def test_a_torque_that_dies_away_gives_its_momentum() -> None:
    """The integral of A exp(-d t) sin(w t) over all time is A w / (w^2 + d^2)."""
    train = DriveTrain.series(torque=Torque(ExpSine(3.0, f=1.5, damping=8.0)), shaft=Inertia(J=0.5))
    result = simulate(train, 4.0, 50.0)
    omega = 3 * np.pi
    assert result["shaft.w"][-1] == pytest.approx(3.0 * omega / (omega**2 + 64.0) / 0.5, rel=1e-9)


@pytest.mark.parametrize("part", [IdealRollingWheel(radius=0.25), IdealGearR2T(ratio=4.0)])
def test_a_wheel_or_rack_moves_a_mass(part: IdealRollingWheel | IdealGearR2T) -> None:
    """5 N m on J = 0.5 and 8 kg at 0.25 m: J + m r^2 = 1, so 5 rad/s2."""
    train = DriveTrain.series(torque=ConstantTorque(5.0), shaft=Inertia(J=0.5), part=part, mass=Mass(m=8.0))
    result = simulate(train, 1.0, 100.0)
    np.testing.assert_allclose(result["mass.s"], 0.25 * 2.5 * result.time_s**2, atol=1e-12)
    np.testing.assert_allclose(result["part.flangeT.f"], -8.0 * 1.25, rtol=1e-12)
    assert result.units["mass.s"] == "m"


def test_a_disc_turns_its_ends_and_sensors_show_what_they_should() -> None:
    train = DriveTrain.series(
        torque=ConstantTorque(4.0),
        sensor=MultiSensor(),
        left=Inertia(J=1.0),
        disc=Disc(deltaPhi=0.3),
        right=Inertia(J=1.0),
    )
    train = train.add("acceleration", AccSensor(), flange="right.flange_b")
    result = simulate(train, 1.0, 50.0)
    np.testing.assert_allclose(result["right.phi"] - result["left.phi"], 0.3, atol=1e-12)
    np.testing.assert_allclose(result["acceleration.a"], 2.0, rtol=1e-12)
    np.testing.assert_allclose(result["sensor.power"], 4.0 * 2.0 * result.time_s, atol=1e-11)


def test_relative_states_give_relative_start_values() -> None:
    train = DriveTrain.series(left=Inertia(J=1.0, w=3.0), damper=Damper(d=0.5), right=Inertia(J=1.0))
    train = train.add("states", RelativeStates(w_rel=-2.0), flange_a="left.flange_a", flange_b="right.flange_a")
    train = train.add("seen", RelSpeedSensor(), flange_a="left.flange_a", flange_b="right.flange_a")
    result = simulate(train, 1.0, 50.0)
    np.testing.assert_allclose(result["seen.w_rel"], -2.0 * np.exp(-result.time_s), rtol=1e-10)
