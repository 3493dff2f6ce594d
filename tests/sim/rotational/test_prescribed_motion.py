"""Motion sources tied to friction: closed forms of what once went wrong."""

import numpy as np
import pytest

from sim.errors import CompositionError
from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    Brake,
    Inertia,
    Ramp,
    Speed,
    Spring,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate


@pytest.mark.parametrize("friction", [BearingFriction([[0, 2.0]]), Brake(fn_max=2.0, mu_pos=[[0, 1.0]])])
def test_a_speed_that_rises_from_rest_is_followed(friction: Component) -> None:
    """J = 0.5 at 10 rad/s2 takes 5 N m, and 2 N m of friction."""
    train = DriveTrain.series(source=Speed(Ramp(10, 1), exact=True), friction=friction, shaft=Inertia(J=0.5))
    result = simulate(train, 0.5, 100.0)
    np.testing.assert_allclose(result["shaft.w"], 10 * result.time_s, atol=1e-12)
    np.testing.assert_allclose(result["source.flange.tau"], -7.0, rtol=1e-12)


def test_a_shaft_held_at_rest_leaves_friction_nothing_to_hold() -> None:
    """Nothing determines how source and stuck friction share a spring's torque; friction has no more than its limit."""
    train = DriveTrain.series(
        source=Speed(Ramp(-10, 0.2, offset=10), exact=True),
        friction=BearingFriction([[0, 1.0]]),
        spring=Spring(c=100),
        body=Inertia(J=1),
    )
    result = simulate(train, 0.5, 100.0)
    held = result.time_s > 0.2
    np.testing.assert_allclose(result["source.flange.tau"][held], result["spring.tau"][held], atol=1e-9)
    assert np.abs(result["friction.tau"]).max() <= 1.0 + 1e-12


def test_a_brake_whose_force_falls_to_zero_is_free() -> None:
    train = DriveTrain.series(shaft=Inertia(J=1, w=10), brake=Brake(fn_max=3, f_normalized=Ramp(-1, 0.5, offset=1)))
    result = simulate(train, 1.0, 100.0)
    (event,) = result.events
    assert (event.from_name, event.to_name) == ("forward", "free")
    assert event.time_s == pytest.approx(0.5, abs=1e-12)
    assert result["brake.mode"][-1] == 2


def test_two_sources_of_motion_on_one_shaft_are_refused() -> None:
    train = DriveTrain.series(one=Speed(Ramp(1, 1), exact=True), shaft=Inertia(J=1), two=Speed(Ramp(2, 1), exact=True))
    with pytest.raises(CompositionError, match=r"two: .* moved by one"):
        simulate(train, 0.1, 100.0)
