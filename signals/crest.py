"""Crest factor: how far the peak stands above the effective value."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signals.spectra import PAPER_CUTOFF_HZ, long_spectrum, low_pass

WINDOW_S = 0.1
"""Window of the trace unless another is asked for [s]."""


def root_mean_square(samples: NDArray[np.float32]) -> float:
    """Return the effective value of samples of shape (n,) [unit of the samples].

    >>> root_mean_square(np.array([3.0, -3.0], dtype=np.float32))
    3.0
    """
    return math.sqrt(float(np.dot(samples, samples)) / samples.size)


def peak(samples: NDArray[np.float32]) -> float:
    """Return the largest magnitude of samples of shape (n,) (detector 0-pk) [unit of the samples]."""
    return float(max(samples.max(), -samples.min()))


def crest_factor(samples: NDArray[np.float32]) -> float:
    """Return peak over effective value of samples of shape (n,) [1]; NaN for silence.

    Olsson and Stolyarchuk, equation (1).

    >>> round(crest_factor(np.sin(np.arange(8000) * 0.1).astype(np.float32)), 3)
    1.414
    """
    effective = root_mean_square(samples)
    return peak(samples) / effective if effective > 0 else math.nan


@dataclass(frozen=True, eq=False)
class CrestTrace:
    """Crest factor over time: peak of every window over the effective value of the whole record.

    Figures 8 and 9 of Olsson and Stolyarchuk. The largest value is the crest factor of the record, equation (1); the
    mean is at most the root of 2 B T, the independent values below B in a window T.

    Args:
        middle_s: middle of every window, shape (w,) [s].
        peak: largest magnitude in every window, shape (w,) [unit of the samples].
        rms: effective value of every window, shape (w,) [unit of the samples].
        whole_rms: effective value of the record [unit of the samples].
    """

    middle_s: NDArray[np.float64]
    peak: NDArray[np.float64]
    rms: NDArray[np.float64]
    whole_rms: float

    @property
    def values(self) -> NDArray[np.float64]:
        """The trace, shape (w,) [1]; NaN for silence."""
        return self.peak / (self.whole_rms or math.nan)

    @property
    def largest(self) -> float:
        """Crest factor of the whole record [1]; NaN for silence."""
        return float(self.values.max())

    @property
    def mean(self) -> float:
        """Mean of the trace [1]; NaN for silence."""
        return float(self.values.mean())


def crest_trace(
    samples: NDArray[np.floating],
    rate_hz: float,
    window_s: float = WINDOW_S,
    low_pass_hz: float | None = PAPER_CUTOFF_HZ,
) -> CrestTrace:
    """Return the crest factor over time of samples of shape (n,), without their mean.

    Args:
        rate_hz: samples per second [Hz].
        window_s: length of the windows, side by side; the last may be shorter [s].
        low_pass_hz: what lies above is left out [Hz]; None or 0: nothing is.
    """
    heard = np.asarray(samples - samples.mean(dtype=np.float64), dtype=np.float32)
    if low_pass_hz:
        heard = low_pass(long_spectrum(heard, rate_hz), low_pass_hz)
    edges = np.append(np.arange(0, heard.size, max(1, round(window_s * rate_hz))), heard.size)
    windows = np.split(heard, edges[1:-1])
    return CrestTrace(
        (edges[:-1] + edges[1:]) / 2 / rate_hz,
        np.array([peak(each) for each in windows]),
        np.array([root_mean_square(each) for each in windows]),
        root_mean_square(heard),
    )


def crest_factor_trace(samples: NDArray[np.float32], window: int, step: int) -> NDArray[np.float32]:
    """Return the crest factor of every window, shape (1 + (n - window) // step,) [1]; NaN where silent.

    Olsson and Stolyarchuk, equation (2). Window and step are numbers of samples.
    """
    windows = sliding_window_view(samples, window)[::step]
    peaks = np.maximum(windows.max(axis=1), -windows.min(axis=1))
    effective = np.sqrt(np.einsum("ij,ij->i", windows, windows, dtype=np.float32) / np.float32(window))
    trace: NDArray[np.float32] = np.divide(peaks, effective, out=np.full_like(peaks, np.nan), where=effective > 0)
    return trace


def kurtosis(samples: NDArray[np.float32]) -> float:
    """Return the fourth moment over the squared second of samples of shape (n,) [1]; 3 for Gaussian noise.

    >>> kurtosis(np.array([1.0, -1.0, 1.0, -1.0], dtype=np.float32))
    1.0
    """
    centred = samples - samples.mean()
    square = centred * centred
    variance = square.mean()
    if variance == 0:
        return math.nan
    square /= variance
    return float((square @ square) / square.size)
