"""How loud a recording is at each pitch while the axis cruises, while its speed changes, and at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import spectrogram

from signals.analysis import ANALYSIS_RATE_HZ
from sim.chain.model import Array

if TYPE_CHECKING:
    from sim.investigation.acoustic.operating_states import Course, Mask

BAND_HZ = (150.0, 3_600.0)
CELL = 0.01  # relative: half as wide as a mode of little damping
SEGMENT = 1_024  # 0.13 s: shorter than what a motion takes to reach its speed
LEAST_SEGMENTS = 12
LEAST_AT_REST = 4


@dataclass(frozen=True, eq=False)
class Levels:
    """Mean level in each cell [dB], shape (cells,); None where that lasts too short."""

    cruising: Array | None = None
    speeding: Array | None = None
    resting: Array | None = None


def cells() -> Array:
    """Centres of cells of a constant share of their frequency [Hz], shape (cells,)."""
    count = int(math.log(BAND_HZ[1] / BAND_HZ[0]) / CELL)
    return np.asarray(BAND_HZ[0] * np.exp(CELL * np.arange(count, dtype=np.float64)))


def levels_of(course: Course) -> Levels:
    """Levels of a recording; none without a standstill."""
    samples = course.analysis.samples
    if course.moving is None or samples.size < 2 * SEGMENT:
        return Levels()
    frequency, time, power = spectrogram(samples, ANALYSIS_RATE_HZ, "hann", SEGMENT, SEGMENT * 3 // 4)
    half = 0.5 * SEGMENT / ANALYSIS_RATE_HZ
    moves = [course.moving_at(time + part * half) for part in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    speeding = moves[2] & ~course.cruising_at(time, time)

    def mean(chosen: Mask, least: int) -> Array | None:
        if chosen.sum() < least:
            return None
        return _in_cells(frequency, (10.0 * np.log10(power[:, chosen] + 1e-30)).mean(axis=1))

    return Levels(
        mean(course.cruising_at(time - half, time + half), LEAST_SEGMENTS),
        mean(speeding, LEAST_SEGMENTS),
        mean(~np.any(moves, axis=0), LEAST_AT_REST),
    )


def _in_cells(frequency: Array, level: Array) -> Array:
    """Mean over each cell, by the integral of the curve through the levels."""
    area = np.concatenate(([0.0], np.cumsum(0.5 * (level[1:] + level[:-1])))) * frequency[1]
    edges = np.exp(np.array([[-0.5], [0.5]]) * CELL) * cells()
    return np.asarray(np.diff(np.interp(edges, frequency, area), axis=0)[0] / np.diff(edges, axis=0)[0])
