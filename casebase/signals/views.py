"""Views: what is drawn of a recording, as plain arrays."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.signals import crest
from casebase.signals.analysis import ANALYSIS_RATE_HZ, Analysis, Band
from casebase.signals.recording import Recording

FLOOR_DB = -200.0


@dataclass(frozen=True, eq=False)
class WaveformView:
    """Smallest and largest sample of every stretch, so that no impulse is lost at any zoom.

    Args:
        time_s: middle of each stretch, shape (n,) [s].
        lowest: shape (n,) [unit].
        highest: shape (n,) [unit].
    """

    time_s: NDArray[np.float64]
    lowest: NDArray[np.float32]
    highest: NDArray[np.float32]


def waveform(recording: Recording, points: int = 2000, start_s: float = 0.0, end_s: float = math.inf) -> WaveformView:
    """Return the envelope of the waveform from start to end [s] in at most so many stretches."""
    rate_hz = recording.sample_rate_hz
    first = max(0, int(start_s * rate_hz))
    last = recording.samples.size if math.isinf(end_s) else min(recording.samples.size, math.ceil(end_s * rate_hz))
    if first >= last:
        empty = np.empty(0, dtype=np.float32)
        return WaveformView(np.empty(0), empty, empty)
    piece = recording.samples[first:last]
    edges = np.unique(np.linspace(0, piece.size, min(points, piece.size) + 1).astype(np.intp)[:-1])
    ends = np.append(edges[1:], piece.size)
    time_s = (first + (edges + ends - 1) / 2) / rate_hz
    return WaveformView(time_s, np.minimum.reduceat(piece, edges), np.maximum.reduceat(piece, edges))


@dataclass(frozen=True, eq=False)
class SpectrumView:
    """Power spectral density.

    Args:
        frequency_hz: shape (n,) [Hz].
        level_db: density, shape (n,) [dB re unit²/Hz].
    """

    frequency_hz: NDArray[np.float64]
    level_db: NDArray[np.float64]


def spectrum(recording: Recording, resolution_hz: float = 2.0) -> SpectrumView:
    """Return the density of the whole record by Welch's method (Hann, half overlap), up to half its own rate."""
    size = min(recording.samples.size, round(recording.sample_rate_hz / resolution_hz))
    from scipy import signal  # slow to import

    frequency_hz, density = signal.welch(recording.samples, recording.sample_rate_hz, nperseg=size)
    return SpectrumView(frequency_hz, _decibel(density))


@dataclass(frozen=True, eq=False)
class SpectrogramView:
    """Density over time and frequency.

    Args:
        time_s: middle of each column, shape (m,) [s].
        frequency_hz: shape (n,) [Hz].
        level_db: shape (n, m) [dB re unit²/Hz].
    """

    time_s: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    level_db: NDArray[np.float32]


def spectrogram(
    recording: Recording, size: int = 512, columns: int = 1000, highest_hz: float = math.inf
) -> SpectrogramView:
    """Return a spectrogram (Hann, 75 % overlap) of at most so many columns; neighbours are joined by their maximum.

    Joining by the maximum keeps an impact visible however long the record is.
    """
    size = min(size, recording.samples.size)
    from scipy import signal

    frequency_hz, time_s, density = signal.spectrogram(
        recording.samples, recording.sample_rate_hz, window="hann", nperseg=size, noverlap=size * 3 // 4
    )
    shown = frequency_hz <= highest_hz
    joined = math.ceil(time_s.size / columns)
    starts = np.arange(0, time_s.size, joined)
    level_db = _decibel(np.maximum.reduceat(density[shown], starts, axis=1)).astype(np.float32)
    counts = np.diff(np.append(starts, time_s.size))
    return SpectrogramView(np.add.reduceat(time_s, starts) / counts, frequency_hz[shown], level_db)


@dataclass(frozen=True, eq=False)
class CrestView:
    """Crest factor, effective value and peak of every window below 200 Hz.

    Args:
        time_s: middle of each window, shape (n,) [s].
        crest_factor: shape (n,) [1]; NaN where silent.
        rms: shape (n,) [unit].
        peak: shape (n,) [unit].
        window_s: length of a window [s].
    """

    time_s: NDArray[np.float64]
    crest_factor: NDArray[np.float32]
    rms: NDArray[np.float32]
    peak: NDArray[np.float32]
    window_s: float


def crest_trace(analysis: Analysis, window_s: float = 1.0, step_s: float = 0.1) -> CrestView:
    """Return the windowed crest factor of the low-passed record, with RMS and peak beside it."""
    low = analysis.low_passed
    window = min(low.size, max(2, round(window_s * ANALYSIS_RATE_HZ)))
    step = max(1, round(step_s * ANALYSIS_RATE_HZ))
    factor = crest.crest_factor_trace(low, window, step)
    rms = crest.root_mean_square_trace(low, window, step)
    peak = crest.peak_trace(low, window, step)
    time_s = (np.arange(factor.size, dtype=np.float64) * step + window / 2) / ANALYSIS_RATE_HZ
    return CrestView(time_s, factor, rms, peak, window / ANALYSIS_RATE_HZ)


@dataclass(frozen=True, eq=False)
class PolarView:
    """One cycle of the motion around a circle: 0 to 180 degrees one direction, 180 to 360 the other.

    Args:
        phase_deg: ascending, 0 and 180 at the reversals, shape (n,) [deg].
        height_db: height of the median stroke above what noise reaches, shape (n,) [dB]; NaN where never recorded.
        reversal_zone_deg: width on either side of a reversal where braking and starting lie [deg].
    """

    phase_deg: NDArray[np.float64]
    height_db: NDArray[np.float64]
    reversal_zone_deg: tuple[float, float]


def polar(analysis: Analysis, band: Band = Band.LOW) -> PolarView | None:
    """Return the folded envelope by phase of the motion, or None without a reversal."""
    folded = analysis.folded(band)
    if folded is None:
        return None
    size = folded.offset_s.size
    stroke_s = size * (folded.offset_s[1] - folded.offset_s[0])
    late = folded.offset_s >= 0
    height_db = np.concatenate(
        [
            folded.forward_db[late],
            folded.backward_db[~late],
            folded.backward_db[late],
            folded.forward_db[~late],
        ]
    )
    start, end = folded.zone_s
    degrees = 180.0 / stroke_s
    phase_deg = np.arange(2 * size, dtype=np.float64) * (180.0 / size)
    return PolarView(phase_deg, height_db, (start * degrees, end * degrees))


def _decibel(density: NDArray[np.floating]) -> NDArray[np.float64]:
    level: NDArray[np.float64] = 10 * np.log10(np.maximum(density, 10 ** (FLOOR_DB / 10)), dtype=np.float64)
    return level
