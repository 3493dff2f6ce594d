"""Impacts that repeat with the motion: of a damaged tooth once per cycle, of play at every reversal.

The sound below 200 Hz, where a gear's forces are heard without the ringing of its housing, is folded on the strokes of
the motion (`casebase.signals.fold`): a height of 0 dB is what noise alone reaches somewhere with probability 0.05.
What a healthy gear does with its motion it does in both directions alike, and on either side of a standstill alike:
lines of the meshes sweep through resonances, shafts swing after a start. So a candidate is judged by how far it stands
out over every other bump of the same recording, and by its height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from casebase.signals.analysis import Analysis
from casebase.signals.band import Band
from casebase.signals.fold import SMOOTH_S, TOLERANCE, Fold, fold
from casebase.signals.motion import HOP_HZ
from casebase.signals.spectra import band_envelope
from sim.discrepancy.acoustic.operating_states import Course, Mask
from sim.torsional.model import Array

TEETH_BAND_HZ = (40.0, 100.0, 8.0)  # low, high, whitening: above arm and servo, below the housing
APART_S = 0.06  # an impact is over by then
RAMP_S = 0.05  # the speed is not yet steady when the loudness is
LEAST_CYCLES = 2.0
LEAST_HOPS = 20
LEAST_REVERSALS = 3
NO_STANDSTILL = "no standstill is heard"
NO_REPEAT = "the motion does not repeat"
NOT_WHOLE = "parts of the stroke are in one direction only"


@dataclass(frozen=True)
class Tail:
    """How often good gearboxes reach a score: `share` of them exceed `start`, fewer by e per `scale` beyond [dB]."""

    start: float
    share: float
    scale: float

    def p_value(self, score: float) -> float:
        """Chance that a gearbox in good order scores as high; 1 below the tail."""
        return self.share * math.exp(-(score - self.start) / self.scale) if score > self.start else 1.0


@dataclass(frozen=True)
class Bump:
    """The strongest candidate of a fold: score, height [dB], offset from the reversal [s], which stroke (0, 1)."""

    score: float
    height_db: float
    offset_s: float
    stroke: int


def notch_bump(course: Course) -> Bump | None:
    """A bump in one direction of motion while cruising; None where the motion does not repeat often enough."""
    strokes, folded = single_strokes(course), course.analysis.folded(Band.LOW)
    if strokes is None or folded is None:
        return None
    _, single = strokes
    stroke, place = (int(i) for i in np.unravel_index(int(np.argmax(single)), single.shape))
    height = float(single[stroke, place])
    # after one end and before the other the axis moves the same way
    way = np.stack([folded.offset_s < 0, folded.offset_s > 0])
    rest = float(np.where(way != way[stroke, place], single, -np.inf).max())
    course_db = (folded.forward_db, folded.backward_db)[stroke]
    return Bump(height + height - max(rest, 0.0), height, _peak(course_db, folded, place), stroke)


def notch_hindrance(course: Course) -> str | None:
    """Why a damaged tooth cannot be looked for; None where it can."""
    analysis = course.analysis
    folded = analysis.folded(Band.LOW)
    if not analysis.motion.reversal_times_s:
        return NO_STANDSTILL
    if folded is None:
        return rate_too_low(analysis)
    if not course.repeats:
        few = len(analysis.motion.reversal_times_s) < LEAST_REVERSALS
        return "too few standstills are heard to tell whether the motion repeats" if few else NO_REPEAT
    if analysis.motion.cycles < LEAST_CYCLES:
        return f"{LEAST_CYCLES:.0f} cycles of the motion are needed and the recording has {analysis.motion.cycles:.1f}"
    if _cruising(analysis, folded).sum() < LEAST_HOPS:
        return "the axis hardly cruises between its standstills"
    return None if _complete(folded) else NOT_WHOLE


def play_hindrance(course: Course) -> str | None:
    """Why play cannot be looked for; None where it can."""
    analysis = course.analysis
    low = analysis.folded(Band.LOW)
    count = len(analysis.motion.reversal_times_s)
    if count == 0:
        return NO_STANDSTILL
    if low is None or _folded(analysis, *TEETH_BAND_HZ) is None:
        return rate_too_low(analysis)
    if count < LEAST_REVERSALS:
        return f"{LEAST_REVERSALS} standstills are needed and {count} heard"
    if not _complete(low):
        return NOT_WHOLE
    return None if _braking(low).any() else "no braking is heard before the standstills"


def rate_too_low(analysis: Analysis) -> str:
    """Why a band that holds the teeth cannot be listened to."""
    return f"the sample rate of {analysis.recording.sample_rate_hz:.0f} Hz is too low"


def _cruising(analysis: Analysis, folded: Fold) -> Mask:
    start, end = analysis.motion.slow_s
    return np.asarray((folded.offset_s < start - RAMP_S) | (folded.offset_s > end + RAMP_S))


def _braking(low: Fold) -> Mask:
    return np.asarray(low.in_zone & ~low.in_quiet & (low.offset_s < 0.0))


def single_strokes(course: Course) -> tuple[Array, Array] | None:
    """Offsets (m,) [s]; how far either stroke stands over the other, (2, m) [dB], minus infinity but while cruising.

    None where the motion does not repeat often enough.
    """
    analysis = course.analysis
    folded = analysis.folded(Band.LOW)
    if folded is None or notch_hindrance(course):
        return None
    cruising = _cruising(analysis, folded)
    strokes = np.stack([folded.forward_db, folded.backward_db])
    other = widened(strokes[::-1])
    single = np.where(cruising, strokes - np.maximum(other, np.median(other, axis=1, keepdims=True)), -np.inf)
    return folded.offset_s, single


def play_bump(course: Course) -> Bump | None:
    """A bump at both ends of the motion where braking begins, for there the torque changes its sign."""
    analysis = course.analysis
    low, teeth = analysis.folded(Band.LOW), _folded(analysis, *TEETH_BAND_HZ)
    if low is None or teeth is None or play_hindrance(course):
        return None
    both = 0.5 * (widened(_both(low)) + widened(_both(teeth)))
    outside = ~low.in_quiet
    place = int(np.argmax(np.where(_braking(low), both, -np.inf)))
    offset, height = float(low.offset_s[place]), float(both[place])
    rest = float(np.where(outside & (np.abs(low.offset_s - offset) > APART_S), both, -np.inf).max())
    return Bump(height - max(rest, 0.0), height, offset, 0)


def _both(folded: Fold) -> Array:
    return np.asarray(np.maximum(np.minimum(folded.forward_db, widened(folded.backward_db)), -6.0))


def _complete(folded: Fold) -> bool:
    return bool(np.isfinite(folded.forward_db).all() and np.isfinite(folded.backward_db).all())


def widened(height_db: Array) -> Array:
    """Let every height hold within the tolerance of the motion, too, along the last axis."""
    return np.asarray(maximum_filter1d(height_db, 2 * TOLERANCE + 1, axis=-1))


def _peak(height_db: Array, folded: Fold, place: int) -> float:
    """Middle of the plateau that the tolerance makes of a peak [s]."""
    near = np.flatnonzero(height_db >= height_db[place] - 1e-9)
    near = near[np.abs(near - place) <= 2 * TOLERANCE]
    return float(folded.offset_s[near].mean()) + 0.5 / HOP_HZ


def _folded(analysis: Analysis, low_hz: float, high_hz: float, whiten_hz: float) -> Fold | None:
    envelope = band_envelope(analysis.spectrum, low_hz, high_hz, whiten_hz)
    if envelope is None:
        return None
    return fold(envelope.smoothed(SMOOTH_S, HOP_HZ), analysis.motion, 2 * 1.5 * SMOOTH_S * (high_hz - low_hz))
