"""From a description and numbers to a chain: what is known, what is off by a little, what might be missing."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

from sim.chain.model import Chain, Line, Link
from sim.chain.reduction import chain_of as simulated_chain_of
from sim.description.axis import Axis, Load, Motor, Stage, Transmission
from sim.description.transmission import compliance, link_damping, link_stiffness, usual_damping
from sim.investigation.model.known_mechanisms import one_way, plain_train
from sim.investigation.model.observer import NO_STRETCH_RAD, Nuisance
from sim.investigation.model.parameters import Owner, Parameter, Stated, Values
from sim.mechanisms import ElectricalHum, EncoderError, TimeDelay

PARTS = ("sine", "cosine")
OF_SHAFT = {
    "inertia_kg_m2": "inertia_kg_m2",
    "coulomb_friction_n_m": "coulomb_n_m",
    "viscous_friction_n_m_s_per_rad": "viscous_n_m_s",
}
PLAIN_CHAINS = 64  # descriptions that are held at once: those of a robot's joints, and of what has changed in one
STATED_SPREAD = 0.03  # of what a data sheet states: inertias of motor and gears, stiffness of a stage, friction
LOSS_SPREAD = 0.09  # of a mesh's losses, which it states as what is left of all
PAYLOAD_SPREAD = 0.3  # of the load's inertia
DAMPING_SPREAD = 0.4  # of a stage's damping
JOINT_FRICTION_SPREAD = 0.15  # of a robot's joints: three logs of one arm differ by 5 to 17 %, as gears warm up
SHARED_SPREAD = 0.4  # of a stage's stiffness, where it is what the others leave of the whole transmission's
MOTOR_STRETCH_RAD, LOAD_STRETCH_RAD = 2e-3, 3e-5  # contacts give way by micrometres, of millimetres and decimetres
BODY_STRETCH_SPREAD = math.log(10.0)  # of the way of a body that turns as fast as a motor, or as its load
DRIVING, DRIVEN = "loss_split.driving", "loss_split.driven"
# of mesh losses behind the spring; and of that, also while the load drives: no law bears losses at the sending end
LOSS_SPLITS = {DRIVING: 1.0, DRIVEN: 0.5}
LOSS_WIDTH, LOSS_TURNS = "log_loss_width", 2e-3  # of the largest speed, over which losses turn their sign
MOTOR_STRETCH, MOTOR_RELEASE = "log_stretch_rad.motor", "log_release.motor"
START = ("start_rad", "start_rad_s")  # of the load over the motor, when the record begins
NONE = math.log(NO_STRETCH_RAD)
WIDE, MOST_WIDE = 3.0, 5.3  # logarithms of 20 and 200
SLOW = -5.0  # a contact lets go within a second, and not while it moves
RUNOUT_OVER_MESH = 2.0  # of a gear as new: error once per turn over that per tooth
LOAD_CURVE = "load_encoder.curve_{}_rad"  # one for each of `beyond_twice`
TWICE = 0.25  # of what a load encoder errs by at most: its error twice per turn


def _stated(name: str, unit: str, value: float) -> Parameter:
    return replace(_share(name, unit, value, STATED_SPREAD), stated=Stated.WELL)


def _friction(name: str, unit: str, value: float, *, of_joint: bool) -> Parameter:
    return _share(name, unit, value, JOINT_FRICTION_SPREAD) if of_joint else _stated(name, unit, value)


def _share(name: str, unit: str, value: float, spread: float) -> Parameter:
    low, high = 0.4 * value, 2.5 * value
    return Parameter(name, value, 0.01 * value, spread * value, low, high, unit=unit, owner=Owner.DESCRIPTION)


def _log(name: str, value: float, spread: float) -> Parameter:
    low, high = value - 2.5 * spread, value + 2.5 * spread
    return Parameter(name, value, 0.1, spread, low, high, owner=Owner.RECORDING)


def turning_over(*, of_joint: bool) -> tuple[Parameter, ...]:
    """Speed over which dry friction turns its sign while it slides, as a logarithm over a thousandth of the largest.

    Grease and seals give way before they slide, and real friction turns over a few percent of the speed: 3.6 to 10 % in
    six real drives, all of which are likelier so than with a jump. It begins there, since a jump has no slope that
    would lead away from it.

    `of_joint`: of a robot, as one body, also the way by which they give way (Dahl 1968): after a reversal friction
    builds up over that way, before it there is all of it, and of the two a law of the speed alone makes neither. The
    body may be that of a motor or of what its gears move, and nobody says which.
    """
    speed = Parameter(MOTOR_RELEASE, WIDE, 0.1, WIDE / 2.0, 0.0, MOST_WIDE, owner=Owner.RECORDING)
    way = () if not of_joint else (_log(MOTOR_STRETCH, math.log(MOTOR_STRETCH_RAD), BODY_STRETCH_SPREAD),)
    return (speed, *way)


def _at_rest(where: str, stretch_rad: float) -> list[Parameter]:
    """How far a contact gives way before it slides, and at which speed it lets go of what it holds then."""
    return [
        _log(f"log_stretch_rad.{where}", math.log(stretch_rad), 1.5),
        replace(_log(f"log_release.{where}", SLOW, 3.0), high=MOST_WIDE),
    ]


def base_parameters(
    axis: Axis, load_encoder: bool, level_n_m: float, rests: bool = False, *, of_joint: bool = False
) -> tuple[Parameter, ...]:
    """What a description already has, with the spread of a data sheet, and what belongs to every measurement.

    `rests`: rows at rest count, where the load is not seen also at the load. `of_joint`: of a robot.
    """
    out = [_stated("motor.inertia_kg_m2", "kg m2", axis.motor.inertia_kg_m2)]
    if axis.motor.coulomb_friction_n_m:
        out.append(_friction("motor.coulomb_friction_n_m", "N m", axis.motor.coulomb_friction_n_m, of_joint=of_joint))
        out += [] if rests else turning_over(of_joint=of_joint and not has_links(axis))
    if axis.motor.viscous_friction_n_m_s_per_rad:
        viscous = axis.motor.viscous_friction_n_m_s_per_rad
        out.append(_friction("motor.viscous_friction_n_m_s_per_rad", "N m s/rad", viscous, of_joint=of_joint))
    if rests:
        out += _at_rest("motor", MOTOR_STRETCH_RAD)
        out += [] if load_encoder else _at_rest("load", LOAD_STRETCH_RAD)
    if has_links(axis):
        out += _link_parameters(axis)
        out += _load_parameters(axis, load_encoder, level_n_m, rests)
    little = 0.002 * level_n_m
    out.append(Parameter("offset_n_m", 0.0, little, little, unit="N m", owner=Owner.RECORDING))
    late_s = _described(axis, TimeDelay.name, "motor", "delay_s")
    out.append(Parameter("torque_delay_s", late_s, 1e-4, 2e-4, -0.02, 0.02, unit="s", owner=Owner.RECORDING))
    for name, _, waves in hums(axis):  # as large as it is described, whatever its phase in this record
        spread = math.hypot(*waves)
        out += [
            Parameter(f"{name}.{part}", wave, 0.01 * spread, spread, unit="N m", owner=Owner.MOTION)
            for part, wave in zip(PARTS, waves, strict=True)
        ]
    return tuple(out)


def _described(axis: Axis, mechanism: str, location: str, number: str) -> float:
    """Sum of a number over what the description already has of a mechanism, 0 where it has none."""
    there = (e for e in axis.mechanisms if (e.name, e.location or location) == (mechanism, location))
    return sum(entry.parameters[number] for entry in there)


def hums(axis: Axis) -> list[tuple[str, float, tuple[float, float]]]:
    """Name, frequency [Hz], and sine and cosine amplitude [N m] of every hum that is described."""
    described = [entry.parameters for entry in axis.mechanisms if entry.name == ElectricalHum.name]
    return [(f"hum.{k}", p["frequency_hz"], _parts(p, "torque_n_m")) for k, p in enumerate(described)]


def _parts(numbers: Values, amplitude: str) -> tuple[float, float]:
    """Sine and cosine amplitude of amplitude * sin(x + phase)."""
    phase = numbers.get("phase_rad", 0.0)
    return numbers[amplitude] * math.cos(phase), numbers[amplitude] * math.sin(phase)


def _link_parameters(axis: Axis) -> list[Parameter]:
    out = []
    stiffness = axis.stiffness()
    for k, stage in enumerate(stages_of(axis)):
        where = f"stages.{stage}"
        name, unit, value = f"{where}.stiffness_n_m_per_rad", "N m/rad", link_stiffness(axis, k)
        if not stiffness[k]:
            out.append(_share(name, unit, value, 1.0))
        elif is_open(axis, k):
            out.append(_share(name, unit, value, SHARED_SPREAD))
        else:
            out.append(_stated(name, unit, value))
        damp = link_damping(axis, k) or usual_damping(axis, k)
        name, spread = f"{where}.damping_n_m_s_per_rad", DAMPING_SPREAD * damp
        rough = Parameter(name, damp, 0.1 * damp, spread, 0.02 * damp, 30 * damp, unit="N m s/rad")
        out.append(replace(rough, owner=Owner.DESCRIPTION, stated=Stated.ROUGHLY))
        if not axis.stages:
            continue
        entry = axis.stages[k]
        if k + 1 < len(axis.stages):
            out.append(_stated(f"{where}.inertia_kg_m2", "kg m2", entry.inertia_kg_m2))
        if entry.mesh_efficiency < 1.0:
            spread = LOSS_SPREAD * (1.0 - entry.mesh_efficiency)
            rough = Parameter(f"{where}.mesh_efficiency", entry.mesh_efficiency, 0.002, spread, 0.3, 1.0)
            out.append(replace(rough, owner=Owner.DESCRIPTION, stated=Stated.ROUGHLY))
        if entry.backlash_rad:
            new = entry.backlash_rad
            gap = Parameter(f"{where}.backlash_rad", 0.5 * new, 0.1 * new, 0.5 * new, 0.0, 1.5 * new, unit="rad")
            out.append(replace(gap, owner=Owner.MACHINE))
        if entry.driven_teeth and entry.transmission_error_rad:
            new = entry.transmission_error_rad
            waves = (Parameter(mesh_wave(stage, part), 0.0, 0.3 * new, new, -3 * new, 3 * new) for part in PARTS)
            out += [replace(wave, unit="rad", owner=Owner.MACHINE) for wave in waves]
    if any(entry.mesh_efficiency < 1.0 for entry in axis.stages):
        out += loss_parameters()
    return out


def mesh_wave(stage: str, part: str) -> str:
    """How sine or cosine of the error of a gear's teeth as new is called."""
    return f"mesh.{stage}.{part}_rad"


def loss_parameters() -> tuple[Parameter, ...]:
    """On which side of a mesh its losses are, and over which speed they turn."""
    splits = (Parameter(name, at, 0.1, 0.5, 0.0, 1.0, owner=Owner.MACHINE) for name, at in LOSS_SPLITS.items())
    return (*splits, _log(LOSS_WIDTH, math.log(LOSS_TURNS), 1.0))


def _load_parameters(axis: Axis, load_encoder: bool, level_n_m: float, rests: bool) -> list[Parameter]:
    out = [_share("load.inertia_kg_m2", "kg m2", axis.load.inertia_kg_m2, PAYLOAD_SPREAD)]
    if axis.load.coulomb_friction_n_m:
        out.append(_stated("load.coulomb_friction_n_m", "N m", axis.load.coulomb_friction_n_m))
        if load_encoder or not rests:
            width = Parameter("friction_width.load", 1.5e-3, 3e-4, 1.5e-3, 2e-4, 2e-2)
            out.append(replace(width, owner=Owner.RECORDING))
    if axis.load.viscous_friction_n_m_s_per_rad:
        viscous = axis.load.viscous_friction_n_m_s_per_rad
        out.append(_stated("load.viscous_friction_n_m_s_per_rad", "N m s/rad", viscous))
    if load_encoder:
        step = 0.02 * compliance(axis)
        out.append(Parameter("load_offset_rad", 0.0, step, math.inf, unit="rad", owner=Owner.MOTION))
        late_s = _described(axis, TimeDelay.name, "load", "delay_s")
        out.append(Parameter("load_delay_s", late_s, 1e-6, 5e-5, -0.02, 0.02, unit="s", owner=Owner.RECORDING))
        known = [_parts(e.parameters, "amplitude_rad") for e in axis.mechanisms if e.name == EncoderError.name]
        errs = [sum(wave) for wave in zip((0.0, 0.0), *known, strict=True)]
        new = axis.load_encoder.error_rad or 0.1 * math.hypot(*errs)
        if new:  # what it has at most, and the runout of the last gear, which looks the same
            mesh = axis.stages[-1].transmission_error_rad if axis.stages else 0.0
            spread = math.hypot(0.5 * new, RUNOUT_OVER_MESH * mesh)
            for part, err in zip(PARTS, errs, strict=True):
                name, far = f"load_encoder.error_{part}_rad", 3.0 * new
                once = Parameter(name, err, 0.3 * new, spread, err - far, err + far, unit="rad")
                out.append(replace(once, owner=Owner.RECORDING))
            for part in PARTS:  # a tilted or oval scale
                twice = Parameter(f"load_encoder.twice_{part}_rad", 0.0, 0.1 * new, TWICE * new, -new, new, unit="rad")
                out.append(replace(twice, owner=Owner.RECORDING))
    else:  # it may swing when the record begins
        twist = level_n_m * axis.ratio * compliance(axis)
        rate = 2.0 * math.pi * locked_mode_hz(axis) * twist
        for name, unit, size in zip(START, ("rad", "rad/s"), (twist, rate), strict=True):
            out.append(Parameter(name, 0.0, 0.03 * size, 2.0 * size, unit=unit, owner=Owner.MOTION))
    return out


def has_links(axis: Axis) -> bool:
    """False for an axis that moves as one body."""
    return bool(axis.stages) or axis.stiffness()[0] is not None


def stages_of(axis: Axis) -> tuple[str, ...]:
    """Names of the elastic links; a direct drive with a coupling has one, called `load`."""
    return tuple(stage.name for stage in axis.stages) or ("load",)


def ratio_after(axis: Axis, k: int) -> float:
    """Speed of the driven gear of link `k` over the load's."""
    return axis.ratio_from(axis.stages[k].name) if axis.stages else 1.0


def is_open(axis: Axis, k: int) -> bool:
    """Whether the stiffness of stage `k` is what the others leave of the whole transmission's."""
    return len(axis.stages) > 1 and axis.stages[k].stiffness_n_m_per_rad is None


def locked_mode_hz(axis: Axis) -> float:
    """Natural frequency of the load while the motor stands [Hz]."""
    return 1.0 / (2.0 * math.pi * math.sqrt(compliance(axis) * max(axis.load.inertia_kg_m2, 1e-12)))


def chain_of(axis: Axis, values: Values) -> Chain:
    """The chain that a simulation of the description has, some of its numbers replaced by `values`.

    What is as new at most, gaps and errors of teeth, is what `values` say, and 0 where they say nothing. Effects come
    on top.
    """
    plain = _plain_chain(axis.motor, axis.load, axis.stages, axis.transmission)
    shafts = list(plain.shafts)
    between = ((k, f"stages.{stage.name}", stage) for k, stage in enumerate(axis.stages[:-1], 1))
    for k, name, described in ((0, "motor", axis.motor), *between, (len(shafts) - 1, "load", axis.load)):
        more = {
            field: getattr(shafts[k], field) + (values[f"{name}.{key}"] - getattr(described, key))
            for key, field in OF_SHAFT.items()
            if f"{name}.{key}" in values
        }
        shafts[k] = replace(shafts[k], **more)
    shafts[0] = replace(shafts[0], offset_n_m=-values.get("offset_n_m", 0.0))
    links = tuple(_link(axis, k, link, values) for k, link in enumerate(plain.links))
    return Chain(tuple(shafts), links)


@lru_cache(maxsize=PLAIN_CHAINS)
def _plain_chain(motor: Motor, load: Load, stages: tuple[Stage, ...], transmission: Transmission) -> Chain:
    chain = simulated_chain_of(plain_train(Axis("", motor, load, stages, transmission)))
    return replace(chain, shafts=tuple(map(one_way, chain.shafts)))


def _link(axis: Axis, k: int, plain: Link, values: Values) -> Link:
    where = f"stages.{stages_of(axis)[k]}"
    stage = axis.stages[k] if axis.stages else None
    efficiency = values.get(f"{where}.mesh_efficiency")
    errors: tuple[Line, ...] = ()
    if stage and stage.driven_teeth:
        mesh = (values.get(mesh_wave(stage.name, part), 0.0) for part in PARTS)
        errors = wave(k + 1, float(stage.driven_teeth), *mesh)
    return replace(
        plain,
        stiffness_n_m_per_rad=values.get(f"{where}.stiffness_n_m_per_rad", plain.stiffness_n_m_per_rad),
        damping_n_m_s_per_rad=values.get(f"{where}.damping_n_m_s_per_rad", plain.damping_n_m_s_per_rad),
        gap_rad=values.get(f"{where}.backlash_rad", 0.0),
        efficiency=plain.efficiency if efficiency is None else (efficiency, efficiency),
        errors=errors,
    )


def wave(shaft: int, order: float, sine: float, cosine: float) -> tuple[Line, ...]:
    """sine * sin(order theta) + cosine * cos(order theta) as one line; none when both are 0."""
    if sine == 0.0 and cosine == 0.0:
        return ()
    return (Line(shaft, order, math.hypot(sine, cosine), math.atan2(cosine, sine)),)


def turning_width(values: Values) -> float:
    """Over which share of the largest speed dry friction at the motor turns its sign [1]."""
    return 1e-3 * math.exp(values.get(MOTOR_RELEASE, 0.0))


def nuisance_of(values: Values) -> Nuisance:
    """The measurement's own numbers among `values`."""
    get = values.get
    width = get("friction_width.load", 1.5e-3)
    return Nuisance(
        get("torque_delay_s", 0.0),
        get("load_delay_s", 0.0),
        tuple(get(f"load_encoder.{order}_{part}_rad", 0.0) for order in ("error", "twice") for part in PARTS),
        _curve(values),
        get("load_offset_rad", 0.0),
        (get(DRIVING, 1.0), get(DRIVING, 1.0) * get(DRIVEN, 0.5)),
        (turning_width(values), width * math.exp(get("log_release.load", 0.0))),
        math.exp(get(LOSS_WIDTH, math.log(LOSS_TURNS))),
        (math.exp(get(MOTOR_STRETCH, NONE)), math.exp(get("log_stretch_rad.load", NONE))),
        (get(START[0], 0.0), get(START[1], 0.0)),
    )


def _curve(values: Values) -> tuple[float, ...]:
    """Amplitudes of the load encoder's error over the angle [rad], of as many as there are."""
    out: list[float] = []
    while (name := LOAD_CURVE.format(len(out))) in values:
        out.append(values[name])
    return tuple(out)
