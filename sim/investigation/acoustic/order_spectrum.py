"""Power of the sound's envelope over the path of the motor, by orders: what strikes so many times per turn.

The envelope of each band is taken over the path, measured or known from lines of teeth while cruising, and its power
averaged over pieces of the path (Welch 1967).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import welch
from scipy.special import gammaincinv

from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.band import Band
from sim.chain.model import Array

BANDS = (Band.MIDDLE, Band.HIGH)
PER_TURN = 128  # samples of the envelope per turn of the motor
PIECE_TURNS = 64.0
LEAST_TURNS = 8.0
LEVEL_S = 0.25  # over which the envelope is taken relative to its mean
PEAK = 12.0  # times the mean, to which the envelope is cut: one knock is no rhythm
FLOOR_BINS = 201


@dataclass(frozen=True, eq=False)
class OrderSpectra:
    """Mean power of `averages` pieces, 1 for noise, in all bands: (bands, m), at `orders` (m,) per turn of the motor.

    `along`: over the path; `fixed`: over time, at orders of the usual speed, where what is fixed in hertz is a line.
    """

    orders: Array
    along: Array
    fixed: Array
    averages: int

    @property
    def step(self) -> float:
        """Distance of two orders."""
        return float(self.orders[1])


def order_spectra(analysis: Analysis, turns_per_s: Array) -> OrderSpectra | None:
    """Spectra of a recording from the speeds (n,) at its samples; None where the motor turns too little."""
    path = np.cumsum(turns_per_s) / ANALYSIS_RATE_HZ
    envelopes = [whole for band in BANDS if (whole := analysis.envelope(band)) is not None]
    if path[-1] < LEAST_TURNS or not envelopes:
        return None
    usual = float(np.median(turns_per_s[turns_per_s > 0.8 * turns_per_s.max()]))
    size = int(min(PIECE_TURNS, 0.5 * path[-1]) * PER_TURN)
    averages = max(1, 2 * int(path[-1] * PER_TURN) // size - 1)
    along, fixed = [], []
    for whole in envelopes:
        envelope = np.sqrt(whole.inside().astype(np.float64))
        level = uniform_filter1d(envelope, round(LEVEL_S * whole.rate_hz))
        envelope = np.minimum(envelope / np.maximum(level, 1e-12) - 1.0, PEAK)
        time: Array = (np.arange(envelope.size) + 0.5) / whole.rate_hz
        place = np.interp(time * ANALYSIS_RATE_HZ, np.arange(path.size), path)
        along.append(_power(place, envelope, size, averages))
        fixed.append(_power(time * usual, envelope, size, averages))
    orders: Array = np.arange(size // 2 + 1) * PER_TURN / size
    return OrderSpectra(orders, np.array(along), np.array(fixed), averages)


def _power(place: Array, envelope: Array, size: int, averages: int) -> Array:
    """Power over its own median, of an envelope at places (n,) of the path."""
    grid: Array = np.arange(place[0], max(place[-1], size / PER_TURN), 1.0 / PER_TURN)
    _, power = welch(np.interp(grid, place, envelope), PER_TURN, "hann", size)
    floor = median_filter(power, FLOOR_BINS, mode="nearest") * averages / gammaincinv(averages, 0.5)
    return np.asarray(power / np.maximum(floor, 1e-300))
