"""Where mechanisms act on a drive train that was made from an axis description, and what stands there."""

from __future__ import annotations

from dataclasses import fields, replace

from sim.chain.components import GearMesh, MeshLine, ShaftFriction, Wheel
from sim.chain.reduction import shaft_friction_of
from sim.description.axis import Axis, Stage
from sim.errors import CompositionError, ParameterError
from sim.rotational.components import ElastoBacklash, Inertia
from sim.rotational.drive_train import DriveTrain


def stage_names(axis: Axis) -> tuple[str, ...]:
    """Stages from the output inwards: what is not placed is meant at the output."""
    return tuple(stage.name for stage in reversed(axis.stages))


def wheels(axis: Axis) -> tuple[str, ...]:
    """Driven gears from the output inwards, then the pinion on the motor shaft."""
    return (*stage_names(axis), "motor") if axis.stages else ()


def meshes(axis: Axis) -> tuple[str, ...]:
    """Elastic elements: those of the stages, or the coupling of a direct drive that has one."""
    if axis.stages:
        return stage_names(axis)
    return ("load",) if axis.stiffness()[0] is not None and axis.load.inertia_kg_m2 else ()


def every_shaft(axis: Axis) -> tuple[str, ...]:
    """The motor's shaft, those of the driven gears, the load's."""
    return axis.locations


ENDS = ("motor", "load")
"""The two shafts with bearings of their own that a description knows."""


def axis_of(train: DriveTrain) -> Axis:
    if train.axis is None:
        raise CompositionError(
            "a mechanism needs a drive train made from an axis description (sim.assembly.drive_train_of)"
        )
    return train.axis


def stage_at(axis: Axis, location: str) -> Stage:
    """The stage of a wheel: the one it is the driven gear of, the first one for the motor's pinion."""
    return axis.stages[0] if location == "motor" else next(stage for stage in axis.stages if stage.name == location)


def gear_mesh(train: DriveTrain, location: str) -> tuple[str, GearMesh]:
    """Name and copy of the elastic element that carries the wheel at `location`."""
    axis = axis_of(train)
    name = stage_at(axis, location).name if axis.stages else "coupling"
    part = train[name]
    if isinstance(part, GearMesh):
        return name, part
    if not isinstance(part, ElastoBacklash):
        raise CompositionError(f"{name}: must be an ElastoBacklash to get an effect of its mesh")
    return name, GearMesh(**{item.name: getattr(part, item.name) for item in fields(ElastoBacklash)})


def with_error(
    train: DriveTrain, location: str, order: float, amplitude: float, phase: float, *, wheel: Wheel | None = None
) -> DriveTrain:
    """Add amplitude sin(order theta + phase) of the wheel at `location`, or of another `wheel` of its mesh, to the
    transmission error of its mesh."""
    name, mesh = gear_mesh(train, location)
    line = MeshLine(order, amplitude, phase, wheel or ("driver" if location == "motor" else "driven"))
    return train.replace(name, replace(mesh, errors=(*mesh.errors, line)))


def teeth(axis: Axis, location: str) -> int:
    """Teeth of the wheel at `location`."""
    stage = stage_at(axis, location)
    count = stage.driver_teeth if location == "motor" else stage.driven_teeth
    if count is None:
        raise ParameterError(
            f"stages.{stage.name}: driver_teeth and driven_teeth are needed for an effect of its teeth"
        )
    return count


def shaft_name(train: DriveTrain, location: str) -> str:
    """Name of the inertia that turns at `location`."""
    if location == "motor" or "load" not in train.components:
        return "motor"
    names = [stage.name for stage in axis_of(train).stages]
    inner = location in names and names.index(location) + 1 < len(names)
    return f"{location}_shaft" if inner else "load"


def friction_at(train: DriveTrain, location: str) -> ShaftFriction:
    """Friction of the motor or load shaft so far."""
    name = f"{location}_friction"
    return shaft_friction_of(name, train[name]) if name in train.components else ShaftFriction()


def with_friction(train: DriveTrain, location: str, friction: ShaftFriction) -> DriveTrain:
    """Put another friction in the place of that of the motor or load shaft."""
    for name in (f"{location}_friction", f"{location}_friction_ground"):
        if name in train.components:
            train = train.remove(name)
    return train.add(f"{location}_friction", friction, flange_a=f"{shaft_name(train, location)}.flange_a")


def inertia(train: DriveTrain, name: str) -> Inertia:
    part = train[name]
    if not isinstance(part, Inertia):
        raise CompositionError(f"{name}: must be an Inertia")
    return part


def unused_name(train: DriveTrain, name: str) -> str:
    """The name, or with a number behind it when it is taken."""
    number = 1
    unused = name
    while unused in train.components:
        number += 1
        unused = f"{name}_{number}"
    return unused
