"""What is known in closed form: release of friction, contact, oscillation, energy, parts without inertia."""

import math

import numpy as np
import pytest
from scipy.integrate import simpson

from sim.rotational.components import (
    BearingFriction,
    Damper,
    ElastoBacklash,
    Fixed,
    IdealGear,
    Inertia,
    LossyGear,
    Position,
    Ramp,
    Sampled,
    Sine,
    Spring,
    Step,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate


@pytest.mark.parametrize("peak", [1.0, 1.3])
def test_a_stuck_shaft_is_released_when_the_torque_reaches_the_limit(peak: float) -> None:
    amplitude, f, limit = 5.0, 2.0, 2.0
    train = DriveTrain.series(
        torque=Torque(Sine(amplitude, f)),
        friction=BearingFriction(tau_pos=[0, limit], peak=peak),
        shaft=Inertia(J=0.3),
    )
    release = next(event for event in simulate(train, 0.2).events if event.to_name == "forward")
    assert release.time_s == pytest.approx(math.asin(peak * limit / amplitude) / (2 * math.pi * f), abs=1e-13)


def test_undamped_contact_lasts_half_a_period() -> None:
    c, j1, j2, b = 1e5, 0.5, 20.0, 1e-3
    train = DriveTrain.series(
        a=Inertia(J=j1, phi=0, w=1.0), contact=ElastoBacklash(c=c, b=b), b=Inertia(J=j2, phi=0, w=0)
    )
    result = simulate(train, 0.2)
    times = [event.time_s for event in result.events[:2]]
    assert times[0] == pytest.approx(b / 2, rel=1e-12)
    assert times[1] - times[0] == pytest.approx(math.pi * math.sqrt(j1 * j2 / (j1 + j2) / c), rel=1e-12)
    free = int((times[1] + b / 2) * 8000)
    assert result["a.w"][free] - result["b.w"][free] == pytest.approx(-1.0, abs=1e-12)


def test_momentum_is_kept_through_gear_and_contacts() -> None:
    train = DriveTrain.series(
        a=Inertia(J=0.5, phi=0, w=1.0),
        gear=IdealGear(ratio=10),
        mesh=ElastoBacklash(c=1e4, b=1e-2, d=20),
        b=Inertia(J=20, w=-0.2),
    )
    result = simulate(train, 2.0)
    momentum = 10 * 0.5 * result["a.w"] + 20 * result["b.w"]
    assert len(result.events) > 4
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-12)


def test_work_of_the_torque_is_motion_plus_spring_plus_losses() -> None:
    train = DriveTrain.series(
        torque=Torque(Sine(12.0, 2.0)),
        motor=Inertia(J=0.6),
        friction=BearingFriction(tau_pos=[[0, 0.5], [1, 0.6]]),
        gear=LossyGear(ratio=20, lossTable=[0, 0.9, 0.8, 0.3, 0.5]),
        mesh=ElastoBacklash(c=1e5, b=0.0, d=300),
        load=Inertia(J=20),
    )
    rate = 40_000.0
    result = simulate(train, 2.0, rate)
    losses = result["friction.lossPower"] + result["gear.lossPower"] + result["mesh.lossPower"]
    work = simpson(result["torque.tau"] * result["motor.w"] - losses, dx=1 / rate)
    kinetic = 0.3 * result["motor.w"][-1] ** 2 + 10 * result["load.w"][-1] ** 2
    stored = 0.5e5 * result["mesh.phi_rel"][-1] ** 2
    assert work == pytest.approx(kinetic + stored, rel=1e-6)
    assert losses.min() >= -1e-9


def test_two_inertias_swing_at_their_frequency() -> None:
    j1, j2, c = 0.6, 20.0, 1e5
    train = DriveTrain.series(
        a=Inertia(J=j1), gear=IdealGear(ratio=100), spring=Spring(c=c, phi_rel=0.01), b=Inertia(J=j2, phi=0, w=0)
    )
    result = simulate(train, 1.0, 1000.0)
    omega = math.sqrt(c * (1 / j2 + 1 / (100**2 * j1)))
    np.testing.assert_allclose(result["spring.phi_rel"], 0.01 * np.cos(omega * result.time_s), atol=1e-13)


def test_spring_and_damper_in_series_relax() -> None:
    """A spring stretched by s against a damper: its twist decays with d/c, nothing else moves."""
    c, d, s = 100.0, 5.0, 0.2
    train = DriveTrain.series(fixed=Fixed(), spring=Spring(c=c, phi_rel=s), damper=Damper(d=d), wall=Fixed(phi0=0.3))
    result = simulate(train, 0.5, 1000.0)
    np.testing.assert_allclose(result["spring.phi_rel"], s * np.exp(-c / d * result.time_s), atol=1e-13)


def test_a_sampled_torque_is_straight_between_samples() -> None:
    """A ramp given by 7 samples per second moves the shaft exactly as the ramp."""
    values = np.linspace(0.0, 10.0, 15)
    sampled = DriveTrain.series(torque=Torque(Sampled(values, 7.0)), shaft=Inertia(J=2))
    ramp = DriveTrain.series(torque=Torque(Ramp(height=10, duration=2.0)), shaft=Inertia(J=2))
    a, b = simulate(sampled, 2.0, 1000.0), simulate(ramp, 2.0, 1000.0)
    np.testing.assert_allclose(a["shaft.phi"], b["shaft.phi"], atol=1e-12)


def test_a_step_between_samples_acts_at_its_own_time() -> None:
    train = DriveTrain.series(torque=Torque(Step(2.0, startTime=0.12345)), shaft=Inertia(J=1))
    result = simulate(train, 1.0, 100.0)
    assert result["shaft.phi"][-1] == pytest.approx((1 - 0.12345) ** 2, rel=1e-13)


def test_exact_position_is_followed_and_its_torque_is_known() -> None:
    train = DriveTrain.series(source=Position(Sine(0.5, 2.0), exact=True), shaft=Inertia(J=3))
    result = simulate(train, 2.0, 1000.0)
    omega = 4 * math.pi
    np.testing.assert_allclose(result["shaft.phi"], 0.5 * np.sin(omega * result.time_s), atol=1e-12)
    np.testing.assert_allclose(
        result["source.flange.tau"], 3 * 0.5 * omega**2 * np.sin(omega * result.time_s), atol=1e-9
    )
