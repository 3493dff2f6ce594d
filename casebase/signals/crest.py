"""Crest factor: how far the peak stands above the effective value."""

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


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


def peak_trace(samples: NDArray[np.float32], window: int, step: int) -> NDArray[np.float32]:
    """Return the peak of every window, shape (1 + (n - window) // step,) [unit]; arguments in samples."""
    windows = sliding_window_view(samples, window)[::step]
    peaks: NDArray[np.float32] = np.maximum(windows.max(axis=1), -windows.min(axis=1))
    return peaks


def root_mean_square_trace(samples: NDArray[np.float32], window: int, step: int) -> NDArray[np.float32]:
    """Return the effective value of every window, shape as `peak_trace` [unit]; arguments in samples."""
    windows = sliding_window_view(samples, window)[::step]
    power = np.einsum("ij,ij->i", windows, windows, dtype=np.float32)
    effective: NDArray[np.float32] = np.sqrt(power / np.float32(window))
    return effective


def crest_factor_trace(samples: NDArray[np.float32], window: int, step: int) -> NDArray[np.float32]:
    """Return the crest factor of every window, shape as `peak_trace` [1]; NaN where silent.

    Olsson and Stolyarchuk, equation (2). Window and step are numbers of samples.
    """
    peaks = peak_trace(samples, window, step)
    effective = root_mean_square_trace(samples, window, step)
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
