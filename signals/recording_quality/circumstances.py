"""Circumstances: how well a gear could be heard in a recording, whatever the gear is like."""

import itertools
import math

import numpy as np
from scipy import ndimage

from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.motion import HOP_HZ, SMOOTH_HOPS, loudness_db

LEAST_FALL_DB = 0.1
AFTER_S = 0.2
"""How long the sound just after a start, and that before braking, is averaged [s]."""


def standstill_db(analysis: Analysis) -> tuple[float, float]:
    """Return the fall above 200 Hz at standstill, and the low band on the way against the machine above [dB]."""
    motion, above = analysis.motion, analysis.loudness_db
    if not motion.reversal_times_s:
        return 0.0, 0.0
    below = loudness_db(analysis.low_passed, ANALYSIS_RATE_HZ)
    time_s = (np.arange(above.size) + 0.5) / HOP_HZ
    times = np.array(motion.reversal_times_s)
    offset_s = time_s - times[np.abs(time_s[:, None] - times).argmin(axis=1)]
    kept = analysis.is_kept(above.size)
    stands = (offset_s > motion.quiet_s[0] / 2) & (offset_s < motion.quiet_s[1] / 2) & kept
    moves = ((offset_s < motion.slow_s[0]) | (offset_s > motion.slow_s[1])) & kept
    if not stands.any() or not moves.any():
        return 0.0, 0.0
    way, still = float(np.median(above[moves])), float(np.median(above[stands]))
    fall = max(way - still, LEAST_FALL_DB)
    machine = way + 10 * math.log10(1 - 10 ** (-fall / 10))
    return way - still, float(np.median(below[moves])) - machine


def louder_after_start_db(analysis: Analysis) -> float:
    """Return how much louder it is after the slow part than before the next one, median over strokes [dB]."""
    motion, level_db = analysis.motion, analysis.loudness_db
    times = motion.reversal_times_s
    if len(times) < 2:
        return 0.0
    smooth = ndimage.uniform_filter1d(level_db.astype(np.float64), SMOOTH_HOPS)
    width = round(AFTER_S * HOP_HZ)
    found = []
    for start, end in itertools.pairwise(times):
        first, last = round((start + motion.slow_s[1]) * HOP_HZ), round((end + motion.slow_s[0]) * HOP_HZ)
        if first >= 0 and last <= smooth.size and last - first >= 3 * width:
            found.append(float(smooth[first : first + width].mean() - smooth[last - width : last].mean()))
    return float(np.median(found)) if found else 0.0


def low_band_level_db(analysis: Analysis) -> float:
    """Return the level per hertz of 30 to 120 Hz against 250 to 500 Hz [dB]; 0 where that cannot be said."""
    if analysis.highest_hz < 500 or analysis.duration_s < 1:
        return 0.0
    low, high = analysis.spectrum.band_power(30.0, 120.0) / 90, analysis.spectrum.band_power(250.0, 500.0) / 250
    return max(-100.0, 10 * math.log10(max(low, 1e-30) / high)) if high > 0 else 0.0
