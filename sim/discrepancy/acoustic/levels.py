"""How loud a recording is at each pitch while the axis cruises, while its speed changes, and at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import ShortTimeFFT

from casebase.signals.analysis import ANALYSIS_RATE_HZ
from sim.torsional.model import Array

LOWEST_HZ, HIGHEST_HZ = 150.0, 3_600.0
CELL = 0.01  # relative: half as wide as a mode of little damping
SEGMENT = 1_024  # 0.13 s: shorter than what a motion takes to reach its speed
LEAST_SEGMENTS = 12
LEAST_AT_REST = 4
PARTS = (-0.5, -0.25, 0.0, 0.25, 0.5)  # of a segment


@dataclass(frozen=True, eq=False)
class Levels:
    """Mean level in each cell [dB], shape (cells,); None where that lasts too short."""

    cruising: Array | None
    speeding: Array | None
    resting: Array | None


def cells() -> Array:
    """Centres of cells of a constant share of their frequency [Hz], shape (cells,)."""
    count = int(math.log(HIGHEST_HZ / LOWEST_HZ) / CELL)
    return np.asarray(LOWEST_HZ * np.exp(CELL * np.arange(count, dtype=np.float64)))


def levels_of(
    samples: NDArray[np.float32], spans_s: Sequence[tuple[float, float]], moving: NDArray[np.bool_], rate_hz: float
) -> Levels:
    """Levels of samples at the analysis rate.

    `spans_s`: starts and ends of the cruises [s]; `moving`: whether the axis moves, at `rate_hz`, shape (m,).
    """
    transform = ShortTimeFFT(np.hanning(SEGMENT), SEGMENT // 4, ANALYSIS_RATE_HZ, fft_mode="onesided")
    if samples.size < 2 * SEGMENT:
        return Levels(None, None, None)
    first, last = transform.lower_border_end[1], transform.upper_border_begin(samples.size)[1]
    power = transform.spectrogram(samples, p0=first, p1=last)
    middle = transform.t(samples.size, p0=first, p1=last)
    half = 0.5 * SEGMENT / ANALYSIS_RATE_HZ
    cruising, within = np.zeros((2, middle.size), dtype=np.bool_)
    for start, end in spans_s:
        cruising |= (middle - half >= start) & (middle + half <= end)
        within |= (middle > start) & (middle < end)
    places = np.rint((middle[:, None] + np.array(PARTS) * SEGMENT / ANALYSIS_RATE_HZ) * rate_hz).astype(np.int64)
    moves = moving[np.clip(places, 0, moving.size - 1)]
    speeding = moves[:, PARTS.index(0.0)] & ~within
    resting = np.asarray(~moves.any(axis=1))

    def mean(chosen: NDArray[np.bool_], least: int) -> Array | None:
        if chosen.sum() < least:
            return None
        return _in_cells(transform.f, (10.0 * np.log10(power[:, chosen] + 1e-30)).mean(axis=1))

    return Levels(mean(cruising, LEAST_SEGMENTS), mean(speeding, LEAST_SEGMENTS), mean(resting, LEAST_AT_REST))


def _in_cells(frequency: Array, level: Array) -> Array:
    """Mean over each cell, by the integral of the curve through the levels."""
    spacing = frequency[1] - frequency[0]
    area = np.concatenate(([0.0], np.cumsum(0.5 * (level[1:] + level[:-1])))) * spacing
    low, high = cells() * math.exp(-0.5 * CELL), cells() * math.exp(0.5 * CELL)
    return np.asarray((np.interp(high, frequency, area) - np.interp(low, frequency, area)) / (high - low))
