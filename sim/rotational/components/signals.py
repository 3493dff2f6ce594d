"""Signals that drive sources and clutches: between two breakpoints each is a level plus a sine, or a straight line.

Names and parameters as in Modelica.Blocks.Sources. `pieces` tells the engines the piece that is valid from a time on,
as three numbers: level, swing and rate; the value is level + swing, the swing obeys swing' = rate and
rate' = -omega^2 swing. So a signal is part of the linear system and needs no interpolation.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from sim.errors import ParameterError
from sim.rotational.component import Range, Signal

Array = NDArray[np.float64]
_NONE: Array = np.empty(0)


def _within(times: Array, begin: float, end: float) -> Array:
    return times[(times > begin) & (times < end)]


@dataclass(frozen=True)
class Constant(Signal):
    """y = k."""

    k: float

    ranges: ClassVar[Mapping[str, Range]] = {"k": Range()}

    def breakpoints(self, begin: float, end: float) -> Array:
        return _NONE

    def pieces(self, time_s: Array) -> Array:
        return _rows(time_s, swing=np.full(len(time_s), float(self.k)))


@dataclass(frozen=True)
class Sine(Signal):
    """y = offset + amplitude sin(2 pi f (t - startTime) + phase), just the offset before startTime."""

    amplitude: float
    f: float
    phase: float = 0.0
    offset: float = 0.0
    startTime: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {
        "amplitude": Range(), "f": Range("Hz", above=0), "phase": Range("rad"), "offset": Range(),
        "startTime": Range("s"),
    }  # fmt: skip

    @property
    def omega(self) -> float:
        return 2 * np.pi * self.f

    @property
    def has_level(self) -> bool:
        return self.offset != 0

    def breakpoints(self, begin: float, end: float) -> Array:
        return _within(np.array([self.startTime]), begin, end)

    def pieces(self, time_s: Array) -> Array:
        angle = self.omega * (time_s - self.startTime) + self.phase
        amplitude = np.where(time_s >= self.startTime, self.amplitude, 0.0)
        level = np.full(len(time_s), float(self.offset))
        return _rows(time_s, level, amplitude * np.sin(angle), amplitude * self.omega * np.cos(angle))


@dataclass(frozen=True)
class ExpSine(Sine):
    """y = offset + amplitude exp(-damping (t - startTime)) sin(2 pi f (t - startTime) + phase), the offset before."""

    damping: float = 1.0

    ranges: ClassVar[Mapping[str, Range]] = {**Sine.ranges, "damping": Range("1/s", at_least=0)}

    def pieces(self, time_s: Array) -> Array:
        out = super().pieces(time_s)
        out[:, 2] -= self.damping * out[:, 1]
        out[:, 1:] *= np.exp(-self.damping * np.maximum(time_s - self.startTime, 0.0))[:, None]
        return out


@dataclass(frozen=True)
class Step(Signal):
    """y = offset, from startTime on offset + height."""

    height: float = 1.0
    offset: float = 0.0
    startTime: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {"height": Range(), "offset": Range(), "startTime": Range("s")}

    def breakpoints(self, begin: float, end: float) -> Array:
        return _within(np.array([self.startTime]), begin, end)

    def pieces(self, time_s: Array) -> Array:
        return _rows(time_s, swing=self.offset + np.where(time_s >= self.startTime, self.height, 0.0))


@dataclass(frozen=True)
class Ramp(Signal):
    """y = offset, from startTime on rising by height within duration (0: at once), then constant."""

    height: float
    duration: float
    offset: float = 0.0
    startTime: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {**Step.ranges, "duration": Range("s", at_least=0)}

    def breakpoints(self, begin: float, end: float) -> Array:
        return _within(np.unique([self.startTime, self.startTime + self.duration]), begin, end)

    def pieces(self, time_s: Array) -> Array:
        if self.duration == 0:
            return Step(self.height, self.offset, self.startTime).pieces(time_s)
        slope = self.height / self.duration
        elapsed = np.clip(time_s - self.startTime, 0.0, self.duration)
        rising = (time_s >= self.startTime) & (time_s < self.startTime + self.duration)
        return _rows(time_s, swing=self.offset + slope * elapsed, rate=np.where(rising, slope, 0.0))


@dataclass(frozen=True)
class Pulse(Signal):
    """y = offset, and offset + amplitude during the first `width` percent of each period from startTime on."""

    amplitude: float
    period: float
    width: float = 50.0
    offset: float = 0.0
    startTime: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {
        "amplitude": Range(), "offset": Range(), "startTime": Range("s"), "period": Range("s", above=0),
        "width": Range("%", above=0, at_most=100),
    }  # fmt: skip

    def breakpoints(self, begin: float, end: float) -> Array:
        first = max(0, int((begin - self.startTime) / self.period) - 1)
        count = max(0, int((end - self.startTime) / self.period) + 2 - first)
        starts = self.startTime + self.period * np.arange(first, first + count)
        return _within(np.sort(np.concatenate([starts, starts + self.period * self.width / 100])), begin, end)

    def pieces(self, time_s: Array) -> Array:
        edges = self.breakpoints(self.startTime - 1.0, float(np.max(time_s, initial=0.0)) + self.period)
        on = np.searchsorted(edges, time_s, side="right") % 2 == 1
        return _rows(time_s, swing=self.offset + np.where(on, self.amplitude, 0.0))


@dataclass(frozen=True, eq=False)
class Sampled(Signal):
    """Straight lines through samples at an even rate from startTime on; constant before the first, after the last."""

    values: Array
    sample_rate_hz: float
    startTime: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {"sample_rate_hz": Range("Hz", above=0), "startTime": Range("s")}

    def __post_init__(self) -> None:
        super().__post_init__()
        values = np.array(self.values, dtype=np.float64)
        if values.ndim != 1 or len(values) < 2:
            raise ParameterError(f"Sampled.values: must be one row of 2 or more samples, got shape {values.shape}")
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise ParameterError(f"Sampled.values: must be finite, got {values[bad[0]]} at sample {bad[0]}")
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @cached_property
    def _knots(self) -> Array:
        return self.startTime + np.arange(len(self.values)) / self.sample_rate_hz

    def breakpoints(self, begin: float, end: float) -> Array:
        return _within(self._knots, begin, end)

    def pieces(self, time_s: Array) -> Array:
        knots = self._knots
        i = np.searchsorted(knots, time_s, side="right") - 1
        inside = (i >= 0) & (i < len(knots) - 1)
        slopes = np.diff(self.values) * self.sample_rate_hz
        rate = np.where(inside, slopes[np.clip(i, 0, len(slopes) - 1)], 0.0)
        last = np.clip(i, 0, len(knots) - 1)
        return _rows(time_s, swing=self.values[last] + rate * (time_s - knots[last]), rate=rate)


@dataclass(frozen=True)
class Product(Signal):
    """Product of a signal and one that is constant between its breakpoints (Constant, Step, Pulse)."""

    signal: Signal
    switch: Constant | Step | Pulse

    @property
    def omega(self) -> float:
        return self.signal.omega

    @property
    def damping(self) -> float:
        return self.signal.damping

    @property
    def has_level(self) -> bool:
        return self.signal.has_level

    def breakpoints(self, begin: float, end: float) -> Array:
        both = [self.signal.breakpoints(begin, end), self.switch.breakpoints(begin, end)]
        return np.unique(np.concatenate(both))

    def pieces(self, time_s: Array) -> Array:
        return self.signal.pieces(time_s) * self.switch(time_s)[:, None]


def _rows(time_s: Array, level: Array | None = None, swing: Array | None = None, rate: Array | None = None) -> Array:
    out = np.zeros((len(time_s), 3))
    for column, values in enumerate((level, swing, rate)):
        if values is not None:
            out[:, column] = values
    return out
