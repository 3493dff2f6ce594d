"""Motion sources tied to friction: drawn compositions against scipy, and closed forms of what once went wrong."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.errors import RunError, SimulationError
from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    Brake,
    Inertia,
    LossyGear,
    Position,
    Ramp,
    Sine,
    Speed,
    Spring,
    Step,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import Engine, simulate
from tests.sim.rotational.prescribed import Case, Contradiction, Truth, draw

RATE_HZ = 200.0
TIMES = np.arange(int(RATE_HZ) + 1) / RATE_HZ
ENGINES: tuple[Engine, ...] = ("exact", "runge-kutta")


def compare(case: Case, engine: Engine) -> None:
    """Angles, speeds and torques agree to 1e-6 of the largest; torques that jump at an event, not within a microsecond
    of it, nor where the shaft stands still and nothing determines what friction holds."""
    truth = Truth(case, TIMES)
    try:
        theta, omega, phi, w, torque, friction = truth.run().T
    except Contradiction:
        with pytest.raises(SimulationError):
            simulate(case.train, 1.0, RATE_HZ, engine=engine)
        return
    result = simulate(case.train, 1.0, RATE_HZ, engine=engine)
    ratio, largest = case.friction.ratio, max(np.abs(w).max(), np.abs(omega).max(), 1e-3)
    clear = np.ones(len(TIMES), dtype=bool)
    for instant in (*truth.events, *case.breaks, *(event.time_s for event in result.events)):
        clear &= np.abs(TIMES - instant) > 1e-6
    if case.link != "spring":
        clear &= (np.abs(w) > 1e-6 * largest) & (np.abs(omega) > 1e-6 * largest)
    loss = "friction.tauLoss" if "friction.tauLoss" in result.channels else "friction.tau"
    first = case.first_inertia * np.array([case.rate(t, p, v) for t, p, v in zip(TIMES, theta, omega, strict=True)])
    angle = max(np.abs(theta).max(), np.abs(phi).max(), 1e-3)
    force = max(np.abs(torque).max(), np.abs(friction).max(), np.abs(first).max(), 1e-2)

    def close(name: str, values: NDArray[np.float64], wanted: NDArray[np.float64], size: float) -> None:
        np.testing.assert_allclose(values, wanted, rtol=0, atol=1e-6 * size, err_msg=f"{case.name}: {name}")

    close("angle of the source", result["source.phi"], theta, angle)
    close("speed of the source", result["source.w"], omega, largest)
    close("angle of the body", result["body.phi"], phi / ratio, angle)
    close("speed of the body", result["body.w"], w / ratio, largest)
    close("torque of the source", -result["source.flange.tau"][clear], (torque / case.gear + first)[clear], force)
    close("friction", result[loss][clear], friction[clear], force)


@pytest.mark.parametrize("seed", range(16))
def test_a_drawn_composition_is_what_its_equations_say(seed: int) -> None:
    compare(draw(seed), "exact")


@pytest.mark.parametrize("seed", [2])
def test_the_other_engine_says_so_too(seed: int) -> None:
    compare(draw(seed), "runge-kutta")


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_two_thousand_drawn_compositions(block: int) -> None:
    for seed in range(100 * block, 100 * block + 100):
        compare(draw(seed), "exact")
        if seed % 20 == 0:
            compare(draw(seed), "runge-kutta")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("friction", [BearingFriction([[0, 2.0]]), Brake(fn_max=2.0, mu_pos=[[0, 1.0]])])
def test_a_speed_that_rises_from_rest_is_followed(friction: Component, engine: Engine) -> None:
    """J = 0.5 at 10 rad/s2 takes 5 N m, and 2 N m of friction."""
    train = DriveTrain.series(source=Speed(Ramp(10, 1), exact=True), friction=friction, shaft=Inertia(J=0.5))
    result = simulate(train, 0.5, 100.0, engine=engine)
    np.testing.assert_allclose(result["shaft.w"], 10 * result.time_s, atol=1e-12)
    np.testing.assert_allclose(result["source.flange.tau"], -7.0, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_alone_at_a_given_position(engine: Engine) -> None:
    """Nothing has inertia; the friction turns with the speed, at the crests of the cosine."""
    train = DriveTrain.series(
        source=Position(Sine(amplitude=0.1, f=1, phase=np.pi / 4, offset=0.5), exact=True),
        friction=BearingFriction([[0, 5.0], [100, 5.0]], peak=1.001),
    )
    result = simulate(train, 1.0, 100.0, engine=engine)
    assert [event.to_mode for event in result.events] == [-1, 1]
    np.testing.assert_allclose([event.time_s for event in result.events], [0.125, 0.625], atol=1e-9)
    sign = np.where((result.time_s < 0.125) | (result.time_s > 0.625), 1.0, -1.0)
    np.testing.assert_allclose(result["friction.tau"], 5.0 * sign, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_shaft_held_at_rest_leaves_friction_nothing_to_hold(engine: Engine) -> None:
    """Nothing determines how source and stuck friction share a spring's torque; friction has no more than its limit."""
    train = DriveTrain.series(
        source=Speed(Ramp(-10, 0.2, offset=10), exact=True),
        friction=BearingFriction([[0, 1.0]]),
        spring=Spring(c=100),
        body=Inertia(J=1),
    )
    result = simulate(train, 0.5, 100.0, engine=engine)
    held = result.time_s > 0.2
    np.testing.assert_allclose(result["source.flange.tau"][held], result["spring.tau"][held], atol=1e-9)
    assert np.abs(result["friction.tau"]).max() <= 1.0 + 1e-12


def test_a_filtered_step_into_a_lossy_gear() -> None:
    train = DriveTrain.series(
        source=Speed(Step(10.0), f_crit=50), gear=LossyGear(2, [0, 0.9, 0.9, 0.1, 0.1]), body=Inertia(J=1)
    )
    result = simulate(train, 0.1, 1000.0)
    np.testing.assert_allclose(result["body.w"], 5.0, rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_brake_whose_force_falls_to_zero_is_free(engine: Engine) -> None:
    train = DriveTrain.series(shaft=Inertia(J=1, w=10), brake=Brake(fn_max=3, f_normalized=Ramp(-1, 0.5, offset=1)))
    result = simulate(train, 1.0, 100.0, engine=engine)
    (event,) = result.events
    assert (event.from_name, event.to_name) == ("forward", "free")
    assert event.time_s == pytest.approx(0.5, abs=1e-12)
    assert result["brake.mode"][-1] == 2


def test_two_sources_that_contradict_each_other_are_refused() -> None:
    train = DriveTrain.series(one=Speed(Ramp(1, 1), exact=True), shaft=Inertia(J=1), two=Speed(Ramp(2, 1), exact=True))
    with pytest.raises(RunError):
        simulate(train, 0.1, 100.0)
