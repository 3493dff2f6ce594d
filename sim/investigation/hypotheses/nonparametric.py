"""Structure that has no name, as terms that compete with the mechanisms: friction over speed or angle, one frequency.

Where such a term explains clearly more than any mechanism, none of them is the cause; beside a mechanism it takes what
would otherwise be blamed on a second one. Their shapes are the generic basis of friction that depends on the state,
additive at the motor and, with a load encoder, at the load: no simulation is needed. Beside them stands what is as new
and always fitted nowhere else: torque over the angle of the load, and errors of teeth, which are simulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.chain.model import Array, Chain, with_link
from sim.description.axis import Axis
from sim.description.transmission import compliance
from sim.investigation.data.excitation import beyond_twice, orders_beyond_twice
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.hypotheses.hypothesis import (
    AS_NEW,
    ERROR_OVER_ANGLE,
    FIXED,
    OVER_ANGLE,
    OVER_SPEED,
    OVER_SPEED_AT_LOAD,
    Term,
)
from sim.investigation.model.nominal import LOAD_CURVE, PARTS, wave
from sim.investigation.model.parameters import Owner, Parameter, Values

Rows = NDArray[np.bool_]
CURVES = (OVER_SPEED, OVER_ANGLE)
KNOTS = 8  # of the friction curve, per direction
ORDERS = (1, 2, 3)  # of friction over the angle of the load
EVEN = "even."  # in the names of a curve that is the same in both directions
TWICE_OVER_ONCE = 0.5  # of a gear as new: its error per half a tooth over that per tooth
TURN_SHARE = 0.02  # of the largest speed: there friction turns its sign


def apart(term: Term, m: Measurement) -> Term:
    """A curve over the speed without what friction of either direction is, whose numbers it would share."""
    assert term.location is not None  # at the motor or at the load
    even = EVEN in term.parameters[0].name
    return over_speed(term.location, m, term.parameters[0].step, even=even, apart=True)


def over_speed(place: str, m: Measurement, step: float, *, even: bool = False, apart: bool = False) -> Term:
    """A curve of straight pieces over the speed, one for each direction, beyond dry and viscous friction.

    Tents that stand on the knots in between and are 0 at both ends: a straight line is none of them, but all together
    are nearly dry friction. `even`: the same curve in both directions; `apart`: orthogonal to both frictions, over the
    rows that count.
    """
    top = float(np.abs(m.speed).max())
    knots = np.linspace(0.0, top, KNOTS)[1:-1]
    tents = np.maximum(0.0, 1.0 - np.abs(np.abs(m.speed)[:, None] - knots) * (KNOTS - 1) / top)
    turned = _turned(m)[:, None]
    ways = np.maximum(turned, 0.0), np.minimum(turned, 0.0)
    shapes = tents * turned if even else np.concatenate([tents * way for way in ways], axis=1)
    if apart:
        friction = np.hstack([*ways, np.abs(m.speed)[:, None] * ways[0], np.abs(m.speed)[:, None] * ways[1]])
        shapes = _beyond(shapes, friction, m)

    def where(energy: Array) -> Mapping[str, float]:
        at = int(np.argmax(energy))
        speed = {"speed_rad_s": float(knots[at % knots.size])}
        return speed if even else {**speed, "direction": 1.0 if at < knots.size else -1.0}

    curve = _shaped(OVER_SPEED, place, shapes, step, where, EVEN if even else "")
    return replace(curve, least_share=OVER_SPEED_AT_LOAD) if place == "load" else curve


def over_angle(place: str, m: Measurement, ratio: float, step: float, order: int) -> Term:
    """Dry and viscous friction whose size is a wave over the angle of the load, which turns half of each at least."""
    waves = _waves(m, ratio, (order,))
    viscous = m.speed / float(np.abs(m.speed).max())
    shapes = np.concatenate([waves * _turned(m)[:, None], waves * viscous[:, None]], axis=1)
    return _shaped(OVER_ANGLE, place, shapes, step, lambda energy: {"order": float(order)}, f"{order}.")


def torque_over_angle(place: str, m: Measurement, ratio: float, step: float) -> Term:
    """The same in both directions, beyond offset and weight: errors as new, which must not pass for friction.

    Over less than a turn waves of any order would stand for a weight.
    """
    weight = np.hstack([np.ones((m.samples, 1)), _waves(m, ratio, ORDERS[:1])])
    return _shaped(AS_NEW, place, _beyond(_waves(m, ratio, ORDERS[1:]), weight, m), step, lambda energy: {})


def error_over_angle(axis: Axis, m: Measurement) -> list[Term]:
    """What both encoders differ by at the same angle of the load, whatever the torque: of a gear or of an encoder.

    Where the description says nothing of what the last gear and the load's encoder err by; what it says is in every
    model. A series over the angle, taken off what the load's encoder tells: of a whole turn what repeats three times in
    it and more, as once and twice have names; of less any curve. Its numbers are those of the way of this record. No
    wave of it is larger than what the encoders differ by altogether, nor steeper than that once: a gear has no corners.
    """
    if (
        m.slow_load_angle is None
        or axis.load_encoder.error_rad
        or (axis.stages and axis.stages[-1].transmission_error_rad)
    ):
        return []
    seen = 0.5 * float(np.ptp((m.slow_angle / axis.ratio - m.slow_load_angle)[m.load_valid > 0.5]))
    shapes, _ = beyond_twice(m.slow_load_angle)
    step = 3e-3 * m.torque_rms * axis.ratio * compliance(axis)
    numbers = tuple(
        Parameter(LOAD_CURVE.format(k), 0.0, step, seen / float(order), unit="rad", owner=Owner.MOTION)
        for k, order in enumerate(orders_beyond_twice(m.slow_load_angle))
    )

    def report(values: Values) -> dict[str, float]:
        """Half of what it is from peak to peak."""
        return {"error_rad": 0.5 * float(np.ptp(np.array([values[p.name] for p in numbers]) @ shapes))}

    probes = (tuple({p.name: step} for p in numbers),)
    return [Term(ERROR_OVER_ANGLE, "load", numbers, probes, report, named=False, magnitude=lambda values: math.inf)]


def half_teeth(axis: Axis) -> list[Term]:
    """Errors of gears as new twice per tooth, which the description's own model has once per tooth only."""
    return [
        _half_teeth(k, stage.name, float(2 * stage.driven_teeth), TWICE_OVER_ONCE * stage.transmission_error_rad)
        for k, stage in enumerate(axis.stages)
        if stage.driven_teeth and stage.transmission_error_rad
    ]


def _half_teeth(k: int, stage: str, order: float, new_rad: float) -> Term:
    names = [f"{AS_NEW}@{stage}.{part}_rad" for part in PARTS]

    def apply(chain: Chain, values: Values) -> Chain:
        error = wave(k + 1, order, *(values[name] for name in names))
        return with_link(chain, k, errors=chain.links[k].errors + error)

    step = 0.3 * new_rad
    numbers = tuple(Parameter(name, 0.0, step, new_rad, -3.0 * new_rad, 3.0 * new_rad, unit="rad") for name in names)
    return Term(
        AS_NEW, stage, numbers, (tuple({name: step} for name in names),), lambda values: {}, apply,
        named=False, magnitude=lambda values: math.inf,
    )  # fmt: skip


def _beyond(shapes: Array, others: Array, m: Measurement) -> Array:
    """`shapes` without what `others` are of them in the rows that count, all of shape (n, k)."""
    counts = np.sqrt(m.moving)[:, None]
    return np.asarray(shapes - others @ np.linalg.lstsq(others * counts, shapes * counts, rcond=None)[0])


def _waves(m: Measurement, ratio: float, orders: Sequence[int]) -> Array:
    angle = m.angle / ratio
    return np.stack([wave(order * angle) for order in orders for wave in (np.cos, np.sin)], axis=1)


def sine(place: str, m: Measurement, frequency: float, step: float) -> Term:
    turn = 2.0 * math.pi * frequency * m.time_s
    shapes = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    return _shaped(FIXED, place, shapes, step, lambda energy: {"frequency_hz": frequency})


def _turned(m: Measurement) -> Array:
    """Sign of the speed, smooth."""
    return np.asarray(np.tanh(m.speed / (TURN_SHARE * float(np.abs(m.speed).max()))))


def _shaped(
    kind: str, place: str, shapes: Array, step: float, where: Callable[[Array], Mapping[str, float]], of: str = ""
) -> Term:
    """Free amplitudes of `shapes` (n, k) in torque; `where` says from the energy of each shape where it acts.

    `of`: tells the numbers of one such term at a place from those of another.
    """
    names = [f"{kind}@{place}.{of}{k}" for k in range(shapes.shape[1])]

    def amplitudes(values: Values) -> Array:
        return np.array([values[name] for name in names])

    def torque(m: Measurement, values: Values) -> Array:
        return np.asarray(shapes @ amplitudes(values))

    def report(values: Values) -> Mapping[str, float]:
        return where(np.sum((shapes * amplitudes(values)) ** 2, axis=0))

    return Term(
        kind, place, tuple(Parameter(name, 0.0, step, unit="N m") for name in names),
        (tuple({name: step} for name in names),), report,
        torque=torque if place == "motor" else None, load_torque=torque if place == "load" else None,
        named=False, magnitude=lambda values: math.inf,
    )  # fmt: skip
