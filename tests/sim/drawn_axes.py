"""Axes of one to three stages with everything that both engines can have, drawn from a seed."""

from __future__ import annotations

import math

import numpy as np

from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    ElastoBacklash,
    IdealGear,
    Inertia,
    LossyGear,
    Sampled,
    Sine,
    Torque,
)
from sim.rotational.drive_train import DriveTrain


def drawn_axis(seed: int) -> DriveTrain:
    """Modes of 5 to 80 Hz, damped by 5 to 30 %, gaps of some twists, a sine or a sampled torque on the motor."""
    rng = np.random.default_rng(seed)
    u = rng.uniform
    felt = motor = 10 ** u(-3, 0)
    parts: dict[str, Component] = {"motor": Inertia(J=motor)}
    stages, ratio = int(rng.integers(1, 4)), 1.0
    for k in range(stages):
        r = math.exp(u(math.log(1.5), math.log(12))) * rng.choice([1.0, 1.0, 1.0, 1.0, -1.0])
        loss = [0, *u(0.8, 1, 2), *u(0, 0.05, 2)]
        parts[f"gear{k}"] = LossyGear(r, loss) if rng.random() < 0.6 else IdealGear(r)
        inertia = felt * r * r * 10 ** u(-1.3, 0.5)
        both = 1 / (1 / inertia + 1 / (felt * r * r))
        c = both * (2 * math.pi * u(5, 80)) ** 2
        gap = u(0.2, 2) * 20 * motor * abs(r) / c if rng.random() < 0.4 else 0.0
        law = rng.choice(["elasto", "elasto", "linear"])
        parts[f"mesh{k}"] = ElastoBacklash(c=c, d=2 * u(0.05, 0.3) * math.sqrt(c * both), b=gap, law=law)
        parts[f"J{k}"] = Inertia(J=inertia)
        felt, ratio = inertia + felt * r * r, ratio * r
    size = felt / ratio**2 * u(20, 200)
    sampled = Sampled(np.cumsum(rng.normal(size=600)) * size / 12, 200.0)
    drive = Torque(Sine(size, u(0.3, 2), u(0, 6)) if rng.random() < 0.6 else sampled)
    train = DriveTrain.series(drive=drive, **parts)
    if rng.random() < 0.7:
        dry = size * u(0.02, 0.2)
        train = train.add("fm", BearingFriction([[0, dry], [1, dry * (1 + u(0, 0.3))]]), flange_a="motor.flange_a")
    if rng.random() < 0.5:
        dry = size * abs(ratio) * u(0.02, 0.1)
        train = train.add("fl", BearingFriction([[0, dry]]), flange_a=f"J{stages - 1}.flange_b")
    return train
