"""What a mechanism changes in the chain of an axis, as `simulate` has it: the difference it makes to its drive train.

The chain of a train with a mechanism differs from that without it in some numbers, lines or dents; by as much a chain
with other numbers is changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from sim.assembly import drive_train_of
from sim.chain.model import Chain, Link, Shaft
from sim.chain.reduction import chain_of
from sim.description.axis import Axis, Load
from sim.errors import SimulationError
from sim.mechanisms.catalogue import kind_of
from sim.mechanisms.mechanism import Mechanics
from sim.rotational.drive_train import DriveTrain

Part = TypeVar("Part", Shaft, Link)
WHOLE = ("gap_rad",)  # what is as new is within it


@dataclass(frozen=True)
class Described:
    """What the mechanisms that a description already has change in the chain, as `simulate` has them.

    `contact`: teeth leave each other by one of them.
    """

    changes: tuple[tuple[Chain, Chain], ...] = ()

    @staticmethod
    def by(axis: Axis) -> Described:
        """Raises SimulationError for one that cannot be had in shafts in series."""
        described = ((e, kind_of(e.name)) for e in axis.mechanisms)
        entries = [
            (e, kind) for e, kind in described if not kind.traits.beside_the_chain and issubclass(kind, Mechanics)
        ]
        if not entries:
            return Described()
        train = plain_train(axis)
        before = chain_of(train)
        return Described(
            tuple((before, Effect(kind, e.location, train, before).chain(e.parameters)) for e, kind in entries)
        )

    @property
    def contact(self) -> bool:
        return any(loosens(before, after) for before, after in self.changes)

    def apply(self, chain: Chain) -> Chain:
        for before, after in self.changes:
            chain = carried_over(chain, before, after)
        return chain


def in_chain(axis: Axis) -> Axis:
    """The description without what it adds beside the chain and the numbers of the measurement: a part of the load that
    swings, and distortions of the torque channel, which a simulation of the chain alone does not have."""
    kinds = ((e, kind_of(e.name)) for e in axis.mechanisms)
    kept = (e for e, kind in kinds if kind.traits.beside_the_chain is not issubclass(kind, Mechanics))
    return replace(axis, mechanisms=tuple(kept))


def plain_train(axis: Axis) -> DriveTrain:
    """The drive train of an axis without its mechanisms; of one that moves as one body with one friction."""
    axis = replace(axis, mechanisms=())
    if not axis.stages and axis.stiffness()[0] is None:
        motor, load = axis.motor, axis.load
        both = replace(
            motor,
            coulomb_friction_n_m=motor.coulomb_friction_n_m + load.coulomb_friction_n_m,
            viscous_friction_n_m_s_per_rad=motor.viscous_friction_n_m_s_per_rad + load.viscous_friction_n_m_s_per_rad,
        )
        axis = replace(axis, motor=both, load=Load(load.inertia_kg_m2))
    return drive_train_of(axis)


@dataclass(frozen=True)
class Effect:
    """One mechanism at one place of a plain train, whose chain is `before`."""

    kind: type[Mechanics]
    location: str | None
    train: DriveTrain
    before: Chain

    def chain(self, numbers: Mapping[str, float]) -> Chain:
        """The chain with it. Raises SimulationError where it cannot be had in shafts in series."""
        return chain_of(self.kind(self.location, numbers).apply(self.train))


def loosens(before: Chain, after: Chain) -> bool:
    """Whether teeth leave each other by what has changed."""
    pairs = zip(before.links, after.links, strict=True)
    return any((was.gap_rad, was.dents) != (now.gap_rad, now.dents) for was, now in pairs)


def carried_over(chain: Chain, before: Chain, after: Chain) -> Chain:
    """`chain` changed by what `after` has beyond `before`: numbers by their differences, lines and dents by new ones.

    Raises
    ------
    SimulationError
        where they are not the same shafts in series.
    """
    if not len(chain.shafts) == len(before.shafts) == len(after.shafts):
        raise SimulationError("a mechanism that adds a shaft has no place in the chain of this axis")
    ends = zip(_both_ways(chain).shafts, before.shafts, after.shafts, strict=True)
    shafts = tuple(one_way(_moved(*parts)) for parts in ends)
    links = tuple(_moved(*parts) for parts in zip(chain.links, before.links, after.links, strict=True))
    return Chain(shafts, links)


def _moved(part: Part, before: Part, after: Part) -> Part:
    """One shaft or link of the three."""
    changes = {
        field.name: getattr(after, field.name)
        if field.name in WHOLE
        else _plus(getattr(part, field.name), getattr(before, field.name), getattr(after, field.name))
        for field in fields(part)
        if getattr(before, field.name) != getattr(after, field.name)
    }
    return replace(part, **changes)


def _plus(own: Any, was: Any, now: Any) -> Any:
    """A number, a pair of numbers, or lines and dents, of which `now` has more than `was`."""
    if not isinstance(own, tuple):
        return own + (now - was)
    if own and isinstance(own[0], float):
        return tuple(x + (b - a) for x, a, b in zip(own, was, now, strict=True))
    return (*own, *(x for x in now if x not in was))


def _both_ways(chain: Chain) -> Chain:
    """The chain with friction backward said as well."""
    shafts = (
        replace(
            s,
            coulomb_backward_n_m=s.coulomb_n_m if s.coulomb_backward_n_m is None else s.coulomb_backward_n_m,
            viscous_backward_n_m_s=s.viscous_n_m_s if s.viscous_backward_n_m_s is None else s.viscous_backward_n_m_s,
        )
        for s in chain.shafts
    )
    return replace(chain, shafts=tuple(shafts))


def one_way(shaft: Shaft) -> Shaft:
    """The shaft without what it says twice."""
    same = (shaft.coulomb_backward_n_m, shaft.viscous_backward_n_m_s) == (shaft.coulomb_n_m, shaft.viscous_n_m_s)
    return replace(shaft, coulomb_backward_n_m=None, viscous_backward_n_m_s=None) if same else shaft
