"""Random compositions: whatever is connected runs, and moves alike at any sample rate."""

import numpy as np
import pytest

from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    Brake,
    Clutch,
    ElastoBacklash,
    IdealGear,
    Inertia,
    LinearSpeedDependentTorque,
    LossyGear,
    OneWayClutch,
    Sampled,
    Sine,
    SpringDamper,
    Step,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate


def part(rng: np.random.Generator) -> Component:
    """A component that stands between two inertias."""
    u = rng.uniform
    loss = [0, u(0.5, 1), u(0.5, 1), u(0, 1), u(0, 1)]
    makers = (
        lambda: IdealGear(rng.choice([-3.0, 0.5, 10.0])),
        lambda: LossyGear(rng.choice([0.5, 2.0, 5.0]), loss),
        lambda: LossyGear(2.0, [0, 0.8, 0.7, 0, 0]),
        lambda: SpringDamper(c=10 ** u(2, 4), d=u(0.1, 30)),
        lambda: ElastoBacklash(c=10 ** u(2, 4), b=10 ** u(-3, -1), d=u(3, 30), law=rng.choice(["linear", "elasto"])),
        lambda: BearingFriction([[0, u(0.1, 3)], [1, u(3, 4)]], peak=rng.choice([1.0, 1.3])),
        lambda: Clutch(fn_max=u(1, 20), f_normalized=Sine(1, u(0.3, 2), u(0, 6)), peak=rng.choice([1.0, 1.2])),
        lambda: OneWayClutch(fn_max=u(1, 10)),
        lambda: Brake(fn_max=u(1, 10), f_normalized=Step(startTime=u(0, 0.4))),
    )
    return makers[rng.integers(len(makers))]()


def random_train(seed: int) -> DriveTrain:
    """A driven chain of one to three such components; the same seed gives the same train."""
    rng = np.random.default_rng(seed)
    sine = Sine(rng.uniform(1, 20), rng.uniform(0.5, 8), rng.uniform(0, 6))
    drive = sine if rng.random() < 0.7 else Sampled(8 * rng.normal(size=20), 30.0)
    parts: dict[str, Component] = {"drive": Torque(drive), "J0": Inertia(J=10 ** rng.uniform(-1, 1))}
    for k in range(1, rng.integers(2, 5)):
        parts[f"part{k}"] = part(rng)
        parts[f"J{k}"] = Inertia(J=10 ** rng.uniform(-1, 1))
    if rng.random() < 0.4:
        parts["bearing"] = BearingFriction([0, rng.uniform(0.1, 2)])
    if rng.random() < 0.3:
        parts["drag"] = LinearSpeedDependentTorque(-rng.uniform(0.1, 3), 2.0, TorqueDirection=bool(rng.integers(2)))
    return DriveTrain.series(**parts)


@pytest.mark.parametrize("seed", [*range(30), 51])
def test_a_random_train_runs_and_is_the_same_at_another_rate(seed: int) -> None:
    train = random_train(seed)
    fine, coarse = simulate(train, 0.6, 1000.0), simulate(train, 0.6, 125.0)
    for name in (name for name in train.components if name.startswith("J")):
        speed = fine[f"{name}.w"]
        np.testing.assert_allclose(speed[::8], coarse[f"{name}.w"], atol=1e-8 * (1e-3 + np.abs(speed).max()))
