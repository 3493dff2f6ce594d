"""Effects that no mechanism of the contract describes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.hidden_effects.generator.effect import Draw, Effect
from benchmarks.hidden_effects.generator.joint import Joint


def position_dependent_viscous(draw: Draw) -> Effect:
    order, phase = float(draw.rng.choice([1, 2, 3])), float(draw.rng.uniform(0, 2 * np.pi))

    def move_to_load(joint: Joint) -> Joint:
        whole = joint.viscous_at_motor
        return replace(joint, motor_viscous=0.1 * whole, load_viscous=0.9 * whole * joint.ratio**2)

    return Effect(
        "unnamed",
        None,
        guess=0.3,
        cap=0.95,
        act=lambda plant, a: plant.with_friction(1, angle_viscous=a, angle_order=order, angle_phase=phase),
        prepare=move_to_load,
    )


def quadratic_drag(draw: Draw) -> Effect:
    scale = draw.joint.peak_torque * draw.joint.ratio / draw.joint.top_speed**2
    return Effect(
        "unnamed", None, guess=0.05 * scale, cap=scale, act=lambda plant, a: plant.with_friction(1, quadratic=a)
    )


def speed_band_friction(draw: Draw) -> Effect:
    joint, rng = draw.joint, draw.rng
    top = joint.top_speed * joint.ratio
    middle, width = float(rng.uniform(0.35, 0.7) * top), float(rng.uniform(0.05, 0.1) * top)
    return Effect(
        "unnamed",
        None,
        guess=joint.coulomb_at_motor,
        cap=6 * joint.coulomb_at_motor,
        act=lambda plant, a: plant.with_friction(0, band_torque=a, band_speed=middle, band_width=width),
    )


def fixed_frequency_disturbance(draw: Draw) -> Effect:
    frequency, phase = float(draw.rng.uniform(3.0, 14.0)), float(draw.rng.uniform(0, 2 * np.pi))
    return Effect(
        "unnamed",
        None,
        guess=0.02 * draw.joint.peak_torque * draw.joint.ratio,
        act=lambda plant, a: replace(plant, disturbance=(a, frequency, phase)),
        size=lambda a: {"frequency_hz": frequency},
    )
