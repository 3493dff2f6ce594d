"""The engines against each other, against the sample rate, and against a disturbance."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sim.errors import CompositionError, ParameterError
from sim.rotational.component import Component, Signal
from sim.rotational.components import (
    BearingFriction,
    Clutch,
    ConstantSpeed,
    ElastoBacklash,
    Fixed,
    Gearbox,
    Inertia,
    LossyGear,
    Ramp,
    Sine,
    Spring,
    Step,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Trajectory
from sim.solver import Engine, simulate
from tests.sim.drawn_axes import drawn_axis

ENGINES: tuple[Engine, ...] = ("exact", "chain")
GEAR = [0, 0.9, 0.9, 0, 0]
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
def test_exact_and_chain_agree_on_damped_axes(train: DriveTrain) -> None:
    """Matrix exponentials and Runge-Kutta share no code: modes, instants of events and states are the same."""
    exact, other = (simulate(train, 3.0, engine=engine) for engine in ENGINES)
    assert difference(exact, other) < 1e-8
    assert [e[1:4] for e in exact.events] == [e[1:4] for e in other.events]
    assert [e.time_s for e in exact.events] == pytest.approx([e.time_s for e in other.events], abs=1e-9)
    assert (exact.engine, other.engine) == ENGINES


def lasting_modes(run: Trajectory, components: set[str]) -> list[tuple[float, str, int]]:
    """Changes into modes that last; one left within a nanosecond is rounding."""
    events = [event for event in run.events if event.component in components]
    return [
        (event.time_s, event.component, event.to_mode)
        for i, event in enumerate(events)
        if not any(
            later.component == event.component and later.time_s < event.time_s + 1e-9 for later in events[i + 1 :]
        )
    ]


@pytest.mark.parametrize("seed", range(25))
def test_both_engines_agree_on_drawn_axes(seed: int) -> None:
    exact, chain = (simulate(drawn_axis(seed), 1.0, engine=engine) for engine in ENGINES)
    names = tuple(name for name in chain.channels if name.endswith((".phi", ".w")))
    assert difference(exact, chain, names) < 1e-7
    one, other = (lasting_modes(run, {event.component for event in chain.events}) for run in (exact, chain))
    assert [event[1:] for event in one] == [event[1:] for event in other]
    assert [event[0] for event in one] == pytest.approx([event[0] for event in other], abs=1e-6)


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


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (lambda: LossyGear(5, [[0, 0.9, 0.9, 0.5, 0.5], [1, 0.6, 0.6, 1, 1]]), "efficiencies must be the same"),
        (lambda: Clutch(fn_max=1, mu_pos=[[0, 0.5], [5, 0.3]], f_normalized=Sine(1, 1)), "product of speed and signal"),
    ],
)
def test_a_law_that_multiplies_two_variables_is_refused(part: Callable[[], Component], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        part()


def test_what_cannot_be_simulated_is_refused_in_true_words() -> None:
    loop = DriveTrain.series(torque=Torque(Sine(1.0, 1.0)), a=Inertia(J=1), g=LossyGear(2, GEAR), b=Inertia(J=1))
    loop = loop.add("h", LossyGear(2, GEAR), flange_a="a.flange_b", flange_b="b.flange_a")
    fixed = DriveTrain.series(fixed=Fixed(), source=ConstantSpeed(1.0))
    for train, words in ((loop, r"loop of rigid parts \(g, h\)"), (fixed, "is fixed"), (DriveTrain(), "at least one")):
        with pytest.raises(CompositionError, match=words):
            simulate(train, 1.0, 100.0)


def test_coupled_friction_is_decided_together() -> None:
    """Two equal frictions on one shaft hold twice the torque of one and let go as one."""
    one = BearingFriction(tau_pos=[0, 2.0])
    train = DriveTrain.series(torque=Torque(Sine(5.0, 1.0)), a=one, shaft=Inertia(J=1), b=one)
    released = [event for event in simulate(train, 0.25).events if event.to_name == "forward"]
    assert {event.component for event in released} == {"a", "b"}
    assert {event.time_s for event in released} == {released[0].time_s}
    assert released[0].time_s == pytest.approx(np.arcsin(4 / 5) / (2 * np.pi), abs=1e-12)


@pytest.mark.parametrize("signal", [Step(1.0, 0.5, 0.3), Ramp(1.0, 0.5), Sine(1.0, 0.5, 0.4)])
def test_a_free_spring_end_follows_its_torque_at_once(signal: Signal) -> None:
    train = DriveTrain.series(shaft=Inertia(J=2.0, phi=0.3, w=-0.2), spring=Spring(c=50.0), torque=Torque(signal))
    result = simulate(train, 1.0, 100.0)
    np.testing.assert_allclose(result["spring.tau"], signal(result.time_s), atol=1e-12)
