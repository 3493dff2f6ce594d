"""Impacts of a damaged tooth and of play, by the strokes of the motion.

The sound below 200 Hz, where a gear's forces are heard without the ringing of its housing, is folded on strokes that
repeat (`signals.half_cycles`): a height of 0 dB is what noise alone reaches somewhere with probability 0.05. A
tooth strikes once per cycle in one direction, play at both ends where the torque changes its sign. What a healthy gear
does it does in both directions, and on either side of a standstill, alike: a candidate is judged by how far it stands
out over every other bump. Where strokes do not repeat, a tooth is a few impacts that stand far over the second around
them, and play makes the end of strokes louder than their beginning.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal import find_peaks
from scipy.stats import trim_mean

from signals.analysis import Analysis
from signals.band import Band
from signals.half_cycles import SMOOTH_S, TOLERANCE, HalfCycles, average_half_cycles
from signals.motion import HOP_HZ
from signals.spectra import BandEnvelope, band_envelope
from sim.chain.model import Array
from sim.investigation.acoustic.operating_states import Course

TEETH_BAND_HZ = (40.0, 100.0, 8.0)  # low, high, whitening: above arm and servo, below the housing
APART_S = 0.06  # an impact is over by then
RAMP_S = 0.05  # the speed is not yet steady when the loudness is
LEAST_REVERSALS = 3
AROUND_S = 1.0  # what an impact stands out of, where strokes do not repeat
FEWEST, MOST = 3, 24  # impacts of a damaged tooth there
END_S = 0.8  # of a stroke, at least: where it brakes or starts
NO_STANDSTILL = "no standstill is heard"


@dataclass(frozen=True, eq=False)
class Bump:
    """The strongest candidate: score and height [dB], offset from the reversal [s], which stroke (0, 1).

    `times_s` (k,): of impacts that do not repeat, empty of a average_half_cycles.
    """

    score: float
    height_db: float
    offset_s: float = 0.0
    stroke: int = 0
    times_s: Array | None = None


def tooth_hindrance(course: Course) -> str | None:
    """Why a damaged tooth, and play, cannot be looked for; None where they can."""
    analysis, count = course.analysis, len(course.analysis.motion.reversal_times_s)
    if count == 0:
        return NO_STANDSTILL
    if analysis.envelope(Band.LOW) is None or _teeth_band(analysis) is None:
        return f"the sample rate of {analysis.recording.sample_rate_hz:.0f} Hz is too low"
    return None if count >= LEAST_REVERSALS else f"{LEAST_REVERSALS} standstills are needed and {count} heard"


def notch_bump(course: Course) -> Bump | None:
    """A bump in one direction of motion while cruising; None where the motion does not repeat."""
    folded = course.analysis.folded(Band.LOW)
    if folded is None or not course.repeats or not _complete(folded):
        return None
    start, end = course.analysis.motion.slow_s
    cruising = (folded.offset_s < start - RAMP_S) | (folded.offset_s > end + RAMP_S)
    if not cruising.any():
        return None
    strokes = np.stack([folded.forward_db, folded.backward_db])
    other = _widened(strokes[::-1])
    single = np.where(cruising, strokes - np.maximum(other, np.median(other, axis=1, keepdims=True)), -np.inf)
    stroke, place = (int(i) for i in np.unravel_index(int(np.argmax(single)), single.shape))
    height = float(single[stroke, place])
    # after one end and before the other the axis moves the same way
    way = np.stack([folded.offset_s < 0, folded.offset_s > 0])
    rest = float(np.where(way != way[stroke, place], single, -np.inf).max())
    return Bump(2.0 * height - max(rest, 0.0), height, _middle(strokes[stroke], folded, place), stroke)


def play_bump(course: Course) -> Bump | None:
    """A bump at both ends of the motion where braking begins, for there the torque changes its sign."""
    analysis = course.analysis
    low, teeth = analysis.folded(Band.LOW), _teeth_band(analysis)
    if low is None or teeth is None or not _complete(low):
        return None
    folded = average_half_cycles(
        teeth.smoothed(SMOOTH_S, HOP_HZ), analysis.motion, 2 * 1.5 * SMOOTH_S * teeth.bandwidth_hz
    )
    braking = low.in_zone & ~low.in_quiet & (low.offset_s < 0.0)
    if folded is None or not braking.any():
        return None
    both = 0.5 * (_widened(_both(low)) + _widened(_both(folded)))
    place = int(np.argmax(np.where(braking, both, -np.inf)))
    offset, height = float(low.offset_s[place]), float(both[place])
    rest = float(np.where(~low.in_quiet & (np.abs(low.offset_s - offset) > APART_S), both, -np.inf).max())
    return Bump(height - max(rest, 0.0), height, offset)


def impacts(course: Course) -> Bump | None:
    """Three impacts or more that stand out of the sound and of all others; None where none can be looked for."""
    if tooth_hindrance(course):
        return None
    over = over_around(course.analysis.envelope(Band.LOW))
    peaks, _ = find_peaks(over, height=0.0, distance=HOP_HZ / 4.0)
    peaks = peaks[np.argsort(-over[peaks], kind="stable")]
    counts = np.arange(FEWEST, min(MOST, peaks.size - 1) + 1)
    if counts.size == 0:
        return Bump(0.0, 0.0, times_s=np.zeros(0))
    scores = 2.0 * over[peaks[counts - 1]] - over[peaks[counts]]
    count = int(counts[np.argmax(scores)])
    times: Array = np.sort((peaks[:count] + 0.5) / HOP_HZ)
    return Bump(float(scores.max()), float(over[peaks[count - 1]]), times_s=times)


def end_of_half_cycles(course: Course) -> Bump | None:
    """How much louder strokes end than they begin and go on, the middle of all; None where too few are heard."""
    low, teeth, motion = course.analysis.envelope(Band.LOW), _teeth_band(course.analysis), course.analysis.motion
    if low is None or teeth is None:
        return None
    over = np.asarray(0.5 * (_widened(over_around(low)) + _widened(over_around(teeth))))
    time: Array = (np.arange(over.size, dtype=np.float64) + 0.5) / HOP_HZ
    before, after = min(motion.reversal_zone_s[0], -END_S), max(motion.reversal_zone_s[1], END_S)
    found = []
    for left, right in itertools.pairwise(motion.reversal_times_s):
        half = 0.5 * (left + right)
        start = over[(time > left + motion.quiet_s[1]) & (time <= min(left + after, half))]
        middle = over[(time > left + after) & (time < right + before)]
        end = (time >= max(right + before, half)) & (time < right + motion.quiet_s[0])
        if start.size and end.any():
            usual = float(np.median(maximum_filter1d(middle, start.size))) if middle.size > start.size else -np.inf
            high = float(over[end].max())
            found.append((high - max(float(start.max()), usual), high, float(time[end][np.argmax(over[end])]) - right))
    if len(found) < LEAST_REVERSALS:
        return None
    louder, height, offset = zip(*found, strict=True)
    return Bump(float(trim_mean(louder, 0.25)), float(np.median(height)), float(np.median(offset)))


def over_around(envelope: BandEnvelope | None) -> Array:
    """How far a band stands over its own median of the second around [dB], `HOP_HZ` values per second."""
    if envelope is None:
        return np.zeros(0)
    level = 10.0 * np.log10(envelope.smoothed(SMOOTH_S, HOP_HZ).astype(np.float64))
    return np.asarray(level - median_filter(level, int(AROUND_S * HOP_HZ) | 1, mode="nearest"))


def _teeth_band(analysis: Analysis) -> BandEnvelope | None:
    return band_envelope(analysis.spectrum, *TEETH_BAND_HZ) if TEETH_BAND_HZ[1] < analysis.highest_hz else None


def _both(folded: HalfCycles) -> Array:
    return np.asarray(np.maximum(np.minimum(folded.forward_db, _widened(folded.backward_db)), -6.0))


def _complete(folded: HalfCycles) -> bool:
    return bool(np.isfinite(folded.forward_db).all() and np.isfinite(folded.backward_db).all())


def _widened(height_db: Array) -> Array:
    """Let every height hold within the tolerance of the motion, too, along the last axis."""
    return np.asarray(maximum_filter1d(height_db, 2 * TOLERANCE + 1, axis=-1))


def _middle(height_db: Array, folded: HalfCycles, place: int) -> float:
    """Middle of the plateau that the tolerance makes of a peak [s]."""
    near = np.flatnonzero(height_db >= height_db[place] - 1e-9)
    near = near[np.abs(near - place) <= 2 * TOLERANCE]
    return float(folded.offset_s[near].mean()) + 0.5 / HOP_HZ
