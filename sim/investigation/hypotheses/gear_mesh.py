"""Hypotheses about meshes: backlash, errors of teeth, losses, hardening, hysteresis, damaged teeth, ripple."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.chain.model import Chain, Dent, with_link
from sim.description.axis import Axis
from sim.description.transmission import link_stiffness
from sim.investigation.data.preprocessing import Array, Measurement
from sim.investigation.hypotheses.hypothesis import (
    AS_NEW_FACTOR,
    ENCODER_ERROR,
    Term,
    amplitude,
    cosine_and_sine,
    cosine_and_sine_probe,
    parameter_key,
)
from sim.investigation.model.nominal import (
    LOSS_SPLITS,
    PARTS,
    SHARED_SPREAD,
    is_open,
    loss_parameters,
    mesh_wave,
    ratio_after,
    stages_of,
    wave,
)
from sim.investigation.model.parameters import Parameter, Values
from sim.mechanisms import (
    Backlash,
    Eccentricity,
    Hysteresis,
    KinematicError,
    LoadDependentLoss,
    MeshError,
    StiffnessHardening,
    ToothDamage,
    TorqueRippleOfMotor,
)

FEWEST_TEETH = 8.0  # of a pinion
LOSS_SIDES = ((0.0, 0.5), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0))  # tried first: a load encoder sees only what is behind
MOTOR = "motor"
WAVE_ORDERS = (2.0, 4.0)  # per turn of an oval wave generator; once is runout of that shaft
WIDEST_GAP = 6.0  # over the working twist, where play is looked for
ALL_OF_IT = 0.9  # of the twist
OF_TEETH = 0.5  # of the torque that erring teeth make: as much at their own order may be the error of their form


def ripple(order: float, level: float, axis: Axis, present: Chain) -> Term:
    """Torque over the motor's angle; what teeth make as new, or err by, where it may be theirs, is none."""
    prefix = f"{TorqueRippleOfMotor.name}{order:g}@motor"
    step = 0.01 * level

    def torque(m: Measurement, values: Values) -> Array:
        return values[f"{prefix}.sine"] * np.sin(order * m.angle) + values[f"{prefix}.cosine"] * np.cos(order * m.angle)

    def report(values: Values) -> dict[str, float]:
        sine, cosine = -values[f"{prefix}.sine"], -values[f"{prefix}.cosine"]  # what is felt is what the drive balances
        return {"torque_n_m": math.hypot(sine, cosine), "order": order, "phase_rad": math.atan2(cosine, sine)}

    size = max(0.3 * step, AS_NEW_FACTOR * _torque_of_teeth(axis, order), OF_TEETH * _torque_of_errors(present, order))
    return Term(
        TorqueRippleOfMotor.name,
        "motor",
        cosine_and_sine(prefix, step, "N m"),
        cosine_and_sine_probe(prefix, step),
        report,
        torque=torque,
        size=size,
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


def link_terms(axis: Axis, k: int, level: float, carried: float, seen_twist_rad: float | None) -> list[Term]:
    """Laws of the spring need the twist: without a load encoder they look like friction at reversals.

    `level`, `carried`: effective torque of the motor, and what of it the gears carry [N m].
    `seen_twist_rad`: range of the twist at the load that both encoders show, None without a load encoder.
    """
    load_encoder = seen_twist_rad is not None
    widest = math.inf if seen_twist_rad is None else seen_twist_rad * ratio_after(axis, k)
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
    wound = carried * ratio / stiffness if stiffness else twist
    out.append(_backlash(name, k, stage.backlash_rad, wound, widest))
    new = max(stage.transmission_error_rad or 0.01 * twist, axis.load_encoder.error_rad / ratio_after(axis, k))
    runout = _error(Eccentricity.name, name, k, 1.0, twist, new)
    out.append(_with_encoder(runout) if load_encoder and k == len(axis.stages) - 1 else runout)
    if k == 0:
        out.append(_error(Eccentricity.name, MOTOR, k, 1.0, twist, stage.transmission_error_rad))
    if stage.driven_teeth:
        new = stage.transmission_error_rad
        own = tuple(mesh_wave(name, part) for part in PARTS) if new else ()
        out.append(_error(MeshError.name, name, k, float(stage.driven_teeth), 0.3 * twist, new, own))
    if stage.mesh_efficiency >= 1.0:
        out.append(_loss(name, k))
    return out


def _backlash(name: str, k: int, new: float, twist: float, seen: float) -> Term:
    """Narrower than the twist that is seen, of which springs take a part: what wants all of it is no gap."""
    gap = parameter_key(Backlash.name, name, "gap_rad")

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, gap_rad=values[gap])

    widest = min(max(WIDEST_GAP * twist, 16.0 * new), seen)
    least = min(max(0.05 * twist, 4.0 * new), 0.5 * widest)
    probes = tuple(({gap: float(x)},) for x in np.geomspace(least, widest, 12))
    step = max(0.3 * new, 0.01 * twist)
    return Term(
        Backlash.name, name, (Parameter(gap, 0.0, step, low=0.0, high=seen, unit="rad"),), probes,
        lambda v: {"gap_rad": v[gap]}, apply, positive=True, nonlinear=True, contact=True,
        replaces=(f"stages.{name}.backlash_rad",),
        size=max(AS_NEW_FACTOR * new, 0.01 * twist), magnitude=lambda v: v[gap] if v[gap] < ALL_OF_IT * seen else 0.0,
        as_new_too=True,  # what is always fitted ends below where a gap begins to matter
    )  # fmt: skip


def _error(
    mechanism: str, name: str, k: int, order: float, step: float, new: float, replaces: tuple[str, ...] = ()
) -> Term:
    """Once per turn, or per tooth: that with its second harmonic, as the form of teeth has one.

    `replaces`: amplitudes of the same wave that the description's own model has, as new; they are set free.
    """
    prefix = f"{mechanism}@{name}"
    own = () if replaces else cosine_and_sine(prefix, 0.1 * step, "rad")
    first = tuple(Parameter(at, 0.0, 0.1 * step, unit="rad") for at in replaces) or own
    second = cosine_and_sine(f"{prefix}.second", 0.1 * step, "rad") if order > 1.0 else ()
    waves = [(pair, times) for pair, times in ((own, order), (second, 2.0 * order)) if pair]
    shaft = 0 if name == MOTOR else k + 1

    def apply(chain: Chain, values: Values) -> Chain:
        errors = chain.links[k].errors
        for (sine, cosine), times in waves:
            errors += wave(shaft, times, values[sine.name], values[cosine.name])
        return with_link(chain, k, errors=errors)

    first_said = amplitude(first, "amplitude_rad", "phase_rad")
    second_said = amplitude(second, "second_amplitude_rad", "second_phase_rad") if second else None

    def report(values: Values) -> dict[str, float]:
        return {**first_said(values), **(second_said(values) if second_said else {})}

    jump = 2.0 * AS_NEW_FACTOR * new if replaces else 0.1 * step  # out of the limits of what is as new
    probe = (*({p.name: jump} for p in first), *({p.name: p.step} for p in second))
    return Term(
        mechanism, name, (*first, *second), (probe,), report, apply, replaces=replaces, size=AS_NEW_FACTOR * new,
        as_new_too=not replaces,  # every new axis has them, if small
    )  # fmt: skip


def kinematic_terms(axis: Axis, k: int, level: float, fastest: int) -> list[Term]:
    """Error of a gear of which only the ratio is described, two and four times per turn of its input shaft.

    `fastest`: times per turn of the motor that the rate shows.
    """
    if not axis.stages or axis.stages[k].driven_teeth:
        return []
    stage, before = axis.stages[k], ratio_after(axis, k) * axis.stages[k].ratio / axis.ratio
    twist = level * axis.ratio / ratio_after(axis, k) / link_stiffness(axis, k)
    new = stage.transmission_error_rad or 0.01 * twist
    return [_kinematic(stage.name, k, order, twist, new) for order in WAVE_ORDERS if order * before < fastest]


def _kinematic(name: str, k: int, order: float, twist: float, new: float) -> Term:
    prefix, step = f"{KinematicError.name}{order:g}@{name}", 0.01 * twist
    pair = cosine_and_sine(prefix, step, "rad")
    sine, cosine = (p.name for p in pair)
    said = amplitude(pair, "amplitude_rad", "phase_rad")

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, errors=chain.links[k].errors + wave(k, order, values[sine], values[cosine]))

    def report(values: Values) -> dict[str, float]:
        return {**said(values), "order": order}

    return Term(
        KinematicError.name, name, pair, cosine_and_sine_probe(prefix, step), report, apply, size=AS_NEW_FACTOR * new,
        among=len(WAVE_ORDERS),
    )  # fmt: skip


def _with_encoder(runout: Term) -> Term:
    """Runout of the load's own gear, held against what is as new together with what the load encoder errs.

    They add up in the twist, and no measurement of motor and load parts them.
    """
    pairs = tuple(zip((p.name for p in runout.parameters), ENCODER_ERROR, strict=True))
    return replace(runout, magnitude=lambda v: math.hypot(*(v[own] - v.get(error, 0.0) for own, error in pairs)))


def _loss(name: str, k: int) -> Term:
    fraction = parameter_key(LoadDependentLoss.name, name, "fraction")

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, loss_fraction=values[fraction])

    parameters = (Parameter(fraction, 0.0, 0.005, low=0.0, high=0.6),)
    probes = tuple(({fraction: 0.02, **dict(zip(LOSS_SPLITS, split, strict=True))},) for split in LOSS_SIDES)
    return Term(
        LoadDependentLoss.name, name, parameters, probes, lambda v: {"fraction": v[fraction]}, apply,
        positive=True, size=0.003, brings=loss_parameters(),
    )  # fmt: skip


def _hardening(name: str, k: int, twist: float) -> Term:
    cubic = parameter_key(StiffnessHardening.name, name, "cubic_per_rad2")
    step = 0.05 / (2.0 * twist) ** 2

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, cubic_per_rad2=values[cubic])

    return Term(
        StiffnessHardening.name, name, (Parameter(cubic, 0.0, step, low=0.0, unit="1/rad2"),), (({cubic: step},),),
        lambda v: {"cubic_per_rad2": v[cubic]}, apply, positive=True, nonlinear=True, size=0.1 * step,
    )  # fmt: skip


def _hysteresis(name: str, k: int, torque: float, twist: float) -> Term:
    level, width = (parameter_key(Hysteresis.name, name, p) for p in ("torque_n_m", "twist_rad"))

    def apply(chain: Chain, values: Values) -> Chain:
        return with_link(chain, k, hysteresis_n_m=values[level], hysteresis_rad=values[width])

    parameters = (
        Parameter(level, 0.0, 0.01 * torque, low=0.0, unit="N m"),
        Parameter(width, 0.1 * twist, 0.02 * twist, 0.3 * twist, 0.02 * twist, 2.0 * twist, unit="rad"),
    )
    probes = tuple(({level: 0.03 * torque, width: share * twist},) for share in (0.05, 0.2, 0.6))
    return Term(
        Hysteresis.name, name, parameters, probes, lambda v: {"torque_n_m": v[level], "width_rad": v[width]},
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
    depth, angle, width, form = (parameter_key(ToothDamage.name, name, p) for p in numbers)
    pitch = 2.0 * math.pi / teeth

    def apply(chain: Chain, values: Values) -> Chain:
        dent = Dent(k + 1, values[angle], values[width], values[depth], flank, values[form])
        return with_link(chain, k, dents=(*chain.links[k].dents, dent))

    def report(values: Values) -> dict[str, float]:
        return {
            "depth_rad": values[depth],
            "angle_rad": values[angle] % (2 * math.pi),
            "flank": float(flank),
            "width_rad": values[width],
            "form": values[form],
        }

    parameters = (
        Parameter(depth, 0.0, 0.003 * deepest, low=0.0, high=deepest, unit="rad"),
        Parameter(angle, angle_rad, 0.02 * pitch, low=angle_rad - 6 * pitch, high=angle_rad + 6 * pitch, unit="rad"),
        Parameter(width, 0.7 * pitch, 0.01 * pitch, 0.17 * pitch, 0.23 * pitch, 1.75 * pitch, unit="rad"),
        Parameter(form, 4.0, 0.1, 4.0, 1.2, 40.0),
    )
    probes = tuple(({depth: d, angle: a},) for a, d in starts)
    return Term(
        ToothDamage.name,
        name,
        parameters,
        probes,
        report,
        apply,
        positive=True,
        nonlinear=True,
        contact=True,
        size=size,
    )
