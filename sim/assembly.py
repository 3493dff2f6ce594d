"""From an axis description to what can be simulated: a drive train."""

from __future__ import annotations

from dataclasses import replace

from sim.description.axis import Axis
from sim.description.transmission import link_damping, link_stiffness
from sim.errors import AxisError
from sim.mechanisms.catalogue import apply_mechanisms
from sim.rotational.component import Component, Signal
from sim.rotational.components import (
    BearingFriction,
    Damper,
    ElastoBacklash,
    Fixed,
    IdealGear,
    Inertia,
    LossyGear,
    Torque,
)
from sim.rotational.drive_train import DriveTrain


def drive_train_of(axis: Axis, drive: Signal | None = None) -> DriveTrain:
    """Return the drive train of an axis description, its mechanisms applied.

    `motor` (Inertia), per stage `<stage>_gear` (LossyGear, or IdealGear at efficiency 1) and `<stage>`
    (ElastoBacklash at the driven gear) and, between stages, `<stage>_shaft` (Inertia); the last shaft is `load`.
    `motor_friction` and `load_friction` (BearingFriction, or Damper with its ground) stand where friction is not
    0. `drive` is the motor's torque [N m] over time.
    """
    return apply_mechanisms(_plain_train(axis, drive))


def _plain_train(axis: Axis, drive: Signal | None) -> DriveTrain:
    """Return the axis as built, without its mechanisms."""
    if not axis.motor.inertia_kg_m2:
        raise AxisError(
            "motor.inertia_kg_m2: not described, and a simulation needs it; "
            "the extended axis of an investigation has it"
        )
    parts: dict[str, Component] = {"motor": Inertia(J=axis.motor.inertia_kg_m2)}
    if not axis.stages:
        return _direct(axis, drive)
    for i, stage in enumerate(axis.stages):
        last = i == len(axis.stages) - 1
        inertia = stage.inertia_kg_m2 + (axis.load.inertia_kg_m2 if last else 0.0)
        parts[f"{stage.name}_gear"] = _gear(stage.ratio, stage.mesh_efficiency)
        mesh = ElastoBacklash(c=link_stiffness(axis, i), d=link_damping(axis, i), b=stage.backlash_rad)
        parts[stage.name] = mesh
        parts["load" if last else f"{stage.name}_shaft"] = Inertia(J=inertia)
    return _with_friction(DriveTrain.series(**parts), axis, drive)


def _direct(axis: Axis, drive: Signal | None) -> DriveTrain:
    """A drive without gears: one shaft, or two with the coupling that `transmission` describes."""
    if axis.stiffness()[0] is None or axis.load.inertia_kg_m2 == 0:
        shaft = Inertia(J=axis.motor.inertia_kg_m2 + axis.load.inertia_kg_m2)
        return _with_friction(DriveTrain.series(motor=shaft), axis, drive)
    coupling = ElastoBacklash(c=link_stiffness(axis, 0), d=link_damping(axis, 0))
    motor, load = Inertia(J=axis.motor.inertia_kg_m2), Inertia(J=axis.load.inertia_kg_m2)
    return _with_friction(DriveTrain.series(motor=motor, coupling=coupling, load=load), axis, drive)


def _gear(ratio: float, efficiency: float) -> Component:
    if efficiency == 1:
        return IdealGear(ratio=ratio)
    return LossyGear(ratio=ratio, lossTable=[0, efficiency, efficiency, 0, 0])


def _with_friction(train: DriveTrain, axis: Axis, drive: Signal | None) -> DriveTrain:
    end = "load" if "load" in train.components else "motor"
    for name, shaft, part in (("motor_friction", "motor", axis.motor), ("load_friction", end, axis.load)):
        coulomb, viscous = part.coulomb_friction_n_m, part.viscous_friction_n_m_s_per_rad
        if coulomb:
            friction = BearingFriction(tau_pos=[[0, coulomb], [1, coulomb + viscous]])
            train = train.add(name, friction, flange_a=f"{shaft}.flange_a")
        elif viscous:
            train = train.add(name, Damper(d=viscous), flange_b=f"{shaft}.flange_a")
            train = train.add(f"{name}_ground", Fixed(), flange=f"{name}.flange_a")
    if drive is not None:
        train = train.add("drive", Torque(drive), flange="motor.flange_a")
    return replace(train, axis=axis)
