"""Bump profile: what a recording says of the size of a fault, whatever the gain, the housing and the noise.

Two things carry the size. When play is crossed the flanks meet later and harder the wider the gap, and meet again: the
envelope around the reversal has the times. A notch is one blow per cycle: its own strength hides behind gain, housing
and distance, but the same microphone hears the reversals, whose forces follow from motion and payload. The reversal
is the hammer that calibrates the blow, band by band.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.band import Band
from signals.half_cycles import HalfCycles
from signals.motion import HOP_HZ

Floats = NDArray[np.float64]
EDGES_HZ = (
    12.0,
    20.0,
    32.0,
    40.0,
    50.0,
    63.0,
    80.0,
    100.0,
    125.0,
    160.0,
    200.0,
    250.0,
    315.0,
    400.0,
    500.0,
    630.0,
    800.0,
)
"""Edges of the bands in which the bump is compared, mostly third octaves [Hz]."""
WINDOW = 1024
"""Samples of a spectrum: 128 ms at 8 kHz, a blow with its ringing."""
HOP = 80
MARGIN_S = 0.15
"""Time before and after the slow part of a stroke that belongs to the reversal: braking is heard before it is slow."""


def reversal_trace_db(analysis: Analysis, half_s: float) -> Floats:
    """Return the envelope of 12 to 200 Hz around the reversals, mean over strokes, over its median [dB].

    Shape (2 * round(half_s * HOP_HZ),), from `half_s` before to `half_s` after; NaN where never recorded.
    """
    half, trace = round(half_s * HOP_HZ), analysis.traced(Band.LOW)
    total, count = np.zeros(2 * half), np.zeros(2 * half)
    if trace is not None and trace.size:
        for time in analysis.motion.reversal_times_s:
            first = round(time * HOP_HZ) - half
            inside = slice(max(0, -first), min(2 * half, trace.size - first))
            total[inside] += trace[first + inside.start : first + inside.stop]
            count[inside] += 1
        total /= float(np.median(trace))
    return _decibel(np.where(count > 0, total / np.maximum(count, 1), math.nan))


def bump_ratios_db(analysis: Analysis) -> Floats:
    """Return how strong the bump of one direction is, in the bands of `EDGES_HZ`, and where it is; shape (4 * 16 + 2,).

    In each band over the reversals, over the running sound and over the other direction, then the reversals over the
    running sound [dB]; last the time of the bump from the reversal, and its magnitude [s]. NaN without a reversal.
    """
    folded, bands = analysis.folded(Band.LOW), len(EDGES_HZ) - 1
    if folded is None or analysis.samples.size < 2 * WINDOW:
        return np.full(4 * bands + 2, math.nan)
    power = _spectrogram(analysis.samples)
    times = np.asarray((np.arange(len(power)) * HOP + WINDOW / 2) / ANALYSIS_RATE_HZ, dtype=np.float64)
    offset_s, direction = _highest(folded)
    side = (np.arange(folded.centres_s.size) + folded.first_direction) % 2
    bump, other = (
        _mean(power, times, folded.centres_s[side == each] + offset_s) for each in (direction, 1 - direction)
    )
    start, end = analysis.motion.slow_s
    from_reversal = times[:, None] - folded.centres_s
    near = ((from_reversal > start - MARGIN_S) & (from_reversal < end + MARGIN_S)).any(axis=1)
    if not near.any() or near.all():
        return np.full(4 * bands + 2, math.nan)
    reversal, running = power[near].mean(axis=0), np.median(power[~near], axis=0)
    ratios = [_decibel(a / b) for a, b in ((bump, reversal), (bump, running), (bump, other), (reversal, running))]
    return np.concatenate([*ratios, [offset_s, abs(offset_s)]])


def _spectrogram(samples: NDArray[np.float32]) -> Floats:
    """Return the power in each band, shape (frames, bands)."""
    frames = np.lib.stride_tricks.sliding_window_view(samples, WINDOW)[::HOP]
    spectrum = fft.rfft(frames * np.hanning(WINDOW).astype(np.float32), axis=1)
    power = spectrum.real**2 + spectrum.imag**2
    edges = np.searchsorted(np.arange(power.shape[1]) * ANALYSIS_RATE_HZ / WINDOW, EDGES_HZ)
    return np.asarray(np.add.reduceat(power[:, : edges[-1]], edges[:-1], axis=1), dtype=np.float64)


def _highest(folded: HalfCycles) -> tuple[float, int]:
    """Return where the bump of one direction is from the reversal [s], and in which direction."""
    heights = np.where(np.isfinite(folded.asymmetry_db), folded.asymmetry_db, -np.inf)
    place = int(np.argmax(heights))
    forward, backward = (np.nan_to_num(side[place], nan=-np.inf) for side in (folded.forward_db, folded.backward_db))
    return float(folded.offset_s[place]), int(backward > forward)


def _mean(power: Floats, times: Floats, wanted_s: Floats) -> Floats:
    """Return the mean power at some times, shape (bands,); NaN if all lie outside the record."""
    inside = wanted_s[(wanted_s >= times[0]) & (wanted_s <= times[-1])]
    if inside.size == 0:
        return np.full(power.shape[1], math.nan)
    places = np.rint((inside - times[0]) / (HOP / ANALYSIS_RATE_HZ)).astype(np.intp)
    return np.asarray(power[np.minimum(places, len(power) - 1)].mean(axis=0))


def _decibel(ratio: Floats) -> Floats:
    return np.asarray(10 * np.log10(np.maximum(ratio, np.finfo(np.float32).tiny)))
