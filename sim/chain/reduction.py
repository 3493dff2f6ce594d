"""Engine 2 for a `DriveTrain`: finds the shafts in series, simulates them as a `Chain`, gives back a `Trajectory`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from sim.chain.components import GearMesh, Gravity, MeshLine, ServoDrive, ShaftFriction, TorqueRipple, TorqueWave
from sim.chain.integrate import run_chain
from sim.chain.model import CLOCK, Array, Chain, Dent, Drive, Line, Link, Servo, Shaft, Torque
from sim.chain.motion_profile import back_and_forth
from sim.chain.topology import Place, places_of
from sim.chain.trajectory import trajectory_of
from sim.errors import CompositionError, ParameterError, RunError, number
from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    Constant,
    ConstantTorque,
    Damper,
    ElastoBacklash,
    IdealGear,
    Inertia,
    LossyGear,
    Sampled,
    Sine,
    SpringDamper,
)
from sim.rotational.components import Torque as TorqueSource
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import MEMORY_LIMIT_BYTES, Trajectory

MIN_RATE_OF_SERVO_HZ = 1000.0


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
    return _chain(train, places_of(train))


def simulate_chain(
    train: DriveTrain,
    duration_s: float,
    sample_rate_hz: float,
    watch: Array | None = None,
) -> Trajectory:
    """Simulate shafts in series; channels and events bear the names of the components (`watch`: see `run_chain`)."""
    number("duration_s", duration_s, "s", above=0)
    number("sample_rate_hz", sample_rate_hz, "Hz", above=0)
    samples = round(duration_s * sample_rate_hz) + 1
    places = places_of(train)
    size = 8.0 * samples * (4 * len(places) + 1)
    if size > MEMORY_LIMIT_BYTES:
        longest = MEMORY_LIMIT_BYTES / size * duration_s
        raise ParameterError(
            f"duration_s: must be at most {longest:.0f} s at this rate (2 GB of results), got {duration_s:g}"
        )
    chain = _chain(train, places)
    drive, reference = _drive(train, places, samples, sample_rate_hz)
    start = None if isinstance(drive, Servo) else _start(train, places, chain)

    def names(column: int, link: bool) -> str:
        return (places[column].mesh or "") if link else places[column].inertias[0]

    result = run_chain(chain, drive, sample_rate_hz, samples, start=start, watch=watch, names=names)
    return trajectory_of(train, places, chain, result, reference)


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
    waves = tuple(
        Line(CLOCK, 2.0 * math.pi * part.frequency, part.torque, part.phase)
        for part in parts
        if isinstance(part, TorqueWave)
    )
    if k > 0 and any(isinstance(part, ServoDrive | TorqueSource) for part in parts):
        raise CompositionError(f"{place.torques[0]}: only the first of shafts in series can be driven by a signal")
    return Shaft(
        inertia_kg_m2=sum(_inertia(train[name]) for name in place.inertias),
        gravity_n_m=gravity[0].torque if gravity else 0.0,
        gravity_phase_rad=gravity[0].phase if gravity else 0.0,
        offset_n_m=sum(part.tau_constant for part in parts if isinstance(part, ConstantTorque)),
        ripples=(*ripples, *waves),
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
    if isinstance(part, BearingFriction) and len(part.table.lines) == 1 and part.peak == 1:
        (line,) = part.table.lines
        return ShaftFriction(coulomb=float(line.levels[0]), viscous=float(line.slopes[0]))
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
    dents = (Dent(k + (d.wheel == "driven"), d.angle, d.half_width, d.depth, d.flank, d.form) for d in mesh.dents)
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
    time = drive.begin + np.arange(samples) / rate
    reference = back_and_forth(time, drive.period, drive.top_speed, drive.ramp, drive.dwell)
    reference[0] += drive.offset
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
