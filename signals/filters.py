"""Filters without phase and without impulses at the edges."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from signals.spectra import LongSpectrum

PAPER_CUTOFF_HZ = 200.0


def low_pass(spectrum: LongSpectrum, cutoff_hz: float = PAPER_CUTOFF_HZ) -> NDArray[np.float32]:
    """Return the record below the cutoff [Hz] (-6 dB there), shape (n,), with no phase shift.

    A Butterworth low-pass of order 4 run forwards and backwards, gain 1 / (1 + (f / cutoff)^8), applied to the
    spectrum of the mirrored record. The paper filters at 200 Hz (Olsson and Stolyarchuk).
    """
    count = int(min(spectrum.values.size, np.ceil(6 * cutoff_hz / spectrum.resolution_hz)))
    frequency = np.arange(count, dtype=np.float32) * np.float32(spectrum.resolution_hz / cutoff_hz)
    gain = 1.0 / (1.0 + np.square(np.square(np.square(frequency))))
    filtered = fft.irfft(spectrum.values[:count] * gain, spectrum.size)
    return np.ascontiguousarray(filtered[spectrum.lead : spectrum.lead + spectrum.samples])
