"""The described axis with what was found: new numbers in their places, mechanisms as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sim.axis import Axis, MechanismEntry, Stage
from sim.discrepancy.fit import Fit
from sim.discrepancy.parameters import Values
from sim.discrepancy.terms import Term

SIMPLE = ("coulomb_friction", "viscous_friction")


def extended_axis(axis: Axis, fit: Fit, terms: Sequence[Term]) -> Axis:
    """An axis that `simulate` and a further investigation take: numbers of `fit`, and `terms` of it on top."""
    values = fit.values
    get = values.get
    said = {p.name for t in terms for p in t.parameters}

    def told(name: str) -> float:
        return values[name] if name in said else 0.0

    motor = replace(
        axis.motor,
        inertia_kg_m2=get("motor.inertia_kg_m2", axis.motor.inertia_kg_m2),
        coulomb_friction_n_m=get("motor.coulomb_friction_n_m", axis.motor.coulomb_friction_n_m)
        + told("coulomb_friction@None.motor"),
        viscous_friction_n_m_s_per_rad=get(
            "motor.viscous_friction_n_m_s_per_rad", axis.motor.viscous_friction_n_m_s_per_rad
        )
        + told("viscous_friction@None.motor"),
    )
    load = replace(
        axis.load,
        inertia_kg_m2=get("load.inertia_kg_m2", axis.load.inertia_kg_m2),
        coulomb_friction_n_m=get("load.coulomb_friction_n_m", axis.load.coulomb_friction_n_m)
        + told("coulomb_friction@None.load"),
        viscous_friction_n_m_s_per_rad=get(
            "load.viscous_friction_n_m_s_per_rad", axis.load.viscous_friction_n_m_s_per_rad
        )
        + told("viscous_friction@None.load"),
    )
    stages = tuple(_stage(axis, k, values) for k in range(len(axis.stages)))
    entries = tuple(
        MechanismEntry(t.mechanism, t.location, {k: float(v) for k, v in t.report(values).items()})
        for t in terms
        if t.mechanism not in SIMPLE
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
