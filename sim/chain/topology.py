"""Finds the shafts in series of a `DriveTrain`: what stands on each, and what joins it to the next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from sim.chain.components import OneFlange, ShaftFriction
from sim.errors import CompositionError
from sim.rotational.component import Component
from sim.rotational.components import (
    BearingFriction,
    ConstantTorque,
    Damper,
    ElastoBacklash,
    Fixed,
    IdealGear,
    Inertia,
    LossyGear,
    SpringDamper,
)
from sim.rotational.components import Torque as TorqueSource
from sim.rotational.drive_train import DriveTrain


@dataclass
class Place:
    """One shaft of the train, and the link that follows it."""

    inertias: list[str] = field(default_factory=list)
    frictions: list[str] = field(default_factory=list)
    torques: list[str] = field(default_factory=list)
    gear: str | None = None
    mesh: str | None = None


def places_of(train: DriveTrain) -> list[Place]:
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
