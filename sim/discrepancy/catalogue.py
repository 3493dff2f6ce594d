"""Terms that this axis and these channels allow, one for every mechanism and place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from sim.axis import Axis
from sim.chain_model import Chain, Dent, with_link, with_shaft
from sim.discrepancy.catalogued import ORDERS as RIPPLE_ORDERS
from sim.discrepancy.catalogued import terms_of_catalogue
from sim.discrepancy.entries import lopsided, rounding, swing, swing_response
from sim.discrepancy.measurement import LOAD_CUT_HZ, Array, Measurement
from sim.discrepancy.model import (
    LOSS_SPLITS,
    PARTS,
    SHARED_SPREAD,
    has_links,
    is_open,
    link_stiffness,
    locked_mode_hz,
    loss_parameters,
    ratio_after,
    stages_of,
    wave,
)
from sim.discrepancy.parameters import Parameter, Values
from sim.discrepancy.terms import Report, Term

FEWEST_TEETH = 8.0  # of a pinion
LEAST_TURN = 0.5  # rad of the load over which weight shows
HUM_HZ = (50.0, 60.0, 100.0, 120.0)
SOFTEST = 0.1  # damping ratio from which nothing swings: what is late or wrong in form asks for more
LEAST_PEAK = 0.5  # torque of a part that swings at its own frequency over that of the whole load, where damped by SHARP
SHARP = 0.035  # damping ratio; softer parts count less: of 45 good loads none that seems sharp gains enough to matter
LOSS_SIDES = ((0.0, 0.5), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0))  # tried first: a load encoder sees only what is behind
HIGHEST_SWING_HZ = 0.6 * LOAD_CUT_HZ
MOTOR = "motor"
ENCODER_ERROR = ("load_encoder.error_sine_rad", "load_encoder.error_cosine_rad")
WIDEST_GAP = 6.0  # over the working twist, where play is looked for
HUM_SHARE = 0.003  # of the torque: less hum does not matter
AS_NEW_FACTOR = 3.0  # more than this above as new is a finding
MOST_DRIFT = 1.0  # of friction, within a record
OF_TEETH = 0.5  # of the torque that erring teeth make: as much at their own order may be the error of their form


OWN = frozenset(  # mechanisms with terms below, or seen by the gate or in the sound; all others say all of themselves
    {"backlash", "tooth_damage", "eccentricity", "mesh_error", "coulomb_friction", "viscous_friction",
     "stribeck_friction", "friction_asymmetry", "load_dependent_loss", "friction_drift", "gravity_imbalance",
     "torque_ripple", "stiffness_hardening", "hysteresis", "bearing_defect", "structural_resonance", "torque_offset",
     "encoder_error", "time_delay", "electrical_hum", "clipping", "lost_samples"}
)  # fmt: skip


def terms_of(axis: Axis, measurement: Measurement, present: Chain) -> tuple[Term, ...]:
    """Every mechanism of the telemetry at every place where the description lacks it; tooth damage is scanned apart.

    `present`: the model so far; friction can rise at low speed only where there is dry friction.
    """
    level = measurement.torque_rms
    top = float(np.abs(measurement.speed).max())
    out = [*_friction_terms(axis, level, top, measurement), _offset(level)]
    if any(shaft.coulomb_n_m > 0.0 for shaft in present.shafts):
        out.append(_stribeck(level, top))
    if all(shaft.coulomb_backward_n_m is None for shaft in present.shafts):
        seen_apart = has_links(axis) and measurement.load_angle is not None
        most = friction_felt(present, top) or math.inf
        out += [_asymmetry(level, top, most, place) for place in ((MOTOR, None) if seen_apart else (MOTOR,))]
    travel = float(np.ptp(measurement.angle))
    out += [_ripple(order, level, axis, present) for order in RIPPLE_ORDERS if travel * order > 2.0 * math.pi]
    out += [hum(frequency, level) for frequency in HUM_HZ if frequency < 0.4 * measurement.rate_hz]
    out.append(_delay("torque_delay_s", "motor", 6e-4))
    if has_links(axis):
        out += [
            term
            for k in range(len(stages_of(axis)))
            for term in _link_terms(axis, k, level, measurement.load_angle is not None)
        ]
        if travel / axis.ratio > LEAST_TURN:
            out.append(_gravity(0.05 * level * axis.ratio, len(stages_of(axis))))
        if measurement.load_angle is not None:
            out.append(_encoder_error(axis))
            out.append(_delay("load_delay_s", "load", 4e-4))
            out.append(_resonance(axis))
    elif travel > LEAST_TURN:
        out.append(_gravity(0.05 * level, 0))
    return (*out, *terms_of_catalogue(axis, measurement, OWN))


def _name(mechanism: str, location: str | None, parameter: str) -> str:
    return f"{mechanism}@{location}.{parameter}"


def _pair(prefix: str, step: float) -> tuple[Parameter, Parameter]:
    return Parameter(f"{prefix}.sine", 0.0, step), Parameter(f"{prefix}.cosine", 0.0, step)


def _pair_probe(prefix: str, step: float) -> tuple[tuple[Mapping[str, float], ...], ...]:
    return (({f"{prefix}.sine": step}, {f"{prefix}.cosine": step}),)


def _amplitude(pair: Sequence[Parameter], name: str, phase: str) -> Report:
    sine, cosine = (p.name for p in pair)

    def report(values: Values) -> dict[str, float]:
        return {name: math.hypot(values[sine], values[cosine]), phase: math.atan2(values[cosine], values[sine])}

    return report


# --- friction -------------------------------------------------------------------------------------------------------


def _friction_terms(axis: Axis, level: float, top: float, m: Measurement) -> list[Term]:
    out = []
    n = len(stages_of(axis)) if has_links(axis) else 0
    at_load = n > 0
    scale = axis.ratio if at_load else 1.0
    motor, load = axis.motor, axis.load
    if not (motor.coulomb_friction_n_m or load.coulomb_friction_n_m):
        out.append(_both("coulomb_friction", "torque_n_m", "coulomb_n_m", 0.05 * level, scale, n))
    if not (motor.viscous_friction_n_m_s_per_rad or load.viscous_friction_n_m_s_per_rad):
        step = 0.05 * level / top
        out.append(_both("viscous_friction", "coefficient_n_m_s_per_rad", "viscous_n_m_s", step, scale * scale, n))
    out.append(_drift(n, float(m.time_s[-1])))
    return out


def _both(mechanism: str, parameter: str, field: str, step: float, scale: float, n: int) -> Term:
    """Friction at the motor and, behind gears, at the load; reported as felt at the motor. All of it matters: a
    description without any leaves it out."""
    prefix = f"{mechanism}@None"
    names = [f"{prefix}.motor"] + ([f"{prefix}.load"] if n else [])
    sizes = [step, step * scale][: len(names)]

    def apply(chain: Chain, values: Values) -> Chain:
        for index, name in zip((0, n), names, strict=False):
            present = getattr(chain.shafts[index], field)
            chain = with_shaft(chain, index, **{field: present + values[name]})
        return chain

    def report(values: Values) -> dict[str, float]:
        return {parameter: values[names[0]] + (values[names[1]] / scale if n else 0.0)}

    parameters = tuple(Parameter(name, 0.0, 0.05 * size, low=0.0) for name, size in zip(names, sizes, strict=True))
    probes = (tuple({name: size} for name, size in zip(names, sizes, strict=True)),)
    return Term(mechanism, None if n else "motor", parameters, probes, report, apply, size=0.0)


def _stribeck(level: float, top: float) -> Term:
    """It falls with an exponent between 1 and 2 (Armstrong-Helouvry et al., Automatica 30 (1994) 1083)."""
    names = ("torque_n_m", "speed_rad_s", "exponent")
    torque, speed, exponent = (_name("stribeck_friction", "motor", p) for p in names)

    def apply(chain: Chain, values: Values) -> Chain:
        law = {"stribeck_speed_rad_s": values[speed], "stribeck_exponent": values[exponent]}
        return with_shaft(chain, 0, stribeck_n_m=values[torque], **law)

    def report(values: Values) -> dict[str, float]:
        return {"torque_n_m": values[torque], "speed_rad_s": values[speed], "exponent": values[exponent]}

    step = 0.05 * level
    parameters = (
        Parameter(torque, 0.0, 0.3 * step, low=0.0),
        Parameter(speed, 0.07 * top, 0.007 * top, 0.2 * top, 0.01 * top, 0.4 * top),
        Parameter(exponent, 1.5, 0.05, 0.5, 1.0, 2.0),
    )
    probes = tuple(({torque: step, speed: share * top},) for share in (0.03, 0.08, 0.2))
    return Term(
        "stribeck_friction", "motor", parameters, probes, report, apply, positive=True, size=0.1 * step,
        shape=(speed, exponent),
    )  # fmt: skip


def friction_felt(chain: Chain, speed: float) -> float:
    """All friction while the motor turns at `speed` [rad/s], as felt at the motor [N m]."""
    ratio, felt = 1.0, 0.0
    for shaft, link in zip_longest(chain.shafts, chain.links):
        felt += (shaft.coulomb_n_m + shaft.viscous_n_m_s * speed / ratio) / ratio
        ratio *= link.ratio if link else 1.0
    return felt


def _asymmetry(level: float, top: float, most: float, location: str | None) -> Term:
    """Of the motor's friction, or of motor's and load's alike.

    No more than `most`, all friction that there is: none pushes. What wants that limit is no asymmetry.
    """
    coulomb, viscous = (_name("friction_asymmetry", location, p) for p in ("coulomb", "viscous"))

    def apply(chain: Chain, values: Values) -> Chain:
        return lopsided(chain, location, values[coulomb], values[viscous])

    def report(values: Values) -> dict[str, float]:
        return {"torque_n_m": values[coulomb], "coefficient_n_m_s_per_rad": values[viscous]}

    def magnitude(values: Values) -> float:
        if abs(values[coulomb]) > 0.99 * most:
            return 0.0
        return max(abs(values[coulomb] + share * top * values[viscous]) for share in (0.3, 1.0))

    step = 0.03 * level
    parameters = (Parameter(coulomb, 0.0, step, low=-most, high=most), Parameter(viscous, 0.0, step / top))
    probes = (({viscous: step / top},), ({coulomb: step}, {viscous: step / top}))
    return Term("friction_asymmetry", location, parameters, probes, report, apply, size=0.1 * step, magnitude=magnitude)


def _drift(n: int, duration: float) -> Term:
    """Friction that changes by as much as there is of it is no oil that warms up: what wants the limit is none."""
    rate, most = _name("friction_drift", None, "rate_per_s"), MOST_DRIFT / duration

    def apply(chain: Chain, values: Values) -> Chain:
        for index in {0, n}:
            chain = with_shaft(chain, index, drift_per_s=values[rate])
        return chain

    step = 0.1 / duration
    return Term(
        "friction_drift", None, (Parameter(rate, 0.0, step, low=-most, high=most),), (({rate: step},),),
        lambda v: {"rate_per_s": v[rate]}, apply, size=0.3 * step,
        magnitude=lambda v: v[rate] if abs(v[rate]) < 0.99 * most else 0.0,
    )  # fmt: skip


# --- torque at the motor, gravity, measurement ----------------------------------------------------------------------


def _offset(level: float) -> Term:
    name, step = "offset_n_m", 0.01 * level
    return Term(
        "torque_offset", "motor", (Parameter(name, 0.0, step),), (({name: step},),), lambda v: {"torque_n_m": v[name]},
        replaces=(name,), size=0.5 * step,
    )  # fmt: skip


def _delay(name: str, location: str, size: float) -> Term:
    parameters = (Parameter(name, 0.0, 0.2 * size, low=-0.02, high=0.02),)
    return Term(
        "time_delay", location, parameters, (({name: size},), ({name: -size},)), lambda v: {"delay_s": v[name]},
        replaces=(name,), size=size,
    )  # fmt: skip


def hum(frequency: float, level: float) -> Term:
    """Hum of the mains in the torque channel at a frequency [Hz]; `level`: rms of the torque [N m], for its step."""
    prefix = f"electrical_hum{frequency:g}@motor"
    step = 0.01 * level

    def torque(m: Measurement, values: Values) -> Array:
        turn = 2.0 * np.pi * frequency * m.time_s
        return values[f"{prefix}.sine"] * np.sin(turn) + values[f"{prefix}.cosine"] * np.cos(turn)

    def report(values: Values) -> dict[str, float]:
        sine, cosine = values[f"{prefix}.sine"], values[f"{prefix}.cosine"]
        return {
            "torque_n_m": math.hypot(sine, cosine),
            "frequency_hz": frequency,
            "phase_rad": math.atan2(cosine, sine),
        }

    return Term(
        "electrical_hum", "motor", _pair(prefix, step), _pair_probe(prefix, step), report, torque=torque,
        size=HUM_SHARE * level,
    )  # fmt: skip


def _ripple(order: float, level: float, axis: Axis, present: Chain) -> Term:
    """Torque over the motor's angle; what teeth make as new, or err by, where it may be theirs, is none."""
    prefix = f"torque_ripple{order:g}@motor"
    step = 0.01 * level

    def torque(m: Measurement, values: Values) -> Array:
        return values[f"{prefix}.sine"] * np.sin(order * m.angle) + values[f"{prefix}.cosine"] * np.cos(order * m.angle)

    def report(values: Values) -> dict[str, float]:
        sine, cosine = -values[f"{prefix}.sine"], -values[f"{prefix}.cosine"]  # what is felt is what the drive balances
        return {"torque_n_m": math.hypot(sine, cosine), "order": order, "phase_rad": math.atan2(cosine, sine)}

    size = max(0.3 * step, AS_NEW_FACTOR * _torque_of_teeth(axis, order), OF_TEETH * _torque_of_errors(present, order))
    return Term(
        "torque_ripple", "motor", _pair(prefix, step), _pair_probe(prefix, step), report, torque=torque, size=size
    )


def _torque_of_teeth(axis: Axis, order: float) -> float:
    """What errors of the first gear pair as new may make at the motor once per `order` of its turns [N m].

    Of its stiffness as large as it may be, where only the whole transmission's is known.
    """
    if not axis.stages:
        return 0.0
    first = axis.stages[0]
    teeth = first.driver_teeth
    theirs = order >= FEWEST_TEETH if teeth is None else order % teeth == 0
    stiffness = link_stiffness(axis, 0) * (1.0 + 2.0 * SHARED_SPREAD if is_open(axis, 0) else 1.0)
    return first.transmission_error_rad * stiffness / first.ratio if theirs else 0.0


def _torque_of_errors(present: Chain, order: float) -> float:
    """What the errors of gears so far make at the motor, the load held, once per `order` of its turns [N m]."""
    turns = [1.0]  # of the motor per turn of each shaft
    torque = 0.0
    for link in present.links:
        turns.append(turns[-1] * link.ratio)
        same = (e.amplitude for e in link.errors if math.isclose(e.order, order * turns[e.shaft], rel_tol=1e-6))
        torque += sum(same) * link.stiffness_n_m_per_rad / turns[-1]
    return torque


def _gravity(step: float, shaft: int) -> Term:
    pair = _pair("gravity_imbalance@load", step)
    sine, cosine = (p.name for p in pair)

    def apply(chain: Chain, values: Values) -> Chain:
        size, phase = math.hypot(values[sine], values[cosine]), math.atan2(values[cosine], values[sine])
        return with_shaft(chain, shaft, gravity_n_m=size, gravity_phase_rad=phase)

    probes = (tuple({p.name: step} for p in pair),)
    report = _amplitude(pair, "torque_n_m", "phase_rad")
    return Term("gravity_imbalance", "load", pair, probes, report, apply, size=0.05 * step)


def _encoder_error(axis: Axis) -> Term:
    names = ENCODER_ERROR
    step = max(axis.load_encoder.error_rad, 1e-5)
    parameters = tuple(Parameter(name, 0.0, step) for name in names)
    probes = (tuple({name: 2.0 * AS_NEW_FACTOR * step} for name in names),)
    report = _amplitude(parameters, "amplitude_rad", "phase_rad")
    return Term("encoder_error", "load", parameters, probes, report, replaces=names, size=AS_NEW_FACTOR * step)


def _resonance(axis: Axis) -> Term:
    """A part of the load that swings on a spring of its own, where the load's motion is known well enough."""
    names = [_name("structural_resonance", "load", p) for p in ("share", "frequency_hz", "damping_ratio")]
    share, frequency, damping = names
    mode = locked_mode_hz(axis)
    start = min(mode, 0.8 * HIGHEST_SWING_HZ)

    def torque(m: Measurement, values: Values) -> Array:
        return -swing(m, axis.load.inertia_kg_m2, *(values[name] for name in names))

    parameters = (
        Parameter(share, 0.0, 0.005, low=0.0, high=1.0),
        Parameter(frequency, start, 0.003 * start, low=0.3 * start, high=HIGHEST_SWING_HZ),
        Parameter(damping, 0.02, 0.002, 0.02, 0.002, SOFTEST),
    )
    grid = np.geomspace(0.5 * start, min(2.0 * mode, HIGHEST_SWING_HZ), 24)
    probes = tuple(({share: 0.02, frequency: float(f)},) for f in grid)
    return Term(
        "structural_resonance", "load", parameters, probes,
        lambda v: {"frequency_hz": v[frequency], "share": v[share], "damping_ratio": v[damping]},
        load_torque=torque, positive=True, nonlinear=True,
        response=lambda s, v: swing_response(s, v[share], v[frequency], v[damping]),
        size=LEAST_PEAK, shape=(frequency, damping),
        magnitude=lambda v: v[share] / (2.0 * v[damping]) * SHARP / v[damping] if v[damping] < SOFTEST else 0.0,
    )  # fmt: skip


# --- gear stages ----------------------------------------------------------------------------------------------------


def _link_terms(axis: Axis, k: int, level: float, load_encoder: bool) -> list[Term]:
    """Laws of the spring need the twist: without a load encoder they look like friction at reversals."""
    name = stages_of(axis)[k]
    stage = axis.stages[k] if axis.stages else None
    ratio = axis.ratio / ratio_after(axis, k)
    stiffness = axis.stiffness()[k] or 0.0
    twist = level * ratio / stiffness if stiffness else 1e-3
    out = [_hardening(name, k, twist)] if load_encoder else []
    if load_encoder:
        out.append(_hysteresis(name, k, level * ratio, twist))
    if stage is None:
        return out
    out.append(_backlash(name, k, stage.backlash_rad, twist))
    new = max(stage.transmission_error_rad or 0.01 * twist, axis.load_encoder.error_rad / ratio_after(axis, k))
    runout = _error("eccentricity", name, k, 1.0, twist, new)
    out.append(_with_encoder(runout) if load_encoder and k == len(axis.stages) - 1 else runout)
    if k == 0:
        out.append(_error("eccentricity", MOTOR, k, 1.0, twist, stage.transmission_error_rad))
    if stage.driven_teeth:
        new = stage.transmission_error_rad
        own = tuple(f"mesh.{name}.{part}_rad" for part in PARTS) if new else ()
        out.append(_error("mesh_error", name, k, float(stage.driven_teeth), 0.3 * twist, new, own))
    if stage.mesh_efficiency >= 1.0:
        out.append(_loss(name, k))
    return out


def _backlash(name: str, k: int, new: float, twist: float) -> Term:
    gap = _name("backlash", name, "gap_rad")

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, gap_rad=values[gap])

    widest = max(WIDEST_GAP * twist, 16.0 * new)
    probes = tuple(({gap: float(x)},) for x in np.geomspace(max(0.05 * twist, 4.0 * new), widest, 12))
    step = max(0.3 * new, 0.01 * twist)
    return Term(
        "backlash", name, (Parameter(gap, 0.0, step, low=0.0),), probes, lambda v: {"gap_rad": v[gap]}, apply,
        positive=True, nonlinear=True, contact=True, replaces=(f"stages.{name}.backlash_rad",),
        size=max(AS_NEW_FACTOR * new, 0.01 * twist),
    )  # fmt: skip


def _error(
    mechanism: str, name: str, k: int, order: float, step: float, new: float, replaces: tuple[str, ...] = ()
) -> Term:
    """Once per turn, or per tooth: that with its second harmonic, as the form of teeth has one.

    `replaces`: amplitudes of the same wave that the description's own model has, as new; they are set free.
    """
    prefix = f"{mechanism}@{name}"
    own = () if replaces else _pair(prefix, 0.1 * step)
    first = tuple(Parameter(at, 0.0, 0.1 * step) for at in replaces) or own
    second = _pair(f"{prefix}.second", 0.1 * step) if order > 1.0 else ()
    waves = [(pair, times) for pair, times in ((own, order), (second, 2.0 * order)) if pair]
    shaft = 0 if name == MOTOR else k + 1

    def apply(chain: Chain, values: Values) -> Chain:
        errors = chain.links[k].errors
        for (sine, cosine), times in waves:
            errors += wave(shaft, times, values[sine.name], values[cosine.name])
        return with_link(chain, k, errors=errors)

    first_said = _amplitude(first, "amplitude_rad", "phase_rad")
    second_said = _amplitude(second, "second_amplitude_rad", "second_phase_rad") if second else None

    def report(values: Values) -> dict[str, float]:
        return {**first_said(values), **(second_said(values) if second_said else {})}

    jump = 2.0 * AS_NEW_FACTOR * new if replaces else 0.1 * step  # out of the limits of what is as new
    probe = (*({p.name: jump} for p in first), *({p.name: p.step} for p in second))
    return Term(
        mechanism, name, (*first, *second), (probe,), report, apply, replaces=replaces, size=AS_NEW_FACTOR * new,
    )  # fmt: skip


def _with_encoder(runout: Term) -> Term:
    """Runout of the load's own gear, held against what is as new together with what the load encoder errs.

    They add up in the twist, and no measurement of motor and load parts them.
    """
    pairs = tuple(zip((p.name for p in runout.parameters), ENCODER_ERROR, strict=True))
    return replace(runout, magnitude=lambda v: math.hypot(*(v[own] - v.get(error, 0.0) for own, error in pairs)))


def _loss(name: str, k: int) -> Term:
    fraction = _name("load_dependent_loss", name, "fraction")

    def apply(chain: Chain, values: Values) -> Chain:
        lost = values[fraction]
        return with_link(chain, k, efficiency=(1.0 / (1.0 + lost), 1.0 - lost))

    parameters = (Parameter(fraction, 0.0, 0.005, low=0.0, high=0.6),)
    probes = tuple(({fraction: 0.02, **dict(zip(LOSS_SPLITS, split, strict=True))},) for split in LOSS_SIDES)
    return Term(
        "load_dependent_loss", name, parameters, probes, lambda v: {"fraction": v[fraction]}, apply,
        positive=True, size=0.003, brings=loss_parameters(),
    )  # fmt: skip


def _hardening(name: str, k: int, twist: float) -> Term:
    cubic = _name("stiffness_hardening", name, "cubic_per_rad2")
    step = 0.05 / (2.0 * twist) ** 2

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, cubic_per_rad2=values[cubic])

    return Term(
        "stiffness_hardening", name, (Parameter(cubic, 0.0, step, low=0.0),), (({cubic: step},),),
        lambda v: {"cubic_per_rad2": v[cubic]}, apply, positive=True, nonlinear=True, size=0.1 * step,
    )  # fmt: skip


def _hysteresis(name: str, k: int, torque: float, twist: float) -> Term:
    level, width = (_name("hysteresis", name, p) for p in ("torque_n_m", "twist_rad"))

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, hysteresis_n_m=values[level], hysteresis_rad=values[width])

    parameters = (
        Parameter(level, 0.0, 0.01 * torque, low=0.0),
        Parameter(width, 0.1 * twist, 0.02 * twist, 0.3 * twist, 0.02 * twist, 2.0 * twist),
    )
    probes = tuple(({level: 0.03 * torque, width: share * twist},) for share in (0.05, 0.2, 0.6))
    return Term(
        "hysteresis", name, parameters, probes, lambda v: {"torque_n_m": v[level], "width_rad": v[width]},
        apply, positive=True, nonlinear=True, size=0.005 * torque, shape=(width,),
    )  # fmt: skip


def tooth_damage(
    name: str,
    k: int,
    teeth: int,
    flank: int,
    angle_rad: float,
    starts: Sequence[tuple[float, float]],
    size: float,
    deepest: float,
) -> Term:
    """A dent on one flank of the driven gear of link `k`; `starts`: angles and depths worth trying.

    About one pitch wide, the window in which that tooth carries, between a worn hollow and a piece broken out. A dent
    deeper than the twist is left before its bottom: then how long contact is lost says how wide it is, how far the load
    falls back how deep. `deepest`: a dent as deep as the working twist is never touched at its bottom.
    """
    numbers = ("depth_rad", "angle_rad", "width_rad", "form")
    depth, angle, width, form = (_name("tooth_damage", name, p) for p in numbers)
    pitch = 2.0 * math.pi / teeth

    def apply(chain: Chain, values: Values) -> Chain:
        dent = Dent(k + 1, values[angle], values[width], values[depth], flank, values[form])
        return with_link(chain, k, dents=(*chain.links[k].dents, dent))

    def report(values: Values) -> dict[str, float]:
        return {
            "depth_rad": values[depth],
            "angle_rad": values[angle] % (2 * math.pi),
            "flank": float(flank),
            "width_rad": values[width] * rounding(values[form]),
            "form": values[form],
        }

    parameters = (
        Parameter(depth, 0.0, 0.003 * deepest, low=0.0, high=deepest),
        Parameter(angle, angle_rad, 0.02 * pitch, low=angle_rad - 6 * pitch, high=angle_rad + 6 * pitch),
        Parameter(width, 0.6 * pitch, 0.01 * pitch, 0.15 * pitch, 0.2 * pitch, 1.5 * pitch),
        Parameter(form, 4.0, 0.1, 4.0, 1.2, 40.0),
    )
    probes = tuple(({angle: a, depth: d},) for a, d in starts)
    return Term(
        "tooth_damage", name, parameters, probes, report, apply, positive=True, nonlinear=True, contact=True, size=size
    )
