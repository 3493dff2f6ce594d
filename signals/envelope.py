"""Envelope statistics: impulses in a trace, repetition after a time, the spectrum of the envelope."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage


def spectral_kurtosis_db(power: NDArray[np.float32]) -> float:
    """Return how far the fourth moment of a band is above that of Gaussian noise [dB]; 0 for noise.

    Args:
        power: squared envelope of the band, shape (n,).

    Antoni, The spectral kurtosis: a useful tool for characterising non-stationary signals, 2006, equation (6),
    as a level: 10 lg(E|x|^4 / (2 (E|x|^2)^2)).
    """
    power = power.astype(np.float64)
    mean = power.mean() if power.size else 0.0
    return float(10 * np.log10((power @ power) / power.size / (2 * mean**2))) if mean > 0 else np.nan


def impulses(
    trace: NDArray[np.float32], threshold_db: float, apart: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return where a trace peaks above its median by more than a threshold, and by how much more [dB].

    Args:
        trace: smoothed squared envelope, shape (n,).
        threshold_db: height that noise does not reach [dB over the median].
        apart: only the highest peak within so many values on either side counts.
    """
    height = 10 * np.log10(trace.astype(np.float64) / np.median(trace)) - threshold_db
    peaks = np.flatnonzero((height > 0) & (height == ndimage.maximum_filter1d(height, 2 * apart + 1)))
    return peaks, height[peaks]


def repetition(trace: NDArray[np.float32], lag: int, tolerance: int) -> float:
    """Return the correlation, from -1 to 1, of the level of a trace with itself some values later.

    The best of the lags within the tolerance; NaN if fewer than half a lag of values would be compared, or
    the trace never changes.
    """
    level = np.log(trace.astype(np.float64))
    known = np.isfinite(level)
    level -= level[known].mean() if known.any() else 0.0
    level[~known] = 0.0
    power = float(level @ level) / level.size
    if level.size - lag - tolerance < max(lag / 2, 20) or power == 0:
        return np.nan
    shifts = range(max(1, lag - tolerance), lag + tolerance + 1)
    products = [float(level[:-shift] @ level[shift:]) / (level.size - shift) for shift in shifts]
    return max(-1.0, min(1.0, max(products) / power))


@lru_cache(maxsize=32)
def _hann(size: int) -> NDArray[np.float32]:
    return np.hanning(size).astype(np.float32)


@dataclass(frozen=True, eq=False)
class AveragedSpectrum:
    """Spectrum of a squared envelope, averaged over pieces.

    Args:
        power: shape (m,), from 0 on.
        step_hz: distance of two values [Hz].
        resolution_hz: distance of two independent ones [Hz].
        pieces: how many were averaged.
    """

    power: NDArray[np.float64]
    step_hz: float
    resolution_hz: float
    pieces: int


def averaged_spectrum(pieces: Sequence[NDArray[np.float32]], rate_hz: float) -> AveragedSpectrum | None:
    """Return the mean spectrum of pieces of a squared envelope, shape (n,) each, or None without any.

    Each piece counts relative to its own mean, so that a loud one does not count for more; one of less than half the
    length of the longest is left out, for its lines are too wide (Welch, IEEE Trans. Audio AU-15, 1967).
    """
    longest = max((piece.size for piece in pieces), default=0)
    chosen = [piece for piece in pieces if piece.size >= max(longest / 2, 16) and piece.any()]
    if not chosen:
        return None
    size = fft.next_fast_len(longest, real=True)
    rows = np.zeros((len(chosen), size), dtype=np.float32)
    for row, piece in zip(rows, chosen, strict=True):
        window = _hann(piece.size)
        scale = 1 / np.sqrt(len(chosen) * float(window @ window))
        np.multiply(piece, scale / piece.mean(), out=row[: piece.size])
        row[: piece.size] -= np.float32(scale)
        row[: piece.size] *= window
    values = fft.rfft(rows, axis=1)
    total = np.einsum("ij,ij->j", values.real, values.real) + np.einsum("ij,ij->j", values.imag, values.imag)
    return AveragedSpectrum(total.astype(np.float64), rate_hz / size, rate_hz / longest, len(chosen))


def over_surroundings_db(
    spectrum: AveragedSpectrum, range_hz: tuple[float, float], surroundings_hz: float
) -> tuple[NDArray[np.float64], float]:
    """Return the level of a range over the median of what is around each value, shape (k,) [dB].

    Beside it how many independent values there are in the range; 0 where the spectrum does not reach.
    """
    first, last = (int(edge / spectrum.step_hz) for edge in range_hz)
    last = min(last, spectrum.power.size)
    if last - first < 8:
        return np.empty(0), 0.0
    width = max(9, int(surroundings_hz / spectrum.step_hz) | 1)
    around = ndimage.median_filter(spectrum.power[: last + width], size=width, mode="nearest")[first:last]
    level = 10 * np.log10(np.maximum(spectrum.power[first:last], np.finfo(np.float32).tiny) / np.maximum(around, 1e-30))
    return level, (last - first) * spectrum.step_hz / spectrum.resolution_hz
