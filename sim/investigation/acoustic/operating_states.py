"""The course of the motion behind a recording: reversals, cruising between them, and how fast that is.

Reversals come from telemetry, or are heard (the sound all but vanishes at standstill). The speed of a cruise comes
from telemetry, or from the lines of the meshes, whose orders the axis description gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.condition import OperatingCondition
from signals.motion import HOP_HZ, reversal_times_s
from signals.recording import Recording
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.acoustic.order_spectrum import (
    TRANSFORM,
    Levels,
    OrderSpectra,
    levels_of,
    mesh_orders,
    mesh_speed,
    order_spectra,
    over_surroundings,
)
from sim.investigation.data.preprocessing import Measurement

Mask = NDArray[np.bool_]
MARGIN_S = 0.1  # loudness is full before the speed is
SHORTEST_CRUISE_S = 0.4
LEAST_CRUISES = 3  # strokes, cycles that overlap, standstills, impacts
NO_STANDSTILL = "no standstill is heard"
UNEVEN = 0.02  # of a speed that is heard, while cruising, and of the period of a motion that repeats


@dataclass(frozen=True, eq=False)
class Cruise:
    """A stretch at constant speed: start and end [s], motor speed [1/s].

    `heard`: the speed is that of lines in the sound and not only described.
    """

    start_s: float
    end_s: float
    turns_per_s: float | None = None
    heard: bool = False

    @property
    def length_s(self) -> float:
        """How long it is [s]."""
        return self.end_s - self.start_s

    def cut(self, samples: NDArray[np.float32]) -> Array:
        """Its samples at the analysis rate, shape (n,)."""
        return samples[round(self.start_s * ANALYSIS_RATE_HZ) : round(self.end_s * ANALYSIS_RATE_HZ)].astype(np.float64)


@dataclass(frozen=True, eq=False)
class Course:
    """Recording and motion. `spectra` (cruises, m): power over its surroundings.

    `repeats`: back and forth between the same two ends in the same time. `mesh_orders`: tooth contacts per
    revolution of the motor. `measured`: times on the recording's clock [s] and speed of the motor [1/s], both (n,);
    None where sound is alone.
    """

    analysis: Analysis
    cruises: tuple[Cruise, ...]
    spectra: Array
    repeats: bool
    mesh_orders: tuple[float, ...] = ()
    measured: tuple[Array, Array] | None = None

    @property
    def moving(self) -> Mask | None:
        """Whether the axis moves, `HOP_HZ` values per second, shape (n,); None without a standstill."""
        size = int(self.analysis.duration_s * HOP_HZ)
        return self.analysis.moves(size) if self.analysis.motion.reversal_times_s else None

    def moving_at(self, time_s: Array) -> Mask:
        """Whether the axis moves at times (n,) [s]; everywhere where no standstill is known."""
        moving = self.moving
        if moving is None:
            return np.ones(time_s.size, dtype=np.bool_)
        return np.asarray(moving[np.clip((time_s * HOP_HZ).astype(np.intp), 0, moving.size - 1)])

    def cruising_at(self, start_s: Array, end_s: Array) -> Mask:
        """Which stretches, of starts and ends (n,) [s], lie within a cruise."""
        out = np.zeros(start_s.size, dtype=np.bool_)
        for c in self.cruises:
            out |= (start_s >= c.start_s) & (end_s <= c.end_s)
        return out

    def turns_at(self, time_s: Array) -> Array:
        """Speed of the motor [1/s] at times (n,) [s]; 0 where it is not known."""
        if self.measured is not None:
            return np.interp(time_s, *self.measured, left=0.0, right=0.0)
        out = np.zeros(time_s.size)
        for c in self.cruises:
            out[(time_s >= c.start_s) & (time_s < c.end_s)] = c.turns_per_s or 0.0
        return out

    def turns_within(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Least and largest speed of the motor that sounds there [1/s]; none at a speed that changes unmeasured, which
        makes no line, and any at a steady one that is unknown."""
        if self.measured is not None:
            time, turns = self.measured
            inside = turns[slice(*np.searchsorted(time, (start_s, end_s)))]
            return (float(inside.min()), float(inside.max())) if inside.size else (0.0, math.inf)
        near = [c for c in self.cruises if c.start_s - MARGIN_S < end_s and start_s < c.end_s + MARGIN_S]
        if near or not self.cruises:
            known = [c.turns_per_s for c in near if c.turns_per_s]
            return ((1.0 - UNEVEN) * min(known), (1.0 + UNEVEN) * max(known)) if known else (0.0, math.inf)
        return math.inf, 0.0

    @cached_property
    def levels(self) -> Levels:
        """How loud it is at each pitch, cruising, at changing speed and at rest; None without a standstill."""
        return levels_of(self)

    @cached_property
    def orders(self) -> OrderSpectra | None:
        """Spectra of the envelope over the path of the motor; None where that is not known."""
        time: Array = np.arange(self.analysis.samples.size) / ANALYSIS_RATE_HZ
        return order_spectra(self.analysis, self.turns_at(time))

    @property
    def speed(self) -> float | None:
        """Usual speed of the motor while cruising [1/s]; None where it is not known."""
        known = [c.turns_per_s for c in self.cruises if c.turns_per_s is not None]
        return float(np.median(known)) if known else None


def course_of(axis: Axis, sound: Recording, m: Measurement | None, offset_s: float) -> Course:
    """What is known of the motion during a recording that starts `offset_s` after the telemetry [s]."""
    reversals: tuple[float, ...] = ()
    if m is not None:
        reversals = tuple(t for t in reversal_times_s(m.time_s - offset_s, m.angle) if 0.0 <= t <= sound.duration_s)
    analysis = Analysis(sound, OperatingCondition(reversal_times_s=reversals))
    cruises = _cruises(analysis)
    spectra = np.zeros((len(cruises), TRANSFORM // 2 + 1))
    for row, cruise in zip(spectra, cruises, strict=True):
        row[:] = over_surroundings(cruise.cut(analysis.samples), ANALYSIS_RATE_HZ)
    times = np.array(analysis.motion.reversal_times_s)
    cycles = times[2:] - times[:-2]
    repeats = bool(cycles.size >= LEAST_CRUISES and np.ptp(cycles) < UNEVEN * np.median(cycles))
    if m is None:
        cruises = _with_heard_speed(axis, cruises, spectra, repeats)
        return Course(analysis, cruises, spectra, repeats, mesh_orders(axis))
    measured = (m.time_s - offset_s, np.abs(m.speed) / (2.0 * math.pi))
    mean = [np.mean(np.interp(np.linspace(c.start_s, c.end_s, 100), *measured)) for c in cruises]
    cruises = tuple(replace(c, turns_per_s=float(v) or None) for c, v in zip(cruises, mean, strict=True))
    return Course(analysis, cruises, spectra, repeats, mesh_orders(axis), measured)


def _cruises(analysis: Analysis) -> tuple[Cruise, ...]:
    """Between two standstills, where it is as loud as on the way; of a known period before the first and after the last
    as well."""
    motion = analysis.motion
    times = np.array(motion.reversal_times_s)
    if times.size and motion.period_s:
        times = np.concatenate([[times[0] - motion.period_s / 2.0], times, [times[-1] + motion.period_s / 2.0]])
    starts = np.maximum(times[:-1] + motion.slow_s[1] + MARGIN_S, 0.0)
    ends = np.minimum(times[1:] + motion.slow_s[0] - MARGIN_S, analysis.duration_s)
    return tuple(Cruise(float(a), float(b)) for a, b in zip(starts, ends, strict=True) if b - a >= SHORTEST_CRUISE_S)


def _with_heard_speed(axis: Axis, cruises: tuple[Cruise, ...], spectra: Array, repeats: bool) -> tuple[Cruise, ...]:
    """Speed of each cruise from the lines of the meshes; of all together where the motion repeats."""
    described = None
    if axis.describes_motion("load_speed_rad_s"):
        described = axis.motion.load_speed_rad_s * axis.ratio / (2.0 * math.pi)
    if len(cruises) < LEAST_CRUISES:
        return cruises
    if repeats:
        longest = max(c.length_s for c in cruises)
        speed = mesh_speed(axis, np.asarray(spectra.mean(axis=0)), len(cruises), longest, described)
        return tuple(replace(c, turns_per_s=speed or described, heard=speed is not None) for c in cruises)
    alone = [mesh_speed(axis, row, 1, c.length_s, described) for c, row in zip(cruises, spectra, strict=True)]
    return tuple(replace(c, turns_per_s=v, heard=v is not None) for c, v in zip(cruises, alone, strict=True))
