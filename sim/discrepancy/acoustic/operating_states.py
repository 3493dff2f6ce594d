"""The course of the motion behind a recording: reversals, cruising between them, and how fast that is.

Reversals come from telemetry, or are heard (the sound all but vanishes at standstill). The speed of a cruise comes
from telemetry, or from the lines of the meshes, whose orders the axis description gives.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, hilbert, sosfiltfilt

from casebase.signals.analysis import ANALYSIS_RATE_HZ, Analysis
from casebase.signals.condition import UNKNOWN, OperatingCondition
from casebase.signals.motion import Motion, find_dips
from casebase.signals.recording import Recording
from casebase.signals.stroke import reversal_times_s
from sim.description.axis import Axis
from sim.discrepancy.acoustic.levels import Levels, levels_of
from sim.discrepancy.acoustic.spectral_lines import LOWEST_HZ, TRANSFORM, heard_speed, mesh_orders, over_surroundings
from sim.discrepancy.data.preprocessing import Measurement
from sim.torsional.model import Array

Mask = NDArray[np.bool_]
MARGIN_S = 0.1  # loudness is full before the speed is
SAME_CYCLE = 0.02
SAME_TIME = 0.03  # of a period: a standstill is heard early or late
ENOUGH = 3  # standstills, to show a period
MOST = 0.7  # of the standstills; a dropout makes one more
SHORTEST_CRUISE_S = 0.4
LEAST_CRUISES = 3
LEAST_HEARD_CYCLES = 3  # overlapping: five standstills
UNEVEN = 0.02  # of a speed that is heard, while cruising
EVEN_S = 0.05  # how early or late a standstill is heard


@dataclass(frozen=True, eq=False)
class Cruise:
    """A stretch at constant speed: start and end [s], direction (1 or -1; strokes alternate), motor speed [1/s].

    `heard`: the speed is that of lines in the sound and not only described.
    """

    start_s: float
    end_s: float
    direction: int
    turns_per_s: float | None = None
    heard: bool = False

    @property
    def length_s(self) -> float:
        """How long it is [s]."""
        return self.end_s - self.start_s

    @property
    def turned(self) -> float:
        """Revolutions of the motor [1]; 0 where its speed is not known."""
        return (self.turns_per_s or 0.0) * self.length_s


@dataclass(frozen=True, eq=False)
class LoadAngle:
    """From telemetry: times on the recording's clock, angle of the load [rad], turns of the motor [1/s], all (n,)."""

    time_s: Array
    angle_rad: Array
    turns_per_s: Array


@dataclass(frozen=True, eq=False)
class Course:
    """Recording and motion. `spectra` (cruises, m): power over its surroundings; `moving` (n,) at the recording's rate.

    `repeats`: back and forth between the same two ends in the same time. `mesh_orders`: tooth contacts per
    revolution of the motor. `load`: None where sound is alone. `contradiction`: of the described period, in words.
    """

    analysis: Analysis
    cruises: tuple[Cruise, ...]
    spectra: Array
    moving: Mask | None
    repeats: bool
    mesh_orders: tuple[float, ...] = ()
    load: LoadAngle | None = None
    contradiction: str | None = None

    def envelope(self, cruise: int, band: tuple[float, float]) -> Array:
        """Power spectrum (m,) of the envelope of a band [Hz] during a cruise, over its surroundings."""
        spectra: Array = self._envelopes[band]
        return np.asarray(spectra[cruise])

    def turns_within(self, start_s: float, end_s: float) -> tuple[float, float]:
        """Least and largest speed of the motor that sounds there [1/s]; none at a speed that changes unmeasured, which
        makes no line, and any at a steady one that is unknown."""
        if self.load is not None:
            inside = self.load.turns_per_s[slice(*np.searchsorted(self.load.time_s, (start_s, end_s)))]
            return (float(inside.min()), float(inside.max())) if inside.size else (0.0, math.inf)
        near = [c for c in self.cruises if c.start_s - MARGIN_S < end_s and start_s < c.end_s + MARGIN_S]
        if near or not self.cruises:
            known = [c.turns_per_s for c in near if c.turns_per_s]
            return ((1.0 - UNEVEN) * min(known), (1.0 + UNEVEN) * max(known)) if known else (0.0, math.inf)
        return math.inf, 0.0

    @cached_property
    def levels(self) -> Levels:
        """How loud it is at each pitch, cruising, at changing speed and at rest; None without a standstill."""
        if self.moving is None:
            return Levels(None, None, None)
        spans = [(c.start_s, c.end_s) for c in self.cruises]
        return levels_of(self.analysis.samples, spans, self.moving, self.analysis.recording.sample_rate_hz)

    @cached_property
    def _envelopes(self) -> _Envelopes:
        return _Envelopes(self)

    @property
    def speed(self) -> float | None:
        """Usual speed of the motor while cruising [1/s]; None where it is not known."""
        known = [c.turns_per_s for c in self.cruises if c.turns_per_s is not None]
        return float(np.median(known)) if known else None


class _Envelopes(dict[tuple[float, float], Array]):
    """Spectra of the envelope of every cruise (cruises, m) by band, made when asked for."""

    def __init__(self, course: Course) -> None:
        super().__init__()
        self._course = course

    def __missing__(self, band: tuple[float, float]) -> Array:
        sos = butter(4, band, "bandpass", fs=ANALYSIS_RATE_HZ, output="sos")
        out = np.zeros_like(self._course.spectra)
        for row, cruise in zip(out, self._course.cruises, strict=True):
            first, last = round(cruise.start_s * ANALYSIS_RATE_HZ), round(cruise.end_s * ANALYSIS_RATE_HZ)
            part = self._course.analysis.samples[first:last].astype(np.float64)
            row[:] = over_surroundings(np.abs(hilbert(sosfiltfilt(sos, part))), ANALYSIS_RATE_HZ)
        self[band] = out
        return out


def described_period_s(axis: Axis) -> float | None:
    """The period of the motion, where the description says one, and be it the default."""
    return axis.motion.period_s if axis.describes_motion("period_s") else None


def contradiction_of(described_s: float, heard: Motion, duration_s: float) -> str | None:
    """What the standstills in a recording say against a described period, in words; None where they fit it.

    Two standstills say little, since strokes need not take the same time in both directions, but that they are few.
    """
    times = np.array(heard.reversal_times_s)
    own = heard.period_in_sound_s
    told = f"The description gives the motion a period of {described_s:.3g} s, but the {times.size} standstills heard"
    if times.size < ENOUGH:
        missed = 2.0 * duration_s / described_s - times.size
        if times.size == 0 or (missed < ENOUGH and np.ptp(times) < (1.0 + SAME_CYCLE) * described_s):
            return None
    if own is not None:
        if abs(own / described_s - 1.0) < SAME_CYCLE:
            return None
        return f"{told} come with one of {own:.3g} s: the recording's own is used."
    if times.size < ENOUGH:
        return f"{told} are too few for it in {duration_s:.3g} s: no period is used."
    later = times[:, None] + described_s * np.array([-1.0, 1.0])
    apart = np.abs(later[:, :, None] - times).min(axis=2)
    inside = (later > 0.0) & (later < duration_s)
    if inside.any() and np.mean(apart[inside] < SAME_TIME * described_s) >= MOST:
        return None
    usual = float(np.median(np.diff(times)))
    return f"{told} do not repeat with it; they lie {usual:.3g} s apart on the median: no period is used."


def without_loudest_octave(sound: Recording) -> Recording:
    """What may be heard beside a noise or a line that is as loud at standstill as in motion."""
    spectrum = np.fft.rfft(sound.samples)
    octave = np.log2(np.maximum(np.fft.rfftfreq(sound.samples.size, 1.0 / sound.sample_rate_hz), 1.0) / LOWEST_HZ)
    sixth = np.floor(6.0 * np.maximum(octave, -1.0 / 6.0)).astype(np.int64) + 1
    power = np.convolve(np.bincount(sixth, np.abs(spectrum) ** 2)[1:], np.ones(6), "valid")
    if power.size:
        first = int(np.argmax(power)) / 6.0
        spectrum[(octave >= first) & (octave < first + 1.0)] = 0.0
    return replace(sound, samples=np.fft.irfft(spectrum, sound.samples.size).astype(np.float32))


def course_of(axis: Axis, sound: Recording, m: Measurement | None, offset_s: float) -> Course:
    """What is known of the motion during a recording that starts `offset_s` after the telemetry [s]."""
    reversals: tuple[float, ...] = ()
    if m is not None:
        reversals = tuple(t for t in reversal_times_s(m.time_s - offset_s, m.angle) if 0.0 <= t <= sound.duration_s)
    described = described_period_s(axis)
    analysis = Analysis(sound, OperatingCondition(motion_period_s=described, reversal_times_s=reversals))
    contradiction = None
    if m is None and not analysis.motion.reversal_times_s:
        analysis = Analysis(without_loudest_octave(sound), analysis.condition)
    if m is None and described is not None:
        contradiction = contradiction_of(described, analysis.motion, sound.duration_s)
        analysis = analysis if contradiction is None else Analysis(analysis.recording, UNKNOWN)
    cruises = _cruises(analysis)
    if m is not None:
        cruises = _with_measured_speed(cruises, m, offset_s)
    spectra = _spectra(analysis, cruises)
    repeats = _repeats(reversals) if m is not None else _heard_to_repeat(analysis)
    if m is None:
        cruises = _with_heard_speed(axis, cruises, spectra, repeats)
    moving = _moving(analysis, sound)
    if m is None:
        return Course(analysis, cruises, spectra, moving, repeats, mesh_orders(axis), contradiction=contradiction)
    angle = m.angle / axis.ratio if m.load_angle is None else m.load_angle
    return Course(
        analysis,
        cruises,
        spectra,
        moving,
        repeats,
        mesh_orders(axis),
        LoadAngle(m.time_s - offset_s, angle, np.abs(m.speed) / (2.0 * math.pi)),
    )


def _repeats(times: tuple[float, ...]) -> bool:
    cycles = np.array(times[2:]) - np.array(times[:-2])
    return bool(cycles.size >= 2 and np.ptp(cycles) < SAME_CYCLE * np.median(cycles))


def _heard_to_repeat(analysis: Analysis) -> bool:
    """Whether standstills repeat that are as many as it takes to tell, or have the period that was given.

    The search for standstills takes as repeating what is even within a sixteenth of a stroke.
    """
    motion = analysis.motion
    if motion.period_s is None or analysis.condition.motion_period_s is not None:
        return motion.period_s is not None
    times = np.array(motion.reversal_times_s)
    cycles = times[2:] - times[:-2]
    if cycles.size < LEAST_HEARD_CYCLES or np.ptp(cycles) > SAME_TIME * motion.period_s:
        return False
    dips, _, _ = find_dips(analysis.loudness_db)
    apart = [float(np.abs(times - dip.centre_s).min()) for dip in dips]
    return not apart or float(np.median(apart)) < EVEN_S


def _moving(analysis: Analysis, sound: Recording) -> Mask | None:
    times = np.array(analysis.motion.reversal_times_s)
    if times.size == 0:
        return None
    start, end = analysis.motion.quiet_s
    clock = np.arange(sound.samples.size) / sound.sample_rate_hz
    moving = np.ones(clock.size, dtype=bool)
    for time in times:
        moving &= (clock < time + start) | (clock > time + end)
    return moving


def _cruises(analysis: Analysis) -> tuple[Cruise, ...]:
    """Between two reversals, where it is as loud as on the way."""
    motion = analysis.motion
    first, last = motion.slow_s[1] + MARGIN_S, motion.slow_s[0] - MARGIN_S
    times = list(motion.reversal_times_s)
    if not times:
        return ()
    stroke = motion.period_s / 2.0 if motion.period_s else float("inf")
    spans = [(times[0] - stroke, times[0]), *itertools.pairwise(times), (times[-1], times[-1] + stroke)]
    out = []
    for index, (left, right) in enumerate(spans):
        start, end = max(left + first, 0.0), min(right + last, analysis.duration_s)
        if end - start >= SHORTEST_CRUISE_S and math.isfinite(left) and math.isfinite(right):
            out.append(Cruise(start, end, 1 if index % 2 == 0 else -1))
    return tuple(out)


def _spectra(analysis: Analysis, cruises: tuple[Cruise, ...]) -> Array:
    out = np.zeros((len(cruises), TRANSFORM // 2 + 1))
    for row, cruise in zip(out, cruises, strict=True):
        first, last = round(cruise.start_s * ANALYSIS_RATE_HZ), round(cruise.end_s * ANALYSIS_RATE_HZ)
        row[:] = over_surroundings(analysis.samples[first:last].astype(np.float64), ANALYSIS_RATE_HZ)
    return out


def _with_measured_speed(cruises: tuple[Cruise, ...], m: Measurement, offset_s: float) -> tuple[Cruise, ...]:
    out = []
    for c in cruises:
        inside = (m.time_s - offset_s >= c.start_s) & (m.time_s - offset_s <= c.end_s)
        if inside.sum() < 2:
            continue
        speed = m.speed[inside]
        direction = 1 if float(speed.mean()) > 0.0 else -1
        out.append(Cruise(c.start_s, c.end_s, direction, abs(float(speed.mean())) / (2.0 * math.pi)))
    return tuple(out)


def _with_heard_speed(axis: Axis, cruises: tuple[Cruise, ...], spectra: Array, repeats: bool) -> tuple[Cruise, ...]:
    """Speed of each cruise from the lines of the meshes; of all together where the motion repeats."""
    orders = mesh_orders(axis)
    described = None
    if axis.describes_motion("load_speed_rad_s"):
        described = axis.motion.load_speed_rad_s * axis.ratio / (2.0 * math.pi)
    if len(cruises) < LEAST_CRUISES:
        return cruises
    if repeats:
        longest = max(c.length_s for c in cruises)
        speed = heard_speed(axis, orders, np.asarray(spectra.mean(axis=0)), len(cruises), longest, described)
        return tuple(replace(c, turns_per_s=speed or described, heard=speed is not None) for c in cruises)
    alone = [heard_speed(axis, orders, row, 1, c.length_s) for c, row in zip(cruises, spectra, strict=True)]
    return tuple(replace(c, turns_per_s=v, heard=v is not None) for c, v in zip(cruises, alone, strict=True))
