"""What can be hidden, mechanism by mechanism: how it changes the joint, its size, and what the data sheet omits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tests.hidden_effects.generator.joint import Joint
from tests.hidden_effects.generator.kernel import (
    BRISTLE_STIFFNESS,
    COULOMB_BACKWARD,
    COULOMB_FORWARD,
    VISCOUS_BACKWARD,
    VISCOUS_FORWARD,
)
from tests.hidden_effects.generator.motion import Motion
from tests.hidden_effects.generator.plant import Absorber, Damage, Line, Plant, torque_of

AS_NEW = 14.0
"""Full size of an effect that an as-new joint has a little of, in as-new sizes: a quarter is 3.5 times as new."""

Size = Callable[[float], dict[str, float]]


def _same_joint(joint: Joint) -> Joint:
    return joint


def _same_plant(plant: Plant, amplitude: float) -> Plant:
    return plant


def _no_size(amplitude: float) -> dict[str, float]:
    return {}


@dataclass(frozen=True)
class Effect:
    """One hidden effect of a drawn place and shape; only its amplitude is still free.

    `scored_location` is None where no data could tell the place.  `guess`, `floor` (of the full size), `cap`:
    amplitudes.  `without` is the plant that lacks the effect altogether.  `forget` takes the term out of the
    data sheet.  `spared` names data-sheet terms that may not absorb the effect when its strength is measured.
    `where` is the channel it enters by.
    """

    mechanism: str
    location: str | None
    guess: float
    floor: float = 0.0
    cap: float = np.inf
    scored_location: str | None = None
    where: str = "plant"
    act: Callable[[Plant, float], Plant] = _same_plant
    without: Callable[[Plant], Plant] = lambda plant: plant
    size: Size = _no_size
    forget: Callable[[Joint], Joint] = _same_joint
    prepare: Callable[[Joint], Joint] = _same_joint
    spared: tuple[str, ...] = ()
    drift_start: float = 0.0
    strength_share: float = 1.0
    detail: tuple[float, ...] = ()


@dataclass(frozen=True)
class Draw:
    """What an effect may depend on."""

    rng: np.random.Generator
    joint: Joint
    motion: Motion
    load_encoder: bool
    telemetry: bool = True
    sound: bool = True

    def place(self) -> str:
        """Draw one of the stages."""
        return str(self.rng.choice([stage.name for stage in self.joint.stages]))

    def recording(self) -> str:
        """Draw one of torque and sound, whichever is recorded."""
        return str(self.rng.choice([*["torque"] * self.telemetry, *["sound"] * self.sound]))


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
        size=_no_size if name == "motor" else lambda a: {"amplitude_rad": a},
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


def torque_offset(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    return Effect(
        "torque_offset", None, guess=1.0, where="torque offset", size=lambda a: {"torque_n_m": sign * a}, detail=(sign,)
    )


def electrical_hum(draw: Draw) -> Effect:
    frequency = float(draw.rng.choice([50.0, 60.0])) + float(draw.rng.normal(0, 0.02))
    where = f"{draw.recording()} hum"
    return Effect(
        "electrical_hum", None, guess=1.0, where=where, size=lambda a: {"frequency_hz": frequency}, detail=(frequency,)
    )


def encoder_error(draw: Draw) -> Effect:
    phase = float(draw.rng.uniform(0, 2 * np.pi))
    floor = AS_NEW * draw.joint.encoder_error
    return Effect("encoder_error", None, guess=floor, floor=floor, where="load encoder", detail=(phase,))


def time_delay(draw: Draw) -> Effect:
    which = float(draw.load_encoder and draw.rng.random() < 0.5)
    return Effect("time_delay", None, guess=3e-3, floor=3e-3, cap=6e-3, where="delay", detail=(which,))


def clipping(draw: Draw) -> Effect:
    where = f"{draw.recording()} clipped"
    return Effect("clipping", None, guess=0.02, floor=0.02, cap=0.06, where=where)


def lost_samples(draw: Draw) -> Effect:
    which = float(draw.rng.random() < 0.5)
    return Effect("lost_samples", None, guess=0.02, floor=0.02, cap=0.06, where="lost", detail=(which,))


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


PLANT_EFFECTS = (
    backlash,
    tooth_damage,
    eccentricity,
    mesh_error,
    coulomb_friction,
    viscous_friction,
    stribeck_friction,
    friction_asymmetry,
    load_dependent_loss,
    friction_drift,
    gravity_imbalance,
    torque_ripple,
    stiffness_hardening,
    hysteresis,
    structural_resonance,
)
SENSOR_EFFECTS = (torque_offset, encoder_error, time_delay, electrical_hum, clipping, lost_samples)
SOUND_EFFECTS = (bearing_defect,)
UNNAMED_EFFECTS = (
    position_dependent_viscous,
    quadratic_drag,
    speed_band_friction,
    fixed_frequency_disturbance,
)
EFFECTS: dict[str, Callable[[Draw], Effect]] = {
    function.__name__: function for function in PLANT_EFFECTS + SENSOR_EFFECTS + SOUND_EFFECTS + UNNAMED_EFFECTS
}
GEARED = frozenset(
    {
        "backlash",
        "tooth_damage",
        "eccentricity",
        "mesh_error",
        "load_dependent_loss",
        "stiffness_hardening",
        "hysteresis",
    }
)
"""Effects that need a gear."""
