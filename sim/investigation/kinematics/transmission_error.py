"""Transmission error: what motor angle over ratio and load angle differ by, in steady motion, with no torque known.

It repeats with the angle (runout, teeth, encoders), turns with the direction of motion (lost motion) and grows with the
speed (a late channel, viscous friction that winds the gear up): one least squares tells these apart as far as the
motion does. What is uncertain in it is told by leaving out each of 20 pieces of the record in turn (block jackknife),
since its noise is not white.

Source: VDI/VDE 2608 for the error over the angle; ISO 230-2 for the reversal error at equal angles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

from sim.description.axis import Axis
from sim.investigation.data.excitation import ERROR_ORDERS, is_whole, lacking_at, over_the_way
from sim.investigation.data.preprocessing import LEAST_ROWS, STANDSTILL_SHARE, Measurement, standstill_weight
from sim.mechanisms import Eccentricity, EncoderError, MeshError
from sim.mechanisms.catalogue import mechanism_of
from sim.mechanisms.mechanism import Need

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

BLOCKS = 20
TURNS_OF_SLOPE = 2.0  # from which a wrong ratio cannot be an error once per turn
STEADY = 0.1  # of the largest acceleration: what is left of it does not lift teeth off each other where friction holds
CHANCE = 1e-3  # that noise alone is taken for something, per record and effect
INSIDE = 0.05  # beyond either end of a 90 % interval
OFFSET, REVERSAL, LAG, SLOPE = "offset", "reversal", "lag", "slope"


@dataclass(frozen=True)
class Amplitude:
    """A size with its standard error and its 90 % interval."""

    value: float
    error: float
    low: float
    high: float

    def __neg__(self) -> Amplitude:
        return Amplitude(-self.value, self.error, -self.high, -self.low)


@dataclass(frozen=True)
class TransmissionError:
    """Rows in steady motion, each array of shape (n,): angle of the load, error [rad], direction, speed [rad/s].

    `orders`: what is looked for per turn of the load; where it made no `whole` one, of a series of cosines over half a
    period, which is complete over the way that was passed and says nothing of a turn.
    """

    angle: Array
    error: Array
    direction: Array
    speed: Array
    orders: tuple[int, ...]
    lacks: frozenset[Need]
    whole: bool

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Regressors by name, each of shape (n,)."""
        out = {OFFSET: np.ones(self.error.size)}
        if Need.BOTH_DIRECTIONS not in self.lacks:
            out[REVERSAL] = 0.5 * self.direction
        if Need.SEVERAL_SPEEDS not in self.lacks:
            out[LAG] = self.speed
        if float(np.ptp(self.angle)) > TURNS_OF_SLOPE * 2.0 * math.pi:
            out[SLOPE] = self.angle - float(self.angle.mean())
        for order in self.orders:
            if self.whole:
                out[cosine(order)], out[sine(order)] = np.cos(order * self.angle), np.sin(order * self.angle)
            else:
                out[cosine(order)] = over_the_way(self.angle, order)
        return out

    @cached_property
    def fit(self) -> Fit:
        """All regressors at once."""
        return self.fitted(tuple(self.columns))

    def fitted(self, names: Sequence[str]) -> Fit:
        """Least squares by the columns of these names."""
        return Fit.of(tuple(names), np.stack([self.columns[name] for name in names], axis=1), self.error)

    def left_by(self, fit: Fit) -> Array:
        """What a fit leaves of the error, shape (n,) [rad]."""
        return self.error - np.stack([self.columns[name] for name in fit.names], axis=1) @ fit.values

    def lost_motion(self) -> Amplitude | None:
        """By how much the load is behind more in one direction than in the other at the same angle [rad]."""
        if REVERSAL not in self.columns:
            return None
        return self.fit.amplitude((REVERSAL,))

    def amplitude(self, order: int) -> Amplitude:
        """Of what comes back `order` times per turn of the load [rad]."""
        return self.fit.amplitude((cosine(order), sine(order)))

    def phase(self, order: int) -> float:
        """`phase` of amplitude sin(order angle + phase) [rad]."""
        return math.atan2(self.fit.value(cosine(order)), self.fit.value(sine(order)))

    def repeatable(self) -> float:
        """Peak to peak of what repeats with the angle, over the angles that were passed [rad]."""
        names = [name for order in self.orders for name in (cosine(order), sine(order)) if name in self.columns]
        curve = sum((self.fit.value(name) * self.columns[name] for name in names), np.zeros(self.error.size))
        return float(np.ptp(curve))


@dataclass(frozen=True)
class Fit:
    """Least squares of several columns; `replicates`, shape (blocks, p): without each piece of the record in turn."""

    names: tuple[str, ...]
    values: Array
    replicates: Array
    held_out: Array

    @staticmethod
    def of(names: tuple[str, ...], columns: Array, target: Array) -> Fit:
        """`columns`, shape (n, p), and `target`, shape (n,), in the order of time."""
        scale = np.sqrt(np.mean(columns**2, axis=0))
        scaled = columns / np.where(scale > 0.0, scale, 1.0)
        edges = np.linspace(0, target.size, BLOCKS + 1).astype(int)
        pieces = [slice(a, b) for a, b in pairwise(edges.tolist())]
        grams = np.stack([scaled[rows].T @ scaled[rows] for rows in pieces])
        sums = np.stack([scaled[rows].T @ target[rows] for rows in pieces])
        gram, total = grams.sum(axis=0), sums.sum(axis=0)
        values = _solved(gram, total)
        replicates = np.stack([_solved(gram - one, total - part) for one, part in zip(grams, sums, strict=True)])
        held_out = np.concatenate(
            [target[rows] - scaled[rows] @ without for rows, without in zip(pieces, replicates, strict=True)]
        )
        return Fit(names, values / scale, replicates / scale, held_out)

    def value(self, name: str) -> float:
        """Coefficient of a column."""
        return float(self.values[self.names.index(name)])

    def amplitude(self, names: Sequence[str]) -> Amplitude:
        """Length of the vector of these coefficients, signed where it is one, with its 90 % interval."""
        at = [self.names.index(name) for name in names]
        spread = np.sqrt((BLOCKS - 1) / BLOCKS * ((self.replicates - self.replicates.mean(axis=0))[:, at] ** 2).sum(0))
        value = float(self.values[at[0]]) if len(at) == 1 else float(np.linalg.norm(self.values[at]))
        error = float(np.sqrt(np.mean(spread**2)))
        reach = float(t_distribution.isf(INSIDE, BLOCKS - 1)) * error
        return Amplitude(value, error, value - reach, value + reach)


def is_larger_than(size: Amplitude, limit: float, parts: int) -> bool:
    """Whether noise alone makes a size so far beyond `limit` less often than `CHANCE`; `parts`: 2 of a sine, else 1."""
    squares = float(f_distribution.isf(CHANCE if parts > 1 else 2.0 * CHANCE, parts, BLOCKS - 1))
    return size.value - limit > math.sqrt(parts * squares) * size.error


def cosine(order: int) -> str:
    """Name of a column."""
    return f"cos {order}"


def sine(order: int) -> str:
    """Name of a column."""
    return f"sin {order}"


def transmission_error(axis: Axis, m: Measurement) -> TransmissionError | None:
    """Of a measurement whose motor angle is told at the motor; None where too little of it is steady motion."""
    if m.load_angle is None:
        return None
    driven = m.angle / axis.ratio
    error = driven - m.load_angle - _known(axis, m.load_angle)
    used, direction = _steady(m, driven, float(np.ptp(error)))
    if int(used.sum()) < LEAST_ROWS:
        return None
    angle = m.load_angle[used]
    speed = m.slow_speed[used] / axis.ratio
    whole = is_whole(angle)
    teeth = _of_teeth(axis, m, float(np.abs(speed).max())) if whole else ()
    orders = (*range(1, (ERROR_ORDERS if whole else 2 * ERROR_ORDERS) + 1), *teeth)
    return TransmissionError(angle, error[used], direction[used], speed, orders, lacking_at(speed), whole)


def _known(axis: Axis, angle: Array) -> Array:
    """Errors at the output that the description has as mechanisms, at angles of the load, shape (n,) [rad]."""
    out = np.zeros(angle.size)
    last = axis.stages[-1] if axis.stages else None
    orders = {EncoderError.name: 1, Eccentricity.name: 1, MeshError.name: (last.driven_teeth if last else None) or 0}
    for entry in axis.mechanisms:
        if entry.name not in orders:
            continue
        known = mechanism_of(entry)
        if known.placed(axis) in ("load", last.name if last else ""):
            sign = -1.0 if entry.name == EncoderError.name else 1.0
            out += sign * known["amplitude_rad"] * np.sin(orders[entry.name] * angle + known["phase_rad"])
    return out


def _of_teeth(axis: Axis, m: Measurement, fastest: float) -> tuple[int, ...]:
    """Teeth of the last gear, where they pass slower than what was smoothed away."""
    teeth = (axis.stages[-1].driven_teeth if axis.stages else None) or 0
    slow = teeth * fastest / (2.0 * math.pi) < 0.1 * m.rate_hz
    return (teeth,) if teeth > ERROR_ORDERS and slow else ()


def _steady(m: Measurement, driven: Array, reach: float) -> tuple[Rows, Array]:
    """Rows in steady motion, further than `reach` from where it turns, and the direction of all; shape (n,).

    No gap is wider than the range of the error, so that further from a reversal the teeth are on their flank.
    """
    moving = (standstill_weight(m.slow_speed, STANDSTILL_SHARE) > 0.5) & (m.valid > 0.5) & (m.load_valid > 0.5)
    if not moving.any():
        return moving, np.zeros(driven.size)
    rows = np.flatnonzero(moving)
    last = rows[np.clip(np.searchsorted(rows, np.arange(driven.size), side="right") - 1, 0, None)]
    direction = np.sign(m.slow_speed)[last]
    turns = np.flatnonzero(np.diff(direction) != 0.0) + 1
    ends = np.concatenate([[0], turns, [driven.size - 1]])
    stroke = np.searchsorted(turns, np.arange(driven.size), side="right")
    begin, end = driven[ends[stroke]], driven[ends[stroke + 1]]
    longest = float(np.abs(np.diff(driven[ends])).max())
    away = min(reach, 0.25 * longest)
    far = (np.abs(driven - begin) > away) & (np.abs(driven - end) > away)
    largest = float(np.quantile(np.abs(m.slow_acceleration[moving]), 0.99))
    return moving & far & (np.abs(m.slow_acceleration) <= STEADY * largest), np.asarray(direction)


def _solved(gram: Array, total: Array) -> Array:
    return np.asarray(np.linalg.lstsq(gram, total, rcond=1e-12)[0])
