"""Engine 2 for a `DriveTrain`: finds the shafts in series, simulates them as a `Chain`, gives back a `Trajectory`.

Signs: a chain counts the torque on the driven shaft, Modelica the torque into the component; a mesh's `tau` and
`mode` are those of Modelica, so flank 1 (driver pushes forward) has tau < 0 and mode -1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from sim.axis import Axis
from sim.chain_components import (
    GearMesh,
    Gravity,
    MeshLine,
    OneFlange,
    ServoDrive,
    ShaftFriction,
    TorqueRipple,
)
from sim.chain_model import Array, Chain, ChainResult, Dent, Drive, Line, Link, Servo, Shaft, Torque
from sim.chain_run import run_chain
from sim.component import CONTACT_NAMES, SLIDING_NAMES, Component
from sim.components import (
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
from sim.components import Torque as TorqueSource
from sim.drive_train import DriveTrain
from sim.errors import CompositionError, ParameterError, RunError, number
from sim.servo import back_and_forth
from sim.trajectory import Channels, Event, Trajectory

MEMORY_LIMIT_BYTES = 2_000_000_000  # of one result: 43 minutes of three shafts at 8 kHz
MIN_RATE_OF_SERVO_HZ = 1000.0
CONTACT, STICK = 0, 1  # kinds in the engine's log


@dataclass
class Place:
    """One shaft of the train, and the link that follows it."""

    inertias: list[str] = field(default_factory=list)
    frictions: list[str] = field(default_factory=list)
    torques: list[str] = field(default_factory=list)
    gear: str | None = None
    mesh: str | None = None


def fits(train: DriveTrain) -> bool:
    """Whether engine 2 for shafts in series can have this train."""
    try:
        chain_of(train)
    except CompositionError:
        return False
    return True


def chain_of(train: DriveTrain) -> Chain:
    """The shafts in series of a train, motor side first.

    Raises
    ------
    CompositionError
        naming the component that has no place in such a chain.
    """
    return _chain(train, _places(train))


def chain_of_axis(axis: Axis) -> Chain:
    """The chain of an axis description with its mechanisms."""
    return chain_of(DriveTrain.from_axis(axis))


def simulate_chain(
    train: DriveTrain, duration_s: float, sample_rate_hz: float, watch: Array | None = None
) -> Trajectory:
    """Simulate shafts in series; channels and events bear the names of the components (`watch`: see `run_chain`)."""
    number("duration_s", duration_s, "s", above=0)
    number("sample_rate_hz", sample_rate_hz, "Hz", above=0)
    samples = round(duration_s * sample_rate_hz) + 1
    places = _places(train)
    size = 8.0 * samples * (4 * len(places) + 1)
    if size > MEMORY_LIMIT_BYTES:
        longest = MEMORY_LIMIT_BYTES / size * duration_s
        raise ParameterError(
            f"duration_s: must be at most {longest:.0f} s at this rate (2 GB of results), got {duration_s:g}"
        )
    chain = _chain(train, places)
    drive, reference = _drive(train, places, samples, sample_rate_hz)
    result = run_chain(chain, drive, sample_rate_hz, samples, start=_start(train, places, chain), watch=watch)
    return _trajectory(train, places, chain, result, reference)


def _places(train: DriveTrain) -> list[Place]:
    """Walk from the shaft that no mesh drives to the last one."""
    node = {flange: i for i, flanges in enumerate(train.nodes()) for flange in flanges}
    for name, part in train.components.items():
        if isinstance(part, Inertia | BearingFriction | ShaftFriction):
            node = _merged(node, f"{name}.flange_a", f"{name}.flange_b")
    through = {
        name: part
        for name, part in train.components.items()
        if isinstance(part, IdealGear | LossyGear | ElastoBacklash | SpringDamper)
    }
    driven = {node[f"{name}.flange_b"] for name in through}
    shafts = [node[f"{name}.flange_a"] for name, part in train.components.items() if isinstance(part, Inertia)]
    first = [shaft for shaft in dict.fromkeys(shafts) if shaft not in driven]
    if len(first) != 1:
        raise CompositionError(f"shafts in series need one first shaft, found {len(first)}")
    places: list[Place] = []
    used: set[str] = set()
    here = first[0]
    while True:
        place, onward = _place(train, node, here, through)
        places.append(place)
        used.update(place.inertias, place.frictions, place.torques, filter(None, (place.gear, place.mesh)))
        if onward is None:
            break
        here = onward
    grounds = {name for name, part in train.components.items() if isinstance(part, Fixed)}
    left = sorted(set(train.components) - used - grounds)
    if left:
        raise CompositionError(f"{left[0]}: has no place in shafts in series (motor, gears, load)")
    return places


def _merged(node: Mapping[str, int], one: str, other: str) -> dict[str, int]:
    keep, drop = node[one], node[other]
    return {flange: keep if at == drop else at for flange, at in node.items()}


def _place(
    train: DriveTrain, node: Mapping[str, int], here: int, through: Mapping[str, Component]
) -> tuple[Place, int | None]:
    place = Place()
    for name, part in train.components.items():
        if isinstance(part, Inertia) and node[f"{name}.flange_a"] == here:
            place.inertias.append(name)
        elif _brakes(train, node, name) == here:
            place.frictions.append(name)
        elif isinstance(part, OneFlange | TorqueSource | ConstantTorque) and node[f"{name}.flange"] == here:
            place.torques.append(name)
    after = [name for name in through if node[f"{name}.flange_a"] == here]
    if not place.inertias:
        raise CompositionError("shafts in series: every shaft between two meshes needs an Inertia")
    if len(after) > 1:
        raise CompositionError(f"shafts in series: {after[0]} and {after[1]} are driven by the same shaft")
    if not after:
        return place, None
    part = through[after[0]]
    if isinstance(part, IdealGear | LossyGear):
        place.gear = after[0]
        middle = node[f"{place.gear}.flange_b"]
        after = [name for name in through if node[f"{name}.flange_a"] == middle]
        if len(after) != 1 or isinstance(through[after[0]], IdealGear | LossyGear):
            raise CompositionError(f"{place.gear}: an ElastoBacklash or SpringDamper must follow it")
    place.mesh = after[0]
    return place, node[f"{place.mesh}.flange_b"]


def _brakes(train: DriveTrain, node: Mapping[str, int], name: str) -> int | None:
    """The shaft that a friction, or a damper to the ground, brakes."""
    part = train[name]
    if isinstance(part, BearingFriction | ShaftFriction):
        return node[f"{name}.flange_a"]
    if not isinstance(part, Damper):
        return None
    fixed = {node[f"{other}.flange"] for other, ground in train.components.items() if isinstance(ground, Fixed)}
    a, b = node[f"{name}.flange_a"], node[f"{name}.flange_b"]
    return b if a in fixed else a if b in fixed else None


def _chain(train: DriveTrain, places: list[Place]) -> Chain:
    shafts = tuple(_shaft(train, place, k) for k, place in enumerate(places))
    links = tuple(_link(train, place, k) for k, place in enumerate(places) if place.mesh)
    return Chain(shafts, links)


def _shaft(train: DriveTrain, place: Place, k: int) -> Shaft:
    parts = [train[name] for name in place.torques]
    gravity = [part for part in parts if isinstance(part, Gravity)]
    if len(gravity) > 1:
        raise CompositionError("Gravity: one per shaft; add their torques")
    ripples = tuple(
        Line(k, line.order, line.amplitude, line.phase)
        for part in parts
        if isinstance(part, TorqueRipple)
        for line in part.lines
    )
    if k > 0 and any(isinstance(part, ServoDrive | TorqueSource) for part in parts):
        raise CompositionError(f"{place.torques[0]}: only the first of shafts in series can be driven by a signal")
    return Shaft(
        inertia_kg_m2=sum(_inertia(train[name]) for name in place.inertias),
        gravity_n_m=gravity[0].torque if gravity else 0.0,
        gravity_phase_rad=gravity[0].phase if gravity else 0.0,
        offset_n_m=sum(part.tau_constant for part in parts if isinstance(part, ConstantTorque)),
        ripples=ripples,
        **_friction(train, place),
    )


def _inertia(part: Component) -> float:
    return part.J if isinstance(part, Inertia) else 0.0


def _friction(train: DriveTrain, place: Place) -> dict[str, Any]:
    """Friction of a shaft as the keywords of `Shaft`; plain parts add up, a Stribeck part must stand alone."""
    total = ShaftFriction()
    for name in place.frictions:
        part = shaft_friction_of(name, train[name])
        if len(place.frictions) > 1 and (part.stribeck or part.drift):
            raise CompositionError(f"{name}: friction with Stribeck or drift must be the only one on its shaft")
        total = ShaftFriction(
            coulomb=total.coulomb + part.coulomb,
            viscous=total.viscous + part.viscous,
            coulomb_backward=_backward(total, "coulomb") + _backward(part, "coulomb"),
            viscous_backward=_backward(total, "viscous") + _backward(part, "viscous"),
            stribeck=part.stribeck,
            stribeck_speed=part.stribeck_speed,
            stribeck_exponent=part.stribeck_exponent,
            drift=part.drift,
        )
    return {
        "coulomb_n_m": total.coulomb,
        "viscous_n_m_s": total.viscous,
        "coulomb_backward_n_m": _backward(total, "coulomb"),
        "viscous_backward_n_m_s": _backward(total, "viscous"),
        "stribeck_n_m": total.stribeck,
        "stribeck_speed_rad_s": total.stribeck_speed,
        "stribeck_exponent": total.stribeck_exponent,
        "drift_per_s": total.drift,
    }


def _backward(friction: ShaftFriction, name: str) -> float:
    value = getattr(friction, f"{name}_backward")
    return float(getattr(friction, name) if value is None else value)


def shaft_friction_of(name: str, part: Component) -> ShaftFriction:
    """Friction of a shaft in the terms of engine 2. Raises CompositionError for a bent table or a peak."""
    if isinstance(part, ShaftFriction):
        return part
    if isinstance(part, Damper):
        return ShaftFriction(viscous=part.d)
    if isinstance(part, BearingFriction) and part.table.straight and part.peak == 1:
        return ShaftFriction(coulomb=float(part.table.at(0.0)[0]), viscous=float(part.table.slopes()[0]))
    raise CompositionError(f"{name}: friction over a bent table or with a peak has no place in shafts in series")


def _link(train: DriveTrain, place: Place, k: int) -> Link:
    part = train[place.mesh or ""]
    gear = train[place.gear] if place.gear else IdealGear(ratio=1.0)
    if isinstance(gear, LossyGear):
        if not gear.table.constant:
            raise CompositionError(f"{place.gear}: a loss table over speed has no place in shafts in series")
        _, eta1, eta2, bf1, bf2 = gear.table.rows[0]
    else:
        eta1, eta2, bf1, bf2 = 1.0, 1.0, 0.0, 0.0
    ratio = gear.ratio if isinstance(gear, IdealGear | LossyGear) else 1.0
    if not isinstance(part, ElastoBacklash | SpringDamper) or part.phi_rel0 != 0:
        raise CompositionError(f"{place.mesh}: must be an ElastoBacklash or SpringDamper with phi_rel0 = 0")
    link = Link(
        ratio=ratio,
        stiffness_n_m_per_rad=part.c,
        damping_n_m_s_per_rad=part.d,
        gap_rad=part.b if isinstance(part, ElastoBacklash) else 0.0,
        law=part.law if isinstance(part, ElastoBacklash) else "elasto",
        efficiency=(eta1, eta2),
        bearing_n_m=(bf1, bf2),
    )
    return _imperfect(link, part, k) if isinstance(part, GearMesh) else link


def _imperfect(link: Link, mesh: GearMesh, k: int) -> Link:
    dents = (Dent(k + (d.wheel == "driven"), d.angle, d.half_width, d.depth, d.flank) for d in mesh.dents)
    return replace(
        link,
        errors=_lines(mesh.errors, k),
        stiffness_waves=_lines(mesh.waves, k),
        dents=tuple(dents),
        cubic_per_rad2=mesh.cubic,
        hysteresis_n_m=mesh.hysteresis,
        hysteresis_rad=mesh.hysteresis_width,
    )


def _lines(lines: tuple[MeshLine, ...], k: int) -> tuple[Line, ...]:
    return tuple(Line(k + (line.wheel == "driven"), line.order, line.amplitude, line.phase) for line in lines)


def _drive(train: DriveTrain, places: list[Place], samples: int, rate: float) -> tuple[Drive, Array | None]:
    """The drive of the first shaft, and the reference angle that a servo follows."""
    drives = [train[name] for name in places[0].torques if isinstance(train[name], ServoDrive | TorqueSource)]
    if len(drives) > 1:
        raise CompositionError("shafts in series: one servo or torque signal on the first shaft, not more")
    if not drives:
        return Torque(), None
    drive = drives[0]
    if isinstance(drive, ServoDrive):
        return _servo(drive, samples, rate)
    assert isinstance(drive, TorqueSource)
    signal = drive.tau
    if isinstance(signal, Sine) and signal.startTime == 0:
        return Torque(None, signal.amplitude, signal.f, signal.phase, signal.offset), None
    if isinstance(signal, Constant):
        return Torque(offset_n_m=signal.k), None
    steps = rate / signal.sample_rate_hz if isinstance(signal, Sampled) else 0.5
    if not isinstance(signal, Sampled) or signal.startTime != 0 or not math.isclose(steps, round(steps)) or steps < 1:
        raise CompositionError(
            "shafts in series: the torque must be a Sine or Sampled from t = 0, whose rate divides that of the output"
        )
    return Torque(signal(np.arange(samples) / rate)), None


def _servo(drive: ServoDrive, samples: int, rate: float) -> tuple[Servo, Array]:
    if rate < MIN_RATE_OF_SERVO_HZ:
        raise RunError(f"sample_rate_hz: a servo needs at least {MIN_RATE_OF_SERVO_HZ:g} Hz, got {rate:g}")
    reference = back_and_forth(np.arange(samples) / rate, drive.period, drive.top_speed, drive.ramp, drive.dwell)
    angle = reference[0].copy()
    reference[2] *= drive.feed_forward_inertia
    limits = min(drive.speed_limit, 1e12), min(drive.torque_limit, 1e12)
    return Servo(reference, drive.position_gain, drive.speed_gain, drive.integral_time, *limits), angle


def _start(train: DriveTrain, places: list[Place], chain: Chain) -> Array:
    """Start values of the inertias and meshes that give one; else everything rests, in line with the first shaft."""
    n = len(places)
    state = np.zeros(2 * n)
    for k, place in enumerate(places):
        parts = [part for name in place.inertias if isinstance(part := train[name], Inertia)]
        for row, key in ((k, "phi"), (n + k, "w")):
            given = [getattr(part, key) for part in parts if getattr(part, key) is not None]
            state[row] = given[0] if given else (state[row - 1] / chain.links[k - 1].ratio if k else 0.0)
            mesh = train[places[k - 1].mesh or ""] if k else None
            relative = getattr(mesh, f"{key}_rel", None)
            if relative is not None and not given:
                state[row] += relative
    return state


def _trajectory(
    train: DriveTrain, places: list[Place], chain: Chain, result: ChainResult, reference: Array | None
) -> Trajectory:
    sources: dict[str, Callable[[], Array]] = {}
    units: dict[str, str] = {}
    for name, unit, source in _sources(train, places, chain, result):
        sources[name], units[name] = source, unit
    for name in places[0].torques:
        if isinstance(train[name], ServoDrive | TorqueSource):
            sources[f"{name}.tau"], units[f"{name}.tau"] = partial(np.asarray, result.motor_torque_n_m), "N.m"
            if reference is not None:
                sources[f"{name}.reference"], units[f"{name}.reference"] = partial(np.asarray, reference), "rad"
    events = tuple(_events(places, result))
    return Trajectory(result.time_s, Channels(sources), units, events, "runge-kutta")


def _sources(
    train: DriveTrain, places: list[Place], chain: Chain, result: ChainResult
) -> Iterator[tuple[str, str, Callable[[], Array]]]:
    angle, speed, acceleration = result.angle_rad, result.speed_rad_s, result.acceleration_rad_s2
    for k, place in enumerate(places):
        for name in place.inertias:
            yield f"{name}.phi", "rad", partial(_column, angle, k)
            yield f"{name}.w", "rad/s", partial(_column, speed, k)
            yield f"{name}.a", "rad/s2", partial(_column, acceleration, k)
        for name in place.torques:
            part = train[name]
            if isinstance(part, TorqueRipple | Gravity):
                yield f"{name}.tau", "N.m", partial(_position_torque, part, angle[:, k])
        if place.gear:
            yield f"{place.gear}.w_a", "rad/s", partial(_column, speed, k)
        if place.mesh:
            ratio = chain.links[k].ratio
            yield f"{place.mesh}.tau", "N.m", partial(np.negative, result.force_n_m[:, k])
            yield f"{place.mesh}.phi_rel", "rad", partial(_relative, angle, k, ratio)
            yield f"{place.mesh}.w_rel", "rad/s", partial(_relative, speed, k, ratio)


def _column(values: Array, k: int) -> Array:
    return values[:, k]


def _relative(values: Array, k: int, ratio: float) -> Array:
    return np.asarray(values[:, k + 1] - values[:, k] / ratio)


def _position_torque(part: TorqueRipple | Gravity, angle: Array) -> Array:
    if isinstance(part, Gravity):
        return np.asarray(-part.torque * np.sin(angle + part.phase))
    return np.asarray(sum(line.amplitude * np.sin(line.order * angle + line.phase) for line in part.lines))


def _events(places: list[Place], result: ChainResult) -> Iterator[Event]:
    """Contact and sliding as Modelica numbers them; what a component passes through in no time is left out."""
    kept: list[Event | None] = []
    latest: dict[str, int] = {}
    for event in _all_events(places, result):
        position = latest.get(event.component)
        last = None if position is None else kept[position]
        if position is not None and last is not None and last.time_s == event.time_s:
            kept[position] = None
            changed = (last.from_mode, event.to_mode, last.from_name, event.to_name)
            event = Event(event.time_s, event.component, *changed)
        if event.from_mode != event.to_mode:
            latest[event.component] = len(kept)
            kept.append(event)
    return (event for event in kept if event is not None)


def _all_events(places: list[Place], result: ChainResult) -> Iterator[Event]:
    """Of the modes within a contact only its beginning and end count."""
    meshes = [place.mesh or "" for place in places]
    sliding = [place.frictions[0] if place.frictions else place.gear or place.inertias[0] for place in places]
    for time, what, index, before, after in result.log.tolist():
        if what == CONTACT:
            old, new = (0 if abs(mode) < 0.5 else -1 if mode > 0 else 1 for mode in (before, after))
            if old != new:
                yield Event(time, meshes[int(index)], old, new, CONTACT_NAMES[old], CONTACT_NAMES[new])
        elif what == STICK:
            old, new = int(before), int(after)
            yield Event(time, sliding[int(index)], old, new, SLIDING_NAMES[old], SLIDING_NAMES[new])
