"""What a record can show at all: mechanisms that need what it lacks are one and the same in it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import zip_longest

import numpy as np

from sim import mechanisms
from sim.description.axis import Axis
from sim.discrepancy.data.excitation import lacking, turns
from sim.discrepancy.data.preprocessing import Measurement
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.model.nominal import has_links
from sim.mechanisms.mechanism import Need

HALF = 0.5  # of a turn, in which a wave of one per turn goes from end to end: less is a slope or a bend
ALONE = 0.5  # the most that a name can have which another fits as well


def needs_of(mechanism: str) -> frozenset[Need]:
    """What a mechanism needs; of one without a name nothing."""
    kind = mechanisms.MECHANISMS.get(mechanism)
    return frozenset() if kind is None else kind.needs


def that_show(axis: Axis, m: Measurement, terms: Iterable[Term]) -> list[Term]:
    """`terms` that a record can show; of those that are the same in it the first alone."""
    missing = lacking(m)
    out: list[Term] = []
    for term in terms:
        lacks = needs_of(term.mechanism) & missing
        kind = mechanisms.MECHANISMS.get(term.mechanism)
        part = frozenset() if turns(axis, m, term.location) > HALF else frozenset({Need.HALF_TURN})
        if kind is not None and kind.shown_by & (missing | part):
            continue
        if not any(lacks & needs_of(other.mechanism) for other in out):
            out.append(term)
    return out


def same_over_the_turn(axis: Axis, m: Measurement, mechanism: str, order: float | None) -> tuple[str, ...]:
    """What has the same torque over the angle: once per turn of one stiff body an unbalanced mass and a ripple.

    `order`: of one that may have any. Within less than a turn none of so low an order is looked for.
    """
    if has_links(axis) or float(np.ptp(m.angle)) < 2.0 * math.pi:
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
    """Mechanisms that a record without `missing` cannot tell from this one, of each want in turn."""
    lacks = sorted(needs_of(mechanism) & missing, key=list(Need).index)
    classes: Sequence[list[str]] = [
        [name for name, kind in mechanisms.MECHANISMS.items() if need in kind.needs and name != mechanism]
        for need in lacks
    ]
    return tuple(dict.fromkeys(name for row in zip_longest(*classes) for name in row if name))
