"""From a `DriveTrain` to shafts in series and back: finds them, simulates them as a `Chain`, names the results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from sim.chain.components import GearMesh, Gravity, OneFlange, ServoDrive, ShaftFriction
from sim.chain.components import TorqueRipple as Ripple
from sim.chain.components import TorqueWave as Wave
from sim.chain.integrate import run_chain
from sim.chain.model import CLOCK, Array, Chain, ChainResult, Dent, Drive, Line, Link, Servo, Shaft, Torque
from sim.chain.motion_profile import back_and_forth
from sim.errors import CompositionError, RunError
from sim.rotational.component import CONTACT_NAMES, SLIDING_NAMES, Component
from sim.rotational.components import (
    BearingFriction,
    Constant,
    ConstantTorque,
    Damper,
    ElastoBacklash,
    Fixed,
    IdealGear,
    Inertia,
    LossyGear,
    Sampled,
    Sine,
    SpringDamper,
)
from sim.rotational.components import Torque as TorqueSource
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import Channels, Event, Trajectory

MIN_RATE_OF_SERVO_HZ = 1000.0


@dataclass
class Section:
    """One shaft of the train, by the names of what stands on it, and the gear and the mesh that follow."""

    inertias: list[str] = field(default_factory=list)
    frictions: list[str] = field(default_factory=list)
    torques: list[str] = field(default_factory=list)
    gear: str | None = None
    mesh: str | None = None


def chain_of(train: DriveTrain) -> Chain:
    """The shafts in series of a train, motor side first.

    Raises
    ------
    CompositionError
        naming the component that cannot stand in such a chain.
    """
    return _chain(train, sections_of(train))


def simulate_chain(train: DriveTrain, samples: int, sample_rate_hz: float, watch: Array | None = None) -> Trajectory:
    """Simulate shafts in series; channels and events bear the names of the components (`watch`: see `run_chain`)."""
    sections = sections_of(train)
    chain = _chain(train, sections)
    drive, reference = _drive(train, sections[0], samples, sample_rate_hz)
    start = None if isinstance(drive, Servo) else _start(train, sections, chain)

    def names(column: int, link: bool) -> str:
        return (sections[column].mesh or "") if link else sections[column].inertias[0]

    result = run_chain(chain, drive, sample_rate_hz, samples, start=start, watch=watch, names=names)
    return trajectory_of(train, sections, chain, result, reference)


def sections_of(train: DriveTrain) -> list[Section]:
    """Walk from the shaft that no mesh drives to the last one."""
    node = {flange: i for i, flanges in enumerate(train.nodes()) for flange in flanges}
    for name, part in train.components.items():
        if isinstance(part, Inertia | BearingFriction | ShaftFriction):
            one, other = node[f"{name}.flange_a"], node[f"{name}.flange_b"]
            node = {flange: one if at == other else at for flange, at in node.items()}
    parts = train.components.items()
    fixed = {node[f"{name}.flange"] for name, part in parts if isinstance(part, Fixed)}
    through = {name for name, part in parts if isinstance(part, IdealGear | LossyGear | ElastoBacklash | SpringDamper)}
    driven = {node[f"{name}.flange_b"] for name in through}
    shafts = dict.fromkeys(node[f"{name}.flange_a"] for name, part in parts if isinstance(part, Inertia))
    first = [shaft for shaft in shafts if shaft not in driven]
    if len(first) != 1:
        raise CompositionError(f"shafts in series need one first shaft, found {len(first)}")
    here, sections = first[0], [Section()]
    used = {name for name, part in parts if isinstance(part, Fixed)}
    while True:
        section = sections[-1]
        _fill(section, train, node, here, fixed)
        onward = [name for name in through if node[f"{name}.flange_a"] == here]
        if len(onward) == 1 and isinstance(train[onward[0]], IdealGear | LossyGear):
            section.gear = onward[0]
            middle = node[f"{section.gear}.flange_b"]
            onward = [name for name in through if node[f"{name}.flange_a"] == middle]
            if len(onward) != 1 or isinstance(train[onward[0]], IdealGear | LossyGear):
                raise CompositionError(f"{section.gear}: an ElastoBacklash or SpringDamper must follow it")
        if len(onward) > 1:
            raise CompositionError(f"shafts in series: {onward[0]} and {onward[1]} are driven by the same shaft")
        section.mesh = onward[0] if onward else None
        used |= {*section.inertias, *section.frictions, *section.torques, *filter(None, (section.gear, section.mesh))}
        if section.mesh is None:
            break
        here = node[f"{section.mesh}.flange_b"]
        sections.append(Section())
    left = sorted(set(train.components) - used)
    if left:
        raise CompositionError(f"{left[0]}: cannot stand in shafts in series (motor, gears, load)")
    return sections


def _fill(section: Section, train: DriveTrain, node: Mapping[str, int], here: int, fixed: set[int]) -> None:
    for name, part in train.components.items():
        ends = [node[f"{name}.{flange}"] for flange in part.flanges if flange not in part.grounded]
        if here not in ends:
            continue
        if isinstance(part, Inertia):
            section.inertias.append(name)
        elif isinstance(part, OneFlange | TorqueSource | ConstantTorque):
            section.torques.append(name)
        elif isinstance(part, BearingFriction | ShaftFriction) or (isinstance(part, Damper) and fixed & set(ends)):
            section.frictions.append(name)
    if not section.inertias:
        raise CompositionError("shafts in series: every shaft between two meshes needs an Inertia")


def _chain(train: DriveTrain, sections: list[Section]) -> Chain:
    shafts = tuple(_shaft(train, section, k) for k, section in enumerate(sections))
    links = tuple(_link(train, section, k) for k, section in enumerate(sections) if section.mesh)
    return Chain(shafts, links)


def _shaft(train: DriveTrain, section: Section, k: int) -> Shaft:
    parts = [train[name] for name in section.torques]
    gravity = [part for part in parts if isinstance(part, Gravity)]
    if len(gravity) > 1:
        raise CompositionError("Gravity: one per shaft; add their torques")
    if k > 0 and any(isinstance(part, ServoDrive | TorqueSource) for part in parts):
        raise CompositionError(f"{section.torques[0]}: only the first of shafts in series can be driven by a signal")
    lines = [line for part in parts if isinstance(part, Ripple) for line in part.lines]
    ripples = [Line(k, line.order, line.amplitude, line.phase) for line in lines]
    waves = [Line(CLOCK, 2 * math.pi * p.frequency, p.torque, p.phase) for p in parts if isinstance(p, Wave)]
    friction = _friction(train, section.frictions)
    return Shaft(
        inertia_kg_m2=sum(part.inertia for part in map(train.__getitem__, section.inertias)),
        gravity_n_m=gravity[0].torque if gravity else 0.0,
        gravity_phase_rad=gravity[0].phase if gravity else 0.0,
        offset_n_m=sum(part.tau_constant for part in parts if isinstance(part, ConstantTorque)),
        ripples=(*ripples, *waves),
        coulomb_n_m=friction.coulomb,
        viscous_n_m_s=friction.viscous,
        coulomb_backward_n_m=friction.backward("coulomb"),
        viscous_backward_n_m_s=friction.backward("viscous"),
        stribeck_n_m=friction.stribeck,
        stribeck_speed_rad_s=friction.stribeck_speed,
        stribeck_exponent=friction.stribeck_exponent,
        drift_per_s=friction.drift,
    )


def _friction(train: DriveTrain, names: list[str]) -> ShaftFriction:
    """All friction of a shaft; plain parts add up, one with Stribeck or drift must stand alone."""
    parts = [shaft_friction_of(name, train[name]) for name in names]
    if len(parts) == 1:
        return parts[0]
    bent = [name for name, part in zip(names, parts, strict=True) if part.stribeck or part.drift]
    if bent:
        raise CompositionError(f"{bent[0]}: friction with Stribeck or drift must be the only one on its shaft")
    return ShaftFriction(
        coulomb=sum(part.coulomb for part in parts),
        viscous=sum(part.viscous for part in parts),
        coulomb_backward=sum(part.backward("coulomb") for part in parts),
        viscous_backward=sum(part.backward("viscous") for part in parts),
    )


def shaft_friction_of(name: str, part: Component) -> ShaftFriction:
    """Friction of a shaft in a chain's terms. Raises CompositionError for a bent table or a peak."""
    if isinstance(part, ShaftFriction):
        return part
    if isinstance(part, Damper):
        return ShaftFriction(viscous=part.d)
    if isinstance(part, BearingFriction) and len(part.table.lines) == 1 and part.peak == 1:
        (line,) = part.table.lines
        return ShaftFriction(coulomb=float(line.levels[0]), viscous=float(line.slopes[0]))
    raise CompositionError(f"{name}: friction over a bent table or with a peak cannot stand in shafts in series")


def _link(train: DriveTrain, section: Section, k: int) -> Link:
    mesh = train[section.mesh or ""]
    gear = train[section.gear] if section.gear else IdealGear(ratio=1.0)
    assert isinstance(gear, IdealGear | LossyGear)
    eta1, eta2, bf1, bf2 = 1.0, 1.0, 0.0, 0.0
    if isinstance(gear, LossyGear):
        if not gear.table.constant:
            raise CompositionError(f"{section.gear}: a loss table over speed cannot stand in shafts in series")
        eta1, eta2, bf1, bf2 = gear.table.rows[0][1:]
    if not isinstance(mesh, ElastoBacklash | SpringDamper) or mesh.phi_rel0 != 0:
        raise CompositionError(f"{section.mesh}: must be an ElastoBacklash or SpringDamper with phi_rel0 = 0")
    link = Link(gear.ratio, mesh.c, mesh.d, efficiency=(eta1, eta2), bearing_n_m=(bf1, bf2))
    if isinstance(mesh, ElastoBacklash):
        link = replace(link, gap_rad=mesh.b, law=mesh.law)
    if not isinstance(mesh, GearMesh):
        return link
    dents = (Dent(k + (d.wheel == "driven"), d.angle, d.half_width, d.depth, d.flank, d.form) for d in mesh.dents)
    return replace(
        link,
        errors=tuple(Line(k + (e.wheel == "driven"), e.order, e.amplitude, e.phase) for e in mesh.errors),
        dents=tuple(dents),
        cubic_per_rad2=mesh.cubic,
        hysteresis_n_m=mesh.hysteresis,
        hysteresis_rad=mesh.hysteresis_width,
    )


def _drive(train: DriveTrain, first: Section, samples: int, rate: float) -> tuple[Drive, Array | None]:
    """The drive of the first shaft, and the reference angle that a servo follows."""
    drives = [part for name in first.torques if isinstance(part := train[name], ServoDrive | TorqueSource)]
    if len(drives) > 1:
        raise CompositionError("shafts in series: one servo or torque signal on the first shaft, not more")
    if not drives:
        return Torque(), None
    drive = drives[0]
    if isinstance(drive, ServoDrive):
        return _servo(drive, samples, rate)
    signal = drive.tau
    if isinstance(signal, Sine) and signal.startTime == 0:
        return Torque(None, signal.amplitude, signal.f, signal.phase, signal.offset), None
    if isinstance(signal, Constant):
        return Torque(offset_n_m=signal.k), None
    steps = rate / signal.sample_rate_hz if isinstance(signal, Sampled) and signal.startTime == 0 else 0.5
    if not math.isclose(steps, round(steps)) or steps < 1:
        raise CompositionError(
            "shafts in series: the torque must be a Sine or Sampled from t = 0, whose rate divides that of the output"
        )
    return Torque(signal(np.arange(samples) / rate)), None


def _servo(drive: ServoDrive, samples: int, rate: float) -> tuple[Servo, Array]:
    if rate < MIN_RATE_OF_SERVO_HZ:
        raise RunError(f"sample_rate_hz: a servo needs at least {MIN_RATE_OF_SERVO_HZ:g} Hz, got {rate:g}")
    period = round(drive.period * rate)
    whole = math.isclose(period, drive.period * rate, rel_tol=1e-12)  # then the samples of each period are the same
    time = drive.begin + np.arange(min(samples, period) if whole else samples) / rate
    reference = back_and_forth(time, drive.period, drive.top_speed, drive.ramp, drive.dwell)
    if len(time) < samples:
        reference = np.tile(reference, -(-samples // period))[:, :samples]
    reference[0] += drive.offset
    angle = reference[0].copy()
    reference[2] *= drive.feed_forward_inertia
    limits = min(drive.speed_limit, 1e12), min(drive.torque_limit, 1e12)
    return Servo(reference, drive.position_gain, drive.speed_gain, drive.integral_time, *limits), angle


def _start(train: DriveTrain, sections: list[Section], chain: Chain) -> Array:
    """Start values of the inertias and meshes that give one; else everything rests, in line with the first shaft."""
    n = len(sections)
    state = np.zeros(2 * n)
    for k, section in enumerate(sections):
        for row, key in ((k, "phi"), (n + k, "w")):
            given = [value for name in section.inertias if (value := getattr(train[name], key)) is not None]
            if given:
                state[row] = given[0]
            elif k:
                relative = getattr(train[sections[k - 1].mesh or ""], f"{key}_rel", None)
                state[row] = state[row - 1] / chain.links[k - 1].ratio + (relative or 0.0)
    return state


CONTACT, STICK = 0, 1  # kinds in the engine's log


def trajectory_of(
    train: DriveTrain, sections: list[Section], chain: Chain, result: ChainResult, reference: Array | None
) -> Trajectory:
    """Name the numbers of a chain after the components of its train.

    Signs: a chain counts the torque on the driven shaft, Modelica the torque into the component; a mesh's `tau` and
    `mode` are those of Modelica, so flank 1 (driver pushes forward) has tau < 0 and mode -1.
    """
    sources = dict(_sources(train, sections, chain, result))
    for name in sections[0].torques:
        if isinstance(train[name], ServoDrive | TorqueSource):
            sources[f"{name}.tau"] = partial(np.asarray, result.motor_torque_n_m)
            if reference is not None:
                sources[f"{name}.reference"] = partial(np.asarray, reference)
    units = {name: train[name.rpartition(".")[0]].unit(name) for name in sources}
    events = tuple(_events(sections, result))
    return Trajectory(result.time_s, Channels(sources), units, events, "chain", result.residual)


def _sources(
    train: DriveTrain, sections: list[Section], chain: Chain, result: ChainResult
) -> Iterator[tuple[str, Callable[[], Array]]]:
    angle, speed, acceleration = result.angle_rad, result.speed_rad_s, result.acceleration_rad_s2
    for k, section in enumerate(sections):
        for name in section.inertias:
            for channel, values in (("phi", angle), ("w", speed), ("a", acceleration)):
                yield f"{name}.{channel}", partial(np.asarray, values[:, k])
        for name in section.torques:
            part = train[name]
            if isinstance(part, Ripple | Gravity):
                yield f"{name}.tau", partial(_position_torque, part, angle[:, k])
            if isinstance(part, Wave):
                yield f"{name}.tau", partial(_torque_over_time, part, result.time_s)
        if section.gear:
            yield f"{section.gear}.w_a", partial(np.asarray, speed[:, k])
        if section.mesh:
            ratio = chain.links[k].ratio
            yield f"{section.mesh}.tau", partial(np.negative, result.force_n_m[:, k])
            yield f"{section.mesh}.phi_rel", partial(_relative, angle, k, ratio)
            yield f"{section.mesh}.w_rel", partial(_relative, speed, k, ratio)


def _relative(values: Array, k: int, ratio: float) -> Array:
    return np.asarray(values[:, k + 1] - values[:, k] / ratio)


def _position_torque(part: Ripple | Gravity, angle: Array) -> Array:
    if isinstance(part, Gravity):
        return np.asarray(-part.torque * np.sin(angle + part.phase))
    return np.asarray(sum(line.amplitude * np.sin(line.order * angle + line.phase) for line in part.lines))


def _torque_over_time(part: Wave, time_s: Array) -> Array:
    return np.asarray(part.torque * np.sin(2.0 * np.pi * part.frequency * time_s + part.phase))


def _events(sections: list[Section], result: ChainResult) -> list[Event]:
    """Contact and sliding as Modelica numbers them; what a component passes through in no time is left out."""
    meshes = [section.mesh or "" for section in sections]
    sliding = [next(iter(section.frictions), None) or section.gear or section.inertias[0] for section in sections]
    log = result.log[result.log[:, 1] <= STICK]
    contact = log[:, 1] == CONTACT
    modes = np.where(contact[:, None], -np.sign(log[:, 3:]), log[:, 3:]).astype(np.int64)  # pieces of a contact are one
    wanted = modes[:, 0] != modes[:, 1]
    kept: dict[str, list[Event]] = {}
    for (time, kind, index), (before, after) in zip(log[wanted, :3].tolist(), modes[wanted].tolist(), strict=True):
        component, names = (sliding, SLIDING_NAMES) if kind == STICK else (meshes, CONTACT_NAMES)
        events = kept.setdefault(component[int(index)], [])
        if events and events[-1].time_s == time:
            before = events.pop().from_mode
        if before != after:
            events.append(Event(time, component[int(index)], before, after, names[before], names[after]))
    return sorted((event for events in kept.values() for event in events), key=lambda event: event.time_s)
