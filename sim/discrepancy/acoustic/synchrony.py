"""Whether a sound belongs to the telemetry beside it: the faster an axis moves, the louder it is."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from casebase.signals.analysis import Analysis
from casebase.signals.condition import UNKNOWN
from casebase.signals.motion import HOP_HZ, SMOOTH_HOPS
from casebase.signals.recording import Recording
from sim.discrepancy.data.preprocessing import Measurement
from sim.torsional.model import Array

LEAST_STANDSTILLS = 3  # heard: a sound in which nothing is heard of a motion contradicts none
STRANGE = 0.2  # correlation; of 75 pairs that belong together the least has 0.42
FITS = 0.6
AS_GOOD = 0.02
STEP_S = 0.02  # of the offsets tried
LEAST_SHARE = 0.5  # of the sound that must lie within the telemetry
SLOW = 0.05  # of the usual speed: below, no axis is quieter


def mismatch(sound: Recording, m: Measurement, offset_s: float) -> tuple[str, ...]:
    """A remark where the loudness has standstills of its own and does not follow the measured speed."""
    analysis = Analysis(sound, UNKNOWN)
    count = len(analysis.motion.reversal_times_s)
    if count < LEAST_STANDSTILLS:
        return ()
    level = uniform_filter1d(analysis.loudness_db.astype(np.float64), SMOOTH_HOPS)
    level = np.maximum(level, np.percentile(level, 2))
    here = _correlation(level, m, offset_s)
    if here is None or here >= STRANGE:
        return ()
    reach = sound.duration_s + float(m.time_s[-1])
    offsets = np.arange(-reach, reach, STEP_S)
    found = [(value, float(one)) for one in offsets if (value := _correlation(level, m, float(one))) is not None]
    best = max((value for value, _ in found), default=here)
    # a motion that repeats fits at many offsets: the next one is likeliest
    at = min((one for value, one in found if value > best - AS_GOOD), key=lambda one: abs(one - offset_s), default=0.0)
    told = (
        f"The sound does not follow the measured speed (correlation {here:.2f}, though {count} standstills are heard; "
        "0.4 and more where both are of one motion)"
    )
    if best >= FITS:
        return (f"{told}; it would with an offset of {at:.2f} s ({best:.2f}): is the offset of the sound right?",)
    return (f"{told}, at no offset (at best {best:.2f}): are they of the same motion?",)


def _correlation(level: Array, m: Measurement, offset_s: float) -> float | None:
    """Of loudness with the logarithm of speed; None where too little of the sound lies within the telemetry."""
    time = (np.arange(level.size) + 0.5) / HOP_HZ + offset_s
    inside = (time >= m.time_s[0]) & (time <= m.time_s[-1])
    if inside.mean() < LEAST_SHARE:
        return None
    speed = np.abs(np.interp(time[inside], m.time_s, m.speed))
    moved = np.log(speed + SLOW * max(float(np.percentile(speed, 90)), 1e-9))
    if np.ptp(moved) == 0.0 or np.ptp(level[inside]) == 0.0:
        return None
    return float(np.corrcoef(moved, level[inside])[0, 1])
