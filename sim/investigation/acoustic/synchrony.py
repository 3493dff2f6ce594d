"""Whether a sound belongs to the telemetry beside it: the faster an axis moves, the louder it is."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from signals.analysis import Analysis
from signals.condition import UNKNOWN
from signals.motion import HOP_HZ, SMOOTH_HOPS
from signals.recording import Recording
from sim.investigation.data.preprocessing import Measurement

LEAST_STANDSTILLS = 3  # heard: a sound in which nothing is heard of a motion contradicts none
STRANGE = 0.2  # correlation; of 75 pairs that belong together the least has 0.42
SLOW = 0.05  # of the usual speed: below, no axis is quieter


def mismatch(sound: Recording, m: Measurement, offset_s: float) -> tuple[str, ...]:
    """A remark where the loudness has standstills of its own and does not follow the measured speed."""
    analysis = Analysis(sound, UNKNOWN)
    count = len(analysis.motion.reversal_times_s)
    level = uniform_filter1d(analysis.loudness_db.astype(np.float64), SMOOTH_HOPS)
    time = (np.arange(level.size) + 0.5) / HOP_HZ + offset_s
    inside = (time >= m.time_s[0]) & (time <= m.time_s[-1])
    if count < LEAST_STANDSTILLS or inside.mean() < 0.5:
        return ()
    level = np.maximum(level[inside], np.percentile(level, 2))
    speed = np.abs(np.interp(time[inside], m.time_s, m.speed))
    moved = np.log(speed + SLOW * max(float(np.percentile(speed, 90)), 1e-9))
    if np.ptp(moved) == 0.0 or np.ptp(level) == 0.0 or (found := float(np.corrcoef(moved, level)[0, 1])) >= STRANGE:
        return ()
    return (
        f"The sound does not follow the measured speed (correlation {found:.2f}, though {count} standstills are heard; "
        "0.4 and more where both are of one motion): is the offset of the sound right, and are they of one motion?",
    )
