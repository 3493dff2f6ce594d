"""Terms of mechanisms by what these say of themselves, without a line of their own in any investigation.

In the machine: whatever `simulate` can have in shafts in series, as `described` tells what it changes there. In the
measurement: what distorts the torque channel. Their numbers, ranges and places are those of the mechanism.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signals.telemetry import Telemetry
from sim import mechanisms
from sim.chain.model import Array, Chain
from sim.chain.reduction import chain_of
from sim.description.axis import Axis
from sim.errors import SimulationError
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.hypotheses.hypothesis import AS_NEW_FACTOR, Term, amplitude, cosine_and_sine, parameter_key
from sim.investigation.model.known_mechanisms import Effect, carried_over, loosens, plain_train
from sim.investigation.model.parameters import Parameter, Values
from sim.mechanisms.catalogue import kind_of
from sim.mechanisms.mechanism import Measurement as Distortion
from sim.mechanisms.mechanism import Mechanics, Mechanism
from sim.mechanisms.mechanism import Parameter as Number

Shape = Mapping[str, float]
TORQUE = "motor_torque_nm"
ORDERS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 18.0, 24.0)  # pole pairs, slots and their multiples
SHARES = (1.0 / 3.0, 1.0, 3.0)  # of a usual number, where a shape may be
QUARTERS = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
GAPS = tuple(np.geomspace(0.03, 3.0, 9))  # of a usual size, where teeth leave each other
MOST_STARTS = 24
STEP = 0.01  # of a usual number, for sensitivities
INVERSIONS = 4  # of a distortion of a few percent, each to a few percent of what is left


def terms_of_catalogue(axis: Axis, m: Measurement) -> list[Term]:
    """A term for every mechanism, place and start of its shape, but for those that are looked for otherwise."""
    kinds = [kind for kind in mechanisms.MECHANISMS.values() if not kind.traits.own_hypothesis]
    return [term for kind in kinds for term in terms_of_kind(kind, axis, m)]


def terms_of_kind(
    kind: type[Mechanism], axis: Axis, m: Measurement, frequency_hz: float | None = None
) -> Iterator[Term]:
    """Terms of one mechanism; `frequency_hz`: at which one that repeats in time is looked for, else its default."""
    shapes = _shapes(kind, frequency_hz)
    if issubclass(kind, Mechanics):
        train = plain_train(axis)
        for place in kind.locations(axis):
            yield from _mechanics(axis, Effect(kind, place, train, chain_of(train)), shapes, m)
    elif issubclass(kind, Distortion) and kind.locations(axis):
        yield from _distortion(kind, axis, m, shapes)


def frequency_of(kind: type[Mechanism]) -> Number | None:
    """The number that says how often the mechanism repeats in time [Hz]; None where it does not."""
    return next((p for p in kind.parameters if p.unit == "Hz"), None) if kind.signature.domain == "frequency" else None


def _mechanics(axis: Axis, effect: Effect, shapes: Sequence[Shape], m: Measurement) -> Iterator[Term]:
    try:
        usual = effect.chain({p.name: p.default for p in effect.kind.parameters})
        carried_over(effect.before, effect.before, usual)
    except SimulationError:
        return  # not in these shafts in series
    contact = loosens(effect.before, usual)
    for shape in shapes:
        numbers = _Numbers(effect.kind, effect.location, shape, m.samples / m.rate_hz)

        def apply(chain: Chain, values: Values, numbers: _Numbers = numbers) -> Chain:
            return carried_over(chain, effect.before, effect.chain(numbers.report(values)))

        yield replace(numbers.term(axis, contact), apply=apply)


def _distortion(kind: type[Distortion], axis: Axis, m: Measurement, shapes: Sequence[Shape]) -> Iterator[Term]:
    """One that distorts the torque alone: what is read too much is that of the torque that would be read as it was."""
    place = kind.locations(axis)[0]
    told = _distorted_channels(m)
    usual = kind(place).distort(told, axis).channels
    if not all(np.array_equal(usual[name], values) for name, values in told.channels.items() if name != TORQUE):
        return  # of a channel that drives the model
    for shape in shapes:
        numbers = _Numbers(kind, place, shape, m.samples / m.rate_hz)

        def torque(m: Measurement, values: Values, numbers: _Numbers = numbers) -> Array:
            return m.torque - undistorted(kind(place, numbers.report(values)), m, axis)

        yield replace(numbers.term(axis, contact=False), torque=torque)


def undistorted(distortion: Distortion, m: Measurement, axis: Axis) -> Array:
    """The torque [N m] that is read as it was measured, shape (n,), by fixed-point iteration."""
    told = _distorted_channels(m)
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
        if not kind.traits.beside_the_chain and issubclass(kind, Distortion):
            out += m.torque - undistorted(kind(entry.location, entry.parameters), m, axis)
    return out


def _distorted_channels(m: Measurement) -> Telemetry:
    """Channels that a distortion may look at, as they were prepared."""
    seen = {TORQUE: m.torque, "motor_position_rad": m.angle, "motor_speed_rad_s": m.speed}
    if m.load_angle is not None and m.load_speed is not None:
        seen |= {"load_position_rad": m.load_angle, "load_speed_rad_s": m.load_speed}
    return Telemetry(m.time_s, seen)


# --- the numbers of a mechanism as those of a fit -------------------------------------------------------------------


def _phase_of(kind: type[Mechanism]) -> str | None:
    """The phase of the wave of which the mechanism's size is the amplitude; None where it is none.

    Both are then fitted as its sine and cosine, on which what is measured depends nearly in a straight line.
    """
    way = kind.signature
    is_wave = way.domain in ("angle", "frequency") and way.flank == "both" and way.per_cycle is None
    return next((p.name for p in kind.parameters if p.periodic), None) if is_wave else None


def _shapes(kind: type[Mechanism], frequency_hz: float | None) -> list[Shape]:
    """Where the numbers that are no size may begin: all together, or one at a time where that would be too many."""
    often = frequency_of(kind)
    others = [p for p in kind.parameters if p.name not in (kind.size, _phase_of(kind))]
    starts = {p.name: _starts(p, kind) for p in others}
    if often:
        starts[often.name] = (often.default if frequency_hz is None else frequency_hz,)
    if math.prod(len(values) for values in starts.values()) <= MOST_STARTS:
        return [dict(zip(starts, values, strict=True)) for values in itertools.product(*starts.values())]
    usual = {p.name: starts[p.name][0] if p == often else p.default for p in others}
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
    """Numbers of a mechanism of which the size and what has a scale are fitted; the others stay as `shape` says.

    A frequency is fitted within what a record of `duration_s` tells apart.
    """

    kind: type[Mechanism]
    location: str | None
    shape: Shape
    duration_s: float

    def _name(self, p: Number) -> str:
        return parameter_key(self.kind.name, self.location, p.name)

    def _fitted(self, p: Number) -> bool:
        return p.periodic or not (p.choices or p.default == 0.0 or self.kind.signature.order == p.name)

    def _wave(self, step: float, unit: str) -> tuple[Parameter, Parameter]:
        return cosine_and_sine(f"{self.kind.name}@{self.location}", step, unit)

    def report(self, values: Values) -> dict[str, float]:
        """All numbers, the size first."""
        phase = _phase_of(self.kind)
        size, *others = sorted(self.kind.parameters, key=lambda p: p.name != self.kind.size)
        wave = amplitude(self._wave(0.0, size.unit), size.name, phase)(values) if phase else {}
        fitted = {
            p.name: values[self._name(p)]
            for p in (size, *others)
            if p.name not in wave and (p is size or self._fitted(p))
        }
        numbers = {**self.shape, **fitted, **wave}
        return {p.name: numbers[p.name] for p in (size, *others)}

    def term(self, axis: Axis, contact: bool) -> Term:
        phase = _phase_of(self.kind)
        size, *others = sorted(self.kind.parameters, key=lambda p: p.name != self.kind.size)
        usual = abs(size.default) or STEP * size.high
        step = STEP * usual
        alone = Parameter(self._name(size), 0.0, step, low=size.low, high=size.high, unit=size.unit)
        own = self._wave(step, size.unit) if phase else (alone,)
        shape = tuple(self._free(p) for p in others if p.name != phase and self._fitted(p))
        jumps = [float(share * usual) for share in GAPS] if contact else [usual]
        return Term(
            self.kind.name, self.location, (*own, *shape), tuple(tuple({p.name: jump} for p in own) for jump in jumps),
            self.report, positive=not phase and size.low >= 0.0, contact=contact,
            nonlinear=contact or any(p.high < math.inf for p in shape),
            frequency_hz=self.shape[often.name] if (often := frequency_of(self.kind)) else None,
            shape=tuple(p.name for p in shape), size=AS_NEW_FACTOR * self.kind.as_new(axis, self.location),
        )  # fmt: skip

    def _free(self, p: Number) -> Parameter:
        start = self.shape[p.name]
        if p.periodic:
            return Parameter(self._name(p), start, 0.02, unit=p.unit)
        if p == frequency_of(self.kind):
            apart = 1.0 / self.duration_s
            low, high = max(start - apart, p.low), min(start + apart, p.high)
            return Parameter(self._name(p), start, STEP * apart, low=low, high=high, unit=p.unit)
        usual = abs(p.default)
        return Parameter(self._name(p), start, STEP * usual, usual, p.low, p.high, p.default, unit=p.unit)
