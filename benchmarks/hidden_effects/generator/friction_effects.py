"""What can be missing of friction, and torques on motor and load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.hidden_effects.generator.effect import Draw, Effect
from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.kernel import (
    BRISTLE_STIFFNESS,
    COULOMB_BACKWARD,
    COULOMB_FORWARD,
    VISCOUS_BACKWARD,
    VISCOUS_FORWARD,
)
from benchmarks.hidden_effects.generator.plant import Plant


def _coulomb(plant: Plant, joint: Joint, at_motor: float) -> Plant:
    frictions = plant.frictions.copy()
    frictions[:, [COULOMB_FORWARD, COULOMB_BACKWARD, BRISTLE_STIFFNESS]] *= at_motor / joint.coulomb_at_motor
    return replace(plant, frictions=frictions)


def coulomb_friction(draw: Draw) -> Effect:
    joint = draw.joint
    return Effect(
        "coulomb_friction",
        None,
        guess=0.3 * joint.coulomb_at_motor,
        cap=2 * joint.coulomb_at_motor,
        act=lambda plant, a: _coulomb(plant, joint, a),
        without=lambda plant: _coulomb(plant, joint, 0.0),
        size=lambda a: {"torque_n_m": a},
        forget=lambda believed: believed.scaled_friction(coulomb=0.0),
        spared=("coulomb",),
    )


def _viscous(plant: Plant, scale: float) -> Plant:
    frictions = plant.frictions.copy()
    frictions[:, [VISCOUS_FORWARD, VISCOUS_BACKWARD]] *= scale
    return replace(plant, frictions=frictions)


def viscous_friction(draw: Draw) -> Effect:
    joint = draw.joint
    return Effect(
        "viscous_friction",
        None,
        guess=0.5 * joint.viscous_at_motor,
        cap=3 * joint.viscous_at_motor,
        act=lambda plant, a: _viscous(plant, a / joint.viscous_at_motor),
        without=lambda plant: _viscous(plant, 0.0),
        size=lambda a: {"coefficient_n_m_s_per_rad": a},
        forget=lambda believed: believed.scaled_friction(viscous=0.0),
        spared=("viscous",),
    )


def stribeck_friction(draw: Draw) -> Effect:
    joint, rng = draw.joint, draw.rng
    speed = float(rng.uniform(0.04, 0.14) * joint.top_speed * joint.ratio)
    exponent = float(rng.choice([1.0, 1.0, 2.0]))

    def size(a: float) -> dict[str, float]:
        # speed means the same only in the exponential form
        return {"torque_n_m": a, "speed_rad_s": speed} if exponent == 1.0 else {"torque_n_m": a}

    return Effect(
        "stribeck_friction",
        None,
        guess=0.5 * joint.coulomb_at_motor,
        cap=1.8 * joint.coulomb_at_motor,
        act=lambda plant, a: plant.with_friction(0, stribeck=a, stribeck_speed=speed, stribeck_exponent=exponent),
        size=size,
        detail=(speed, exponent),
    )


def friction_asymmetry(draw: Draw) -> Effect:
    viscous_too, sign = draw.rng.random() < 0.5, draw.rng.choice([-1, 1])

    def act(plant: Plant, a: float) -> Plant:
        frictions = plant.frictions.copy()
        frictions[:, COULOMB_FORWARD] *= 1 + sign * a
        frictions[:, COULOMB_BACKWARD] *= 1 - sign * a
        if viscous_too:
            frictions[:, VISCOUS_FORWARD] *= 1 + sign * a
            frictions[:, VISCOUS_BACKWARD] *= 1 - sign * a
        return replace(plant, frictions=frictions)

    return Effect("friction_asymmetry", None, guess=0.2, cap=0.85, act=act)


def friction_drift(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    # measured 30 s after the start, where it is 30 a; over 30 s its rms about the mean is 30 a / sqrt(12)
    return Effect(
        "friction_drift",
        None,
        guess=0.01,
        cap=0.03 if sign > 0 else 0.02,
        act=lambda plant, a: replace(plant, drift_rate=sign * a),
        size=lambda a: {"rate_per_s": sign * a},
        spared=("coulomb", "viscous"),
        drift_start=30.0,
        strength_share=float(30 / np.sqrt(12) / 34),
    )


def gravity_imbalance(draw: Draw) -> Effect:
    phase, joint = float(draw.rng.uniform(0, 2 * np.pi)), draw.joint
    return Effect(
        "gravity_imbalance",
        None,
        guess=0.05 * joint.peak_torque * joint.ratio,
        cap=0.5 * joint.peak_torque * joint.ratio,
        act=lambda plant, a: replace(plant, gravity=(a, phase)),
        size=lambda a: {"torque_n_m": a},
    )


def torque_ripple(draw: Draw) -> Effect:
    phase = float(draw.rng.uniform(0, 2 * np.pi))
    order = float(draw.rng.choice([2, 4, 6, 12] if draw.joint.stages else [2, 6, 12, 24]))
    return Effect(
        "torque_ripple",
        "motor",
        guess=0.02 * draw.joint.peak_torque,
        cap=0.25 * draw.joint.peak_torque,
        act=lambda plant, a: replace(plant, ripple=(a, order, phase)),
        size=lambda a: {"torque_n_m": a, "order": order},
    )
