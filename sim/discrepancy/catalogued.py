"""Terms of mechanisms by what these say of themselves, without a line of their own in any investigation.

In the machine: the chain of the axis' drive train with a mechanism differs in some numbers from the chain without it,
and by as much the fitted chain is changed; so whatever `simulate` can have in shafts in series is looked for. In the
measurement: what distorts the torque channel. Their numbers, ranges and places are those of the mechanism.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from casebase.signals.telemetry import Telemetry
from sim import mechanisms
from sim.axis import Axis, Load
from sim.chain import chain_of
from sim.chain_model import Array, Chain, Dent, Line, Link, Shaft
from sim.discrepancy.entries import rounding
from sim.discrepancy.measurement import Measurement
from sim.discrepancy.parameters import Parameter, Values
from sim.discrepancy.terms import Term
from sim.drive_train import DriveTrain
from sim.errors import SimulationError
from sim.mechanism import Measurement as Distortion
from sim.mechanism import Mechanics, Mechanism
from sim.mechanism import Parameter as Number

Part = TypeVar("Part", Shaft, Link)
TORQUE = "motor_torque_nm"
BESIDE = (  # of what a description has: in the load's own motion, in numbers of the measurement, or seen by the gate
    "structural_resonance", "electrical_hum", "time_delay", "encoder_error", "clipping", "lost_samples",
)  # fmt: skip
ORDERS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 18.0, 24.0)  # pole pairs, slots and their multiples
SHARES = (1.0 / 3.0, 1.0, 3.0)  # of a usual number, where a shape may be
QUARTERS = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
GAPS = tuple(np.geomspace(0.03, 3.0, 9))  # of a usual size, where teeth leave each other
MOST_STARTS = 24
STEP = 0.01  # of a usual number, for sensitivities
WHOLE = ("gap_rad",)  # what is as new is within it
INVERSIONS = 4  # of a distortion of a few percent, each to a few percent of what is left


@dataclass(frozen=True)
class Described:
    """What the mechanisms that a description already has change in the chain, as `simulate` has them.

    `contact`: teeth leave each other by one of them.
    """

    changes: tuple[tuple[Chain, Chain], ...] = ()

    @staticmethod
    def by(axis: Axis) -> Described:
        """Raises SimulationError for one that cannot be had in shafts in series."""
        entries = [e for e in axis.mechanisms if e.name not in BESIDE and issubclass(kind_of(e.name), Mechanics)]
        if not entries:
            return Described()
        train = plain_train(axis)
        before = chain_of(train)
        effects = (Effect(kind_of(e.name), e.location, train, before) for e in entries)  # type: ignore[arg-type]
        return Described(
            tuple((before, effect.chain(e.parameters)) for e, effect in zip(entries, effects, strict=True))
        )

    @property
    def contact(self) -> bool:
        return any(loosens(before, after) for before, after in self.changes)

    def apply(self, chain: Chain) -> Chain:
        for before, after in self.changes:
            chain = carried_over(chain, before, after)
        return chain


def kind_of(name: str) -> type[Mechanism]:
    return mechanisms.MECHANISMS[name]


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
    return DriveTrain.from_axis(axis)


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


def terms_of_catalogue(axis: Axis, m: Measurement, apart: Collection[str]) -> list[Term]:
    """A term for every mechanism, place and start of its shape, but for those that are looked for otherwise."""
    kinds = [kind for name, kind in mechanisms.MECHANISMS.items() if name not in apart]
    return [term for kind in kinds for term in _terms(kind, axis, m)]


def _terms(kind: type[Mechanism], axis: Axis, m: Measurement) -> Iterator[Term]:
    if issubclass(kind, Mechanics):
        train = plain_train(axis)
        for place in kind.locations(axis):
            yield from _mechanics(Effect(kind, place, train, chain_of(train)))
    elif issubclass(kind, Distortion) and kind.locations(axis):
        yield from _distortion(kind, axis, m)


def _mechanics(effect: Effect) -> Iterator[Term]:
    try:
        usual = effect.chain({p.name: p.default for p in effect.kind.parameters})
        carried_over(effect.before, effect.before, usual)
    except SimulationError:
        return  # not in these shafts in series
    contact = loosens(effect.before, usual)
    for shape in _shapes(effect.kind):
        numbers = _Numbers(effect.kind, effect.location, shape)

        def apply(chain: Chain, values: Values, numbers: _Numbers = numbers) -> Chain:
            return carried_over(chain, effect.before, effect.chain(numbers.report(values)))

        yield replace(numbers.term(contact), apply=apply)


def _distortion(kind: type[Distortion], axis: Axis, m: Measurement) -> Iterator[Term]:
    """One that distorts the torque alone: what is read too much is that of the torque that would be read as it was."""
    place = kind.locations(axis)[0]
    told = _told(m)
    usual = kind(place).distort(told, axis).channels
    if any((usual[name] != values).any() for name, values in told.channels.items() if name != TORQUE):
        return  # of a channel that drives the model
    for shape in _shapes(kind):
        numbers = _Numbers(kind, place, shape)

        def torque(m: Measurement, values: Values, numbers: _Numbers = numbers) -> Array:
            return m.torque - undistorted(kind(place, numbers.report(values)), m, axis)

        yield replace(numbers.term(contact=False), torque=torque)


def undistorted(distortion: Distortion, m: Measurement, axis: Axis) -> Array:
    """The torque [N m] that is read as it was measured, shape (n,), by fixed-point iteration."""
    told = _told(m)
    torque = m.torque
    for _ in range(INVERSIONS):
        read = distortion.distort(replace(told, channels={**told.channels, TORQUE: torque}), axis)[TORQUE]
        torque = torque + (m.torque - read)
    return torque


def read_too_much(axis: Axis, m: Measurement) -> Array:
    """What the torque channel reads too much by what is described to distort it [N m], shape (n,)."""
    out = np.zeros(m.samples)
    for entry in axis.mechanisms:
        kind = kind_of(entry.name)
        if entry.name not in BESIDE and issubclass(kind, Distortion):
            out += m.torque - undistorted(kind(entry.location, entry.parameters), m, axis)
    return out


def _told(m: Measurement) -> Telemetry:
    """Channels that a distortion may look at, as they were prepared."""
    seen = {TORQUE: m.torque, "motor_position_rad": m.angle, "motor_speed_rad_s": m.speed}
    if m.load_angle is not None and m.load_speed is not None:
        seen |= {"load_position_rad": m.load_angle, "load_speed_rad_s": m.load_speed}
    return Telemetry(m.time_s, seen)


# --- the numbers of a mechanism as those of a fit -------------------------------------------------------------------


def _shapes(kind: type[Mechanism]) -> list[dict[str, float]]:
    """Where the numbers that are no size may begin: all together, or one at a time where that would be too many."""
    starts = {p.name: _starts(p, kind) for p in kind.parameters if p.name != kind.size}
    if math.prod(len(values) for values in starts.values()) <= MOST_STARTS:
        return [dict(zip(starts, values, strict=True)) for values in itertools.product(*starts.values())]
    usual = {p.name: p.default for p in kind.parameters if p.name != kind.size}
    alone = [{**usual, name: value} for name, values in starts.items() for value in values if value != usual[name]]
    return [usual, *alone]


def _starts(p: Number, kind: type[Mechanism]) -> tuple[float, ...]:
    if p.choices:
        return p.choices
    if p.periodic:
        return QUARTERS
    if kind.signature.order == p.name:
        return tuple(order for order in ORDERS if p.low <= order <= p.high)
    return tuple(sorted({min(max(share * p.default, p.low), p.high) for share in SHARES}))


@dataclass(frozen=True)
class _Numbers:
    """Numbers of a mechanism of which the size and what has a scale are fitted; the others stay as `shape` says."""

    kind: type[Mechanism]
    location: str | None
    shape: Mapping[str, float]

    def _name(self, p: Number) -> str:
        return f"{self.kind.name}@{self.location}.{p.name}"

    def _fitted(self, p: Number) -> bool:
        return p.periodic or not (p.choices or p.default == 0.0 or self.kind.signature.order == p.name)

    def report(self, values: Values) -> dict[str, float]:
        """All numbers, the size first."""
        size, *others = sorted(self.kind.parameters, key=lambda p: p.name != self.kind.size)
        fitted = {p.name: values[self._name(p)] for p in others if self._fitted(p)}
        return {size.name: values[self._name(size)], **self.shape, **fitted}

    def term(self, contact: bool) -> Term:
        size = next(p for p in self.kind.parameters if p.name == self.kind.size)
        usual = abs(size.default) or STEP * size.high
        first = Parameter(self._name(size), 0.0, STEP * usual, low=size.low, high=size.high)
        shape = tuple(self._free(p) for p in self.kind.parameters if p is not size and self._fitted(p))
        jumps = [float(share * usual) for share in GAPS] if contact else [usual]
        return Term(
            self.kind.name, self.location, (first, *shape), tuple(({first.name: jump},) for jump in jumps),
            self.report, positive=size.low >= 0.0, contact=contact,
            nonlinear=contact or any(p.high < math.inf for p in shape),
            shape=tuple(p.name for p in shape),
        )  # fmt: skip

    def _free(self, p: Number) -> Parameter:
        start = self.shape[p.name]
        if p.periodic:
            return Parameter(self._name(p), start, 0.02)
        usual = abs(p.default)
        return Parameter(self._name(p), start, STEP * usual, usual, p.low, p.high, p.default)


# --- the difference of two chains, carried over to a third ----------------------------------------------------------


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
    shafts = tuple(_one_way(_moved(*parts)) for parts in ends)
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
    return (*own, *(_seen(x) for x in now if x not in was))


def _seen(new: Line | Dent) -> Line | Dent:
    """A dent as wide at half depth as the simulator's, in the form that the observer's dents have."""
    return replace(new, half_width_rad=new.half_width_rad / rounding(new.form)) if isinstance(new, Dent) else new


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


def _one_way(shaft: Shaft) -> Shaft:
    """The shaft without what it says twice."""
    same = (shaft.coulomb_backward_n_m, shaft.viscous_backward_n_m_s) == (shaft.coulomb_n_m, shaft.viscous_n_m_s)
    return replace(shaft, coulomb_backward_n_m=None, viscous_backward_n_m_s=None) if same else shaft
