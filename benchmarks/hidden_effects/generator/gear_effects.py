"""What can go wrong with gears, shafts and structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.hidden_effects.generator.effect import AS_NEW, Draw, Effect, no_size
from benchmarks.hidden_effects.generator.plant import Absorber, Damage, Line, Plant, torque_of


def backlash(draw: Draw) -> Effect:
    name = draw.place()
    return Effect(
        "backlash",
        name,
        guess=20 * draw.joint.stage(name).backlash,
        floor=AS_NEW * draw.joint.stage(name).backlash,
        cap=6e-3 if name == "output" else 2e-2,
        scored_location=name,
        act=lambda plant, a: plant.with_mesh(name, gap=a),
        size=lambda a: {"gap_rad": a},
    )


def tooth_damage(draw: Draw) -> Effect:
    name = draw.place()
    stage = draw.joint.stage(name)
    rng, pitch = draw.rng, 2 * np.pi / stage.driven_teeth
    candidates = [(float(rng.uniform(0, 2 * np.pi)), int(rng.choice([-1, 1]))) for _ in range(12)]
    if name == "output":
        angle, flank = max(candidates, key=lambda c: min(draw.motion.passes(*c), 4))
    else:
        angle, flank = candidates[0]
    width, rectangular = float(rng.uniform(0.7, 1.2) * pitch), bool(rng.random() < 0.5)
    return Effect(
        "tooth_damage",
        name,
        guess=40 * stage.tooth_error,
        floor=AS_NEW * stage.tooth_error,
        cap=0.3 * pitch,
        scored_location=name,
        act=lambda plant, a: plant.with_mesh(name, damage=Damage(angle, width, a, flank, rectangular)),
        size=lambda a: {"depth_rad": a, "angle_rad": angle, "flank": float(flank)},
    )


def _with_lines(plant: Plant, name: str, side: str, *lines: Line) -> Plant:
    mesh = plant.meshes[[stage.name for stage in plant.joint.stages].index(name)]
    return plant.with_mesh(name, **{side: getattr(mesh, side) + lines})


def eccentricity(draw: Draw) -> Effect:
    names = [stage.name for stage in draw.joint.stages]
    name, phase = str(draw.rng.choice([*names, "motor"])), float(draw.rng.uniform(0, 2 * np.pi))
    at, side = (names[0], "driver") if name == "motor" else (name, "driven")
    floor = AS_NEW * draw.joint.stage(at).tooth_error
    if name == "output" and draw.load_encoder:
        floor = max(floor, AS_NEW * draw.joint.encoder_error)
    return Effect(
        "eccentricity",
        name,
        guess=floor,
        floor=floor,
        cap=2e-3 if at == "output" else 8e-3,
        scored_location=name,
        act=lambda plant, a: _with_lines(plant, at, side, Line(a, 1, phase)),
        size=no_size if name == "motor" else lambda a: {"amplitude_rad": a},
        spared=("encoder",) if name == "output" else (),
    )


def mesh_error(draw: Draw) -> Effect:
    name, phases = draw.place(), draw.rng.uniform(0, 2 * np.pi, 2)
    stage, second = draw.joint.stage(name), float(draw.rng.uniform(0.0, 0.4))
    teeth = stage.driven_teeth
    return Effect(
        "mesh_error",
        name,
        guess=AS_NEW * stage.tooth_error,
        floor=AS_NEW * stage.tooth_error,
        cap=0.04 * 2 * np.pi / teeth,
        scored_location=name,
        act=lambda plant, a: _with_lines(
            plant, name, "driven", Line(a, teeth, phases[0]), Line(second * a, 2 * teeth, phases[1])
        ),
        size=lambda a: {"amplitude_rad": a},
    )


def stiffness_hardening(draw: Draw) -> Effect:
    name, joint = draw.place(), draw.joint
    twist = torque_of(joint, joint.stages.index(joint.stage(name))) / joint.stage(name).stiffness
    return Effect(
        "stiffness_hardening",
        name,
        guess=0.2 / twist**2,
        cap=2.0 / twist**2,
        act=lambda plant, a: plant.with_mesh(name, cubic=a),
        size=lambda a: {"cubic_per_rad2": a},
    )


def hysteresis(draw: Draw) -> Effect:
    name, joint = draw.place(), draw.joint
    torque = torque_of(joint, joint.stages.index(joint.stage(name)))
    return Effect(
        "hysteresis",
        name,
        guess=0.02 * torque,
        cap=0.25 * torque,
        act=lambda plant, a: plant.with_mesh(name, hysteresis=a),
        size=lambda a: {"torque_n_m": a},
    )


def load_dependent_loss(draw: Draw) -> Effect:
    name = draw.place()
    return Effect(
        "load_dependent_loss",
        name,
        guess=0.05,
        cap=0.3,
        act=lambda plant, a: plant.with_mesh(name, loss=a),
        size=lambda a: {"fraction": a},
        prepare=lambda joint: joint.with_stage(name, efficiency=None),
    )


def structural_resonance(draw: Draw) -> Effect:
    joint, rng = draw.joint, draw.rng
    frequency = float(np.sqrt(joint.stiffness / joint.load_inertia) / (2 * np.pi) * rng.uniform(0.6, 1.6))
    damping = float(rng.uniform(0.004, 0.02))
    return Effect(
        "structural_resonance",
        None,
        guess=0.05,
        cap=0.5,
        act=lambda plant, a: replace(plant, absorber=Absorber(a * plant.joint.load_inertia, frequency, damping)),
        detail=(frequency,),
    )


def bearing_defect(draw: Draw) -> Effect:
    rng = draw.rng
    order = 0.0
    while min(abs(order * k - round(order * k)) for k in (1, 2)) < 0.06:
        order = float(rng.uniform(2.6, 9.4))
    return Effect(
        "bearing_defect",
        None,
        guess=1.0,
        cap=6.0,
        where="sound bearing",
        size=lambda a: {"order": order},
        detail=(order,),
    )
