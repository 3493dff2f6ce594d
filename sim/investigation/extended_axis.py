"""The described axis with what was found: new numbers in their places, mechanisms as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sim.description.axis import Axis, MechanismEntry, Stage
from sim.investigation.estimation.estimate import Fit
from sim.investigation.hypotheses.friction import friction_key
from sim.investigation.hypotheses.hypothesis import Term, traits_of
from sim.investigation.model.parameters import Values
from sim.mechanisms import CoulombFriction, ViscousFriction


def extended_axis(axis: Axis, fit: Fit, terms: Sequence[Term]) -> Axis:
    """An axis that `simulate` and a further investigation take: numbers of `fit`, and `terms` of it on top."""
    unsaid = {p.name for t in fit.terms if t not in terms for p in t.parameters}
    values = {name: value for name, value in fit.values.items() if name not in unsaid}
    return extended_by(axis, values, {(t.mechanism, t.location): t.report(fit.values) for t in terms})


def extended_by(axis: Axis, values: Values, found: Mapping[tuple[str, str | None], Mapping[str, float]]) -> Axis:
    """The axis with the numbers `values` in their places and the mechanisms `found` with their parameters."""
    get = values.get
    motor = replace(
        axis.motor,
        inertia_kg_m2=get("motor.inertia_kg_m2", axis.motor.inertia_kg_m2),
        coulomb_friction_n_m=get("motor.coulomb_friction_n_m", axis.motor.coulomb_friction_n_m)
        + get(friction_key(CoulombFriction, "motor"), 0.0),
        viscous_friction_n_m_s_per_rad=get(
            "motor.viscous_friction_n_m_s_per_rad", axis.motor.viscous_friction_n_m_s_per_rad
        )
        + get(friction_key(ViscousFriction, "motor"), 0.0),
    )
    load = replace(
        axis.load,
        inertia_kg_m2=get("load.inertia_kg_m2", axis.load.inertia_kg_m2),
        coulomb_friction_n_m=get("load.coulomb_friction_n_m", axis.load.coulomb_friction_n_m)
        + get(friction_key(CoulombFriction, "load"), 0.0),
        viscous_friction_n_m_s_per_rad=get(
            "load.viscous_friction_n_m_s_per_rad", axis.load.viscous_friction_n_m_s_per_rad
        )
        + get(friction_key(ViscousFriction, "load"), 0.0),
    )
    stages = tuple(_stage(axis, k, values) for k in range(len(axis.stages)))
    entries = tuple(
        MechanismEntry(mechanism, location, {k: float(v) for k, v in numbers.items()})
        for (mechanism, location), numbers in found.items()
        if not traits_of(mechanism).in_every_axis
    )
    return replace(axis, motor=motor, load=load, stages=stages, mechanisms=(*axis.mechanisms, *entries))


def _stage(axis: Axis, k: int, values: Values) -> Stage:
    stage = axis.stages[k]
    where = f"stages.{stage.name}"
    changes: dict[str, float] = {}
    for name in ("inertia_kg_m2", "stiffness_n_m_per_rad", "damping_n_m_s_per_rad", "mesh_efficiency"):
        if f"{where}.{name}" in values:
            changes[name] = values[f"{where}.{name}"]
    return replace(stage, **changes)  # type: ignore[arg-type]
