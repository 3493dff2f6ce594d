"""Impacts of a motion that does not repeat: each held against the sound around it, play stroke by stroke.

Nothing can be folded there. A damaged tooth of the output gear is passed a few times in a recording; then the sound
below 200 Hz stands far over that of the second around it. So do, less far, the beginning and the end of strokes of a
good gear, and by as much; play makes the end louder, where the torque changes its sign.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.stats import trim_mean

from casebase.signals.band import Band
from casebase.signals.motion import HOP_HZ
from casebase.signals.spectra import BandEnvelope, band_envelope
from sim.discrepancy.acoustic.impacts import LEAST_REVERSALS, NO_STANDSTILL, TEETH_BAND_HZ, Bump, rate_too_low, widened
from sim.discrepancy.acoustic.operating_states import Course, Mask
from sim.torsional.model import Array

SMOOTH_S = 0.02  # an impact and its ringing
AROUND_HOPS = 201  # one second
APART_HOPS = 50  # closer ones are one
FEWEST, MOST = 3, 24  # impacts of a damaged tooth, the highest of them
END_S = 0.8  # of a stroke, at least: where it brakes or starts
LEAST_HOPS = 10
LEAST_STROKES = 3
CUT = 0.25  # of the strokes at either end, so that one that is heard wrongly says little
BEFORE_S, AFTER_S = 0.95, 0.3  # of a standstill: where play is heard
AT_STANDSTILLS = 0.6  # of the impacts
OF_OUTPUT = 2.5  # impacts in a stroke: the output gear hardly turns round once in one
ALIKE_DB = 2.5  # where the next impact is no lower there are more of them than stand out
BY_PLAY = 20.0  # score up to which impacts may be those of play, wherever they are


@dataclass(frozen=True, eq=False)
class Impacts:
    """The impacts that stand out of all others: score and height of the lowest [dB], times (k,) [s].

    `at_standstills`: share of them shortly before one. `in_stroke`: how many there are in a stroke that has any.
    """

    score: float
    height_db: float
    times_s: Array
    at_standstills: float
    in_stroke: float

    @property
    def like_play(self) -> bool:
        """Whether play would make such, where there is some."""
        return self.at_standstills >= AT_STANDSTILLS or self.score < BY_PLAY

    @property
    def of_output(self) -> bool:
        """Whether they are few enough for the output gear, and no others like them are between them."""
        return self.in_stroke < OF_OUTPUT and self.score - self.height_db > ALIKE_DB


def impacts(course: Course) -> Impacts | None:
    """Three impacts or more that stand out of the sound and of all other impacts; None where none can be looked for."""
    if impacts_hindrance(course):
        return None
    over = over_around(course.analysis.envelope(Band.LOW))
    peaks = np.flatnonzero((over >= maximum_filter1d(over, 2 * APART_HOPS + 1)) & (over > 0.0))
    peaks = peaks[np.argsort(-over[peaks], kind="stable")]
    heights = over[peaks]
    counts = np.arange(FEWEST, min(MOST, heights.size - 1) + 1)
    if counts.size == 0:
        return Impacts(0.0, 0.0, np.zeros(0), 0.0, 0.0)
    scores = 2.0 * heights[counts - 1] - heights[counts]
    count = int(counts[np.argmax(scores)])
    times: Array = np.sort((peaks[:count] + 0.5) / HOP_HZ)
    standstills = np.array(course.analysis.motion.reversal_times_s)
    before = standstills[:, None] - times
    share = float(np.any((before < BEFORE_S) & (before > -AFTER_S), axis=0).mean())
    strokes = np.searchsorted(standstills, times)
    return Impacts(float(scores.max()), float(heights[count - 1]), times, share, count / np.unique(strokes).size)


def impacts_hindrance(course: Course) -> str | None:
    """Why impacts of a motion that does not repeat cannot be looked for; None where they can."""
    analysis = course.analysis
    if analysis.envelope(Band.LOW) is None:
        return rate_too_low(analysis)
    count = len(analysis.motion.reversal_times_s)
    if count == 0:
        return NO_STANDSTILL
    return None if count >= LEAST_REVERSALS else f"{LEAST_REVERSALS} standstills are needed and {count} heard"


def end_of_strokes(course: Course) -> Bump | None:
    """How much louder strokes end than they begin and go on, the middle of all; None where too few are heard.

    A healthy gear is shaken alike by both ends of the same stroke.
    """
    if end_hindrance(course):
        return None
    low, teeth = course.analysis.envelope(Band.LOW), band_envelope(course.analysis.spectrum, *TEETH_BAND_HZ)
    over = np.asarray(0.5 * (widened(over_around(low)) + widened(over_around(teeth))))
    time: Array = (np.arange(over.size, dtype=np.float64) + 0.5) / HOP_HZ
    louder, heights, before = [], [], []
    for start, middle, end, stop in _ends(course, time):
        width = int(start.sum())
        beside = maximum_filter1d(over, width)[middle]
        usual = float(np.median(beside)) if beside.size > width else -np.inf
        louder.append(float(over[end].max()) - max(float(over[start].max()), usual))
        heights.append(float(over[end].max()))
        before.append(stop - float(time[end][np.argmax(over[end])]))
    return Bump(float(trim_mean(louder, CUT)), float(np.median(heights)), -float(np.median(before)), 0)


def end_hindrance(course: Course) -> str | None:
    """Why play cannot be looked for in strokes that do not repeat; None where it can."""
    low = course.analysis.envelope(Band.LOW)
    if low is None:
        return rate_too_low(course.analysis)
    if not course.analysis.motion.reversal_times_s:
        return NO_STANDSTILL
    time: Array = (np.arange(int(low.duration_s * HOP_HZ), dtype=np.float64) + 0.5) / HOP_HZ
    count = len(_ends(course, time))
    return None if count >= LEAST_STROKES else f"{LEAST_STROKES} whole strokes are needed and {count} heard"


def _ends(course: Course, time: Array) -> list[tuple[Mask, Mask, Mask, float]]:
    """Where each stroke begins, goes on and ends, and the time of the standstill after it [s]."""
    motion = course.analysis.motion
    quiet_before, quiet_after = motion.quiet_s
    before, after = min(motion.reversal_zone_s[0], -END_S), max(motion.reversal_zone_s[1], END_S)
    out = []
    for left, right in itertools.pairwise(motion.reversal_times_s):
        half = 0.5 * (left + right)
        start = (time > left + quiet_after) & (time <= min(left + after, half))
        end = (time >= max(right + before, half)) & (time < right + quiet_before)
        middle = (time > left + after) & (time < right + before)
        if start.sum() >= LEAST_HOPS and end.sum() >= LEAST_HOPS:
            out.append((start, middle, end, right))
    return out


def over_around(envelope: BandEnvelope | None) -> Array:
    """How far a band stands over its own median of the second around [dB], `HOP_HZ` values per second."""
    if envelope is None:
        return np.zeros(0)
    level = 10.0 * np.log10(envelope.smoothed(SMOOTH_S, HOP_HZ).astype(np.float64))
    return np.asarray(level - median_filter(level, AROUND_HOPS, mode="nearest"))
