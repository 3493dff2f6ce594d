"""Measurements that could be made next: how the motor would move, what would be read, and what it takes to do so."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline

from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.excitation import WHOLE
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.model.nominal import has_links

DURATION_S = 10.0
LEVELS = (0.05, 0.15, 0.35, 0.65, 1.0)  # of the top speed, at which a law of friction shows
STROKE_S = 1.2  # at one even speed, at most
SLOW = 1.0 / 3.0
FASTER = 1.2  # times as fast, or as far: less is the same motion
SHORT = 1.0 / 8.0  # of the travel
RAMPS_S = (0.1, 0.6)  # within which speeds are reached, by the largest acceleration of the present motion


@dataclass(frozen=True)
class Present:
    """The motion that was measured, all of the motor."""

    axis: Axis
    measurement: Measurement

    @property
    def rate_hz(self) -> float:
        return self.measurement.rate_hz

    @property
    def angle(self) -> Array:
        """[rad], shape (n,)."""
        return self.measurement.slow_angle

    @property
    def seconds(self) -> float:
        """How long the next recording is to be: as long as this one."""
        return max(DURATION_S, self.measurement.samples / self.rate_hz)

    @property
    def rows(self) -> int:
        """Of a new measurement that are simulated: what it tells grows with its length."""
        return int(DURATION_S * self.rate_hz)

    @cached_property
    def travel(self) -> float:
        return float(np.ptp(self.angle))

    @cached_property
    def top(self) -> float:
        return float(np.quantile(np.abs(self.measurement.slow_speed), 0.99))

    @property
    def ramp_s(self) -> float:
        """Time to reach the top speed."""
        acceleration = float(np.quantile(np.abs(self.measurement.slow_acceleration), 0.99))
        return float(np.clip(0.5 * math.pi * self.top / max(acceleration, 1e-9), *RAMPS_S))

    @property
    def one_way(self) -> bool:
        return abs(float(self.angle[-1] - self.angle[0])) > WHOLE * self.travel

    def moves(self, angle: Array) -> bool:
        """Whether a motion has any row that would count: one that begins with a rest may end before it moves."""
        fastest = float(np.abs(np.diff(angle)).max(initial=0.0)) * self.rate_hz
        return fastest > self.measurement.standstill * self.top

    @property
    def can_turn(self) -> bool:
        """Whether more than what has been seen of a turn of the load is left to see."""
        return bool(self.axis.stages) and self.travel / self.axis.ratio < WHOLE * 2.0 * math.pi


Motion = Callable[[Present], Array | None]  # angle of the motor [rad] over its rows; None: not on this axis


@dataclass(frozen=True)
class Plan:
    """One measurement: what to do, in words with places for numbers; the motion; what it takes, 1 being a repeat.

    `load_encoder`: one is added to an axis that has none; `payload`: times the inertia of the load.
    """

    text: str
    effort: float
    motion: Motion
    load_encoder: bool = False
    payload: float = 1.0

    def applies(self, present: Present) -> bool:
        """Whether the axis is one on which this is something new."""
        if self.load_encoder:
            return has_links(present.axis) and present.measurement.load_angle is None
        return self.payload == 1.0 or has_links(present.axis)

    def says(self, present: Present, angle: Array) -> str:
        """What to do, with the numbers of the motion `angle`."""
        speed = float(np.quantile(np.abs(np.diff(angle)), 0.99)) * present.rate_hz / present.axis.ratio
        travel = float(np.ptp(angle)) / present.axis.ratio
        text = self.text.format(speed=f"{speed:.2g} rad/s", travel=f"{travel:.2g} rad")
        return f"{text}, for {present.seconds:.0f} s"


def repeated(present: Present) -> Array:
    return present.angle[: present.rows]


def slowed(present: Present) -> Array:
    return _in_time(present, SLOW)


def hurried(present: Present) -> Array | None:
    """As fast as the description lets the motor turn, where it says so."""
    factor = present.axis.motor.speed_limit_rad_s / present.top
    return _in_time(present, factor) if FASTER < factor < math.inf else None


def there_and_back(present: Present) -> Array | None:
    """The same motion and then the other way round, where it went one way only."""
    there = repeated(present)[: present.rows // 2]
    gone = np.diff(there, append=2.0 * there[-1] - there[-2])
    speed = np.concatenate([gone, -gone]) * present.rate_hz
    return _moved(present, speed, float(there[0])) if present.one_way else None


def even_speeds(present: Present) -> Array:
    """Strokes there and back at each of the levels."""
    speed = np.zeros(present.rows)
    for part, level in zip(np.array_split(np.arange(present.rows), len(LEVELS)), LEVELS, strict=True):
        stroke = min(STROKE_S, present.travel / (level * present.top), 0.5 * part.size / present.rate_hz)
        speed[part] = level * present.top * _to_and_fro(part.size, stroke * present.rate_hz)
    return _moved(present, speed, float(present.angle.min()))


def full_turn(present: Present) -> Array | None:
    """Slowly through a turn of the load and back, around the middle of what was seen."""
    if not present.can_turn:
        return None
    half = 0.5 * DURATION_S
    speed = min(present.top, 2.0 * math.pi * present.axis.ratio / (half - RAMPS_S[1]))
    if speed * half < FASTER * present.travel:
        return None
    middle = 0.5 * float(present.angle.min() + present.angle.max())
    return _moved(present, speed * _to_and_fro(present.rows, half * present.rate_hz), middle - 0.5 * speed * half)


def short_half_cycles(present: Present) -> Array:
    """To and fro over a part of the travel, as fast as the ramps of the present motion let it."""
    period_s = max(4.0 * present.ramp_s, math.pi * SHORT * present.travel / present.top)
    wave = 1.0 - np.cos(2.0 * math.pi * np.arange(present.rows) / (period_s * present.rate_hz))
    middle = 0.5 * float(present.angle.min() + present.angle.max())
    return np.asarray(middle + 0.5 * SHORT * present.travel * (wave - 1.0))


def _in_time(present: Present, factor: float) -> Array:
    """The present motion, `factor` times as fast."""
    whole = present.angle
    count = min(present.rows, int((whole.size - 1) / factor))
    used = whole[: int(count * factor) + 8]
    return np.asarray(make_interp_spline(np.arange(used.size), used, k=5)(factor * np.arange(count)))


def _to_and_fro(rows: int, stroke: float) -> Array:
    """1 and -1 in turn, for `stroke` rows each, shape (rows,)."""
    return 1.0 - 2.0 * (np.floor(np.arange(rows) / max(stroke, 1.0)) % 2.0)


def _moved(present: Present, speed: Array, start: float) -> Array:
    """Angle from `start` on, with speeds that are reached within the ramps of the present motion."""
    window = np.hanning(int(present.ramp_s * present.rate_hz) + 2)
    smooth = np.convolve(speed, window / window.sum(), "same")
    return np.asarray(start + np.cumsum(smooth) / present.rate_hz)


REPEAT = Plan("Repeat the same motion", 1.0, repeated)
PLANS = (
    Plan("Repeat the same motion at a third of its speed, so that the load reaches {speed}", 1.1, slowed),
    Plan("Repeat the same motion at full speed, {speed} of the load", 1.2, hurried),
    Plan("Make the same motion, then the other way round, in one recording", 1.1, there_and_back),
    Plan(
        "Move to and fro at five even speeds, from creeping up to {speed} of the load", 1.2,
        even_speeds,
    ),
    Plan("Turn the load slowly, at {speed}, through {travel} and back, as far as it is free to", 1.5, full_turn),
    Plan("Move the load to and fro in short strokes of {travel} without a rest", 1.2, short_half_cycles),
    Plan("Repeat the same motion with half as much load again, on the axis of rotation", 3.0, repeated, payload=1.5),
    Plan("Add an encoder at the load and repeat the same motion", 5.0, repeated, load_encoder=True),
)  # fmt: skip
