"""What a record can show at all: mechanisms that need what it lacks are one and the same in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np

from sim import mechanisms
from sim.description.axis import Axis
from sim.investigation.data.excitation import Excitation, excitation_of, lacking, lacking_at, turns
from sim.investigation.data.plausibility import LEAST_TURN
from sim.investigation.data.preprocessing import LEAST_ROWS, Measurement
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.nominal import has_links
from sim.mechanisms.mechanism import Mechanism, Need

MOTOR = "motor"
HUM_HZ = (50.0, 60.0, 100.0, 120.0)
HIGHEST_HUM = 0.4  # of the sample rate
HALF = 0.5  # of a turn, in which a wave of one per turn goes from end to end: less is a slope or a bend
MOST_ORDERS = 400  # of a ripple: slots times pole pairs of the finest motors
ALONE = 0.5  # the most that a name can have which another fits as well


def needs_of(mechanism: str) -> frozenset[Need]:
    """What a mechanism needs; of one without a name nothing."""
    kind = mechanisms.MECHANISMS.get(mechanism)
    return frozenset() if kind is None else kind.needs


def that_show(axis: Axis, m: Measurement, terms: Iterable[Term]) -> list[Term]:
    """`terms` that a record can show; of those that are the same in it the first alone."""
    missing, e = lacking(m), excitation_of(m)
    out: list[Term] = []
    for term in terms:
        lacks = needs_of(term.mechanism) & missing
        kind = mechanisms.MECHANISMS.get(term.mechanism)
        if kind is not None and kind.shown_by & missing_at(axis, e, term.location):
            continue
        if not any(lacks & needs_of(other.mechanism) for other in out):
            out.append(term)
    return out


def missing_at(axis: Axis, e: Excitation, location: str | None) -> frozenset[Need]:
    """What a record does not have for what is at a location."""
    lacks = {
        Need.HALF_TURN: turns(axis, e.travel_rad, location) <= HALF,
        Need.LOAD_TURN: e.travel_rad <= LEAST_TURN * axis.ratio,
        Need.LOAD_ENCODER: not e.at_load,
        Need.TWO_ROWS_PER_TOOTH: passed_slowly(axis, e, location) < LEAST_ROWS,
        Need.TWO_ROWS_PER_PERIOD: min(HUM_HZ) >= HIGHEST_HUM * e.rate_hz,
    }
    return lacking_at(e.speed) | {need for need, is_lacking in lacks.items() if is_lacking}


def passing_hz(axis: Axis, location: str | None) -> float:
    """Teeth of the wheel at a location that pass per second while the motor turns by 1 rad/s; 0 of unknown teeth.

    Of a tooth that is damaged, and of an error that all have, a row sees something only if two of them come while one
    tooth passes (Nyquist and Shannon): else it is the same as something slower.
    """
    if location is None or not (teeth := _teeth(axis).get(location)):
        return 0.0
    return teeth * axis.ratio_from(location) / axis.ratio / (2.0 * math.pi)


def passed_slowly(axis: Axis, e: Excitation, location: str | None) -> int:
    """Rows in motion in which the teeth of a wheel pass at less than half the rate."""
    return int((passing_hz(axis, location) * np.abs(e.speed) < 0.5 * e.rate_hz).sum())


def highest_order(e: Excitation) -> int:
    """Times per turn of the motor up to which a ripple goes at less than half the rate, at the usual speed."""
    pace = float(np.median(np.abs(e.speed))) if e.speed.size else 0.0
    return min(int(math.pi * e.rate_hz / pace), MOST_ORDERS) if pace else 0


def lowest_order(e: Excitation, *, doubted: bool) -> int:
    """Times per turn of the motor from which a ripple is passed once, or twice where the load's torque is `doubted`:
    masses that are wrong bend it once over any way."""
    waves = 2.0 if doubted else 1.0
    return math.ceil(waves * 2.0 * math.pi / e.travel_rad) if e.travel_rad else MOST_ORDERS + 1


def _teeth(axis: Axis) -> Mapping[str, int | None]:
    """Teeth of each wheel by its name, of the driven gears and of the motor's pinion."""
    first = {MOTOR: axis.stages[0].driver_teeth} if axis.stages else {}
    return {**first, **{stage.name: stage.driven_teeth for stage in axis.stages}}


@dataclass(frozen=True)
class Shown:
    """What a record can show of an axis; what such an axis cannot have is in neither.

    Args:
        found: mechanisms that can be found, each with the places where it can, or none where that is everywhere.
        hidden: by what is lacking those that cannot, each with its places, or none where that is everywhere.
    """

    found: Mapping[str, Sequence[str]]
    hidden: Mapping[Need, Mapping[str, Sequence[str]]]


def shown(axis: Axis, e: Excitation) -> Shown:
    """Return what a record can show, before it is looked for."""
    found: dict[str, Sequence[str]] = {}
    hidden: dict[Need, dict[str, Sequence[str]]] = {need: {} for need in Need}
    for name, kind in mechanisms.MECHANISMS.items():
        lacks = {
            place: kind.shown_by & missing_at(axis, e, place)
            for place in kind.locations(axis)
            if _can_be(axis, kind, place)
        }
        seen = [place for place, missing in lacks.items() if not missing]
        if seen:
            found[name] = [place for place in seen if place] if len(seen) < len(lacks) else []
        for place, missing in lacks.items():
            for need in sorted(missing, key=list(Need).index)[:1]:
                hidden[need][name] = [*hidden[need].get(name, ()), *([place] if place and seen else [])]
    return Shown(found, {need: those for need, those in hidden.items() if those})


def _can_be(axis: Axis, kind: type[Mechanism], place: str | None) -> bool:
    """Whether it is looked for there by telemetry: of teeth whose number is known, of springs that are there."""
    if place in kind.traits.unseen_at or (kind.sound and kind.sound.absent):
        return False
    if kind.traits.dent or kind.signature.order == "mesh":
        return bool(_teeth(axis).get(place or ""))
    if kind.traits.of_unknown_teeth and _teeth(axis).get(place or ""):
        return False
    return has_links(axis) or not kind.traits.of_links


def same_over_the_turn(axis: Axis, m: Measurement, mechanism: str, order: float | None) -> tuple[str, ...]:
    """What has the same torque over the angle: once per turn of one stiff body an unbalanced mass and a ripple.

    `order`: of one that may have any. Within less than a turn none of so low an order is looked for; behind a gear a
    weight has another angle.
    """
    if has_links(axis) or m.gear != 1.0 or float(np.ptp(m.angle)) < 2.0 * math.pi:
        return ()
    kind = mechanisms.MECHANISMS.get(mechanism)
    if kind is None or not kind.traits.torque_over_angle:
        return ()
    own = order if isinstance(kind.signature.order, str) else kind.signature.order
    others = (other for other in mechanisms.MECHANISMS.values() if other.traits.torque_over_angle and other is not kind)
    return tuple(
        other.name for other in others if other.signature.order == own or isinstance(other.signature.order, str)
    )


def the_same(mechanism: str, missing: frozenset[Need]) -> tuple[str, ...]:
    """Mechanisms that a record without `missing` cannot tell from this one, of each want in turn.

    What repeats with an angle also repeats in time where there is one speed.
    """
    lacks = sorted(needs_of(mechanism) & missing, key=list(Need).index)
    classes: Sequence[list[str]] = [
        [name for name, kind in mechanisms.MECHANISMS.items() if need in kind.needs and name != mechanism]
        for need in lacks
    ]
    kind = mechanisms.MECHANISMS.get(mechanism)
    steady = Need.SEVERAL_SPEEDS in missing and kind and kind.traits.torque_over_angle
    in_time = [name for name, other in mechanisms.MECHANISMS.items() if other.traits.of_the_recording and steady
               and other.signature.domain == "frequency"]  # fmt: skip
    return tuple(dict.fromkeys(name for row in zip_longest(*classes, in_time) for name in row if name))
