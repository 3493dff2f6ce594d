"""Spectra: one long transform of a whole record, and what is cut out of it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

EXTENSION_S = 0.25
HANN_POWER = 3 / 8
PAPER_CUTOFF_HZ = 200.0


@dataclass(frozen=True, eq=False)
class LongSpectrum:
    """Spectrum of a whole record that was mirrored at both ends.

    Mirroring keeps a signal that starts or ends at full level continuous, and adds no step of its own to a noisy
    one (continuing it point-symmetrically would: a step of twice the first sample); so what is filtered here has
    no impulses at its edges.

    Args:
        values: one-sided spectrum of the extended record, shape (m,).
        size: samples in the extended record.
        lead: samples in front of the record.
        samples: samples in the record.
        rate_hz: sample rate [Hz].
    """

    values: NDArray[np.complex64]
    size: int
    lead: int
    samples: int
    rate_hz: float

    @property
    def resolution_hz(self) -> float:
        """Distance of two bins [Hz]."""
        return self.rate_hz / self.size

    @cached_property
    def power(self) -> NDArray[np.float32]:
        """Squared magnitude of every bin, shape (m,) [unit²]."""
        power: NDArray[np.float32] = self.values.real**2 + self.values.imag**2
        return power

    @cached_property
    def windowed_power(self) -> NDArray[np.float32]:
        """Squared magnitude under a Hann window of the extended record's length, shape (m,) [unit²].

        Multiplying by the window is to take a quarter of either neighbour from half of every bin (Harris, On the
        use of windows for harmonic analysis, 1978); strong lines then no longer leak into other bands.
        """
        beside = np.empty_like(self.values)
        beside[1:-1] = self.values[:-2] + self.values[2:]
        beside[0], beside[-1] = 2 * self.values[1].real, 2 * self.values[-2].real
        windowed = np.complex64(0.5) * self.values - np.complex64(0.25) * beside
        power: NDArray[np.float32] = windowed.real**2 + windowed.imag**2
        return power

    def bins(self, low_hz: float, high_hz: float) -> slice:
        """Return the bins from low (inclusive) to high (exclusive) frequency [Hz]."""
        first, last = (int(np.ceil(edge / self.resolution_hz)) for edge in (low_hz, high_hz))
        return slice(min(first, self.values.size), min(last, self.values.size))

    def band_power(self, low_hz: float, high_hz: float) -> float:
        """Return the mean square of a band of the record [unit²]; 0 without a bin in it."""
        band = self.bins(low_hz, high_hz)
        return float(2.0 * self.windowed_power[band].sum() / self.size**2 / HANN_POWER)


def long_spectrum(samples: NDArray[np.float32], rate_hz: float) -> LongSpectrum:
    """Return the spectrum of a whole record, samples of shape (n,), mirrored by a quarter second at both ends."""
    lead = int(EXTENSION_S * rate_hz)
    size = fft.next_fast_len(samples.size + 2 * lead, real=True)
    extended = np.pad(samples, (lead, size - samples.size - lead), mode="symmetric")
    return LongSpectrum(fft.rfft(extended), size, lead, samples.size, rate_hz)


@dataclass(frozen=True, eq=False)
class BandEnvelope:
    """Squared envelope of one band of a record.

    Args:
        power: squared magnitude of the analytic band signal, shape (m,), of the extended record.
        rate_hz: values of `power` per second [Hz]; about the bandwidth.
        lead_s: time before the record [s].
        duration_s: length of the record [s].
        bandwidth_hz: width of the band [Hz].
    """

    power: NDArray[np.float32]
    rate_hz: float
    lead_s: float
    duration_s: float
    bandwidth_hz: float

    def inside(self) -> NDArray[np.float32]:
        """Return the part of `power` that belongs to the record, shape (k,)."""
        first = round(self.lead_s * self.rate_hz)
        count = max(1, int(self.duration_s * self.rate_hz))
        inside: NDArray[np.float32] = self.power[first : first + count]
        return inside

    def smoothed(self, width_s: float, hop_hz: float) -> NDArray[np.float32]:
        """Return the power smoothed by a triangle of full width at half height `width_s` [s], `hop_hz` per second.

        Shape (floor(duration * hop_hz),); always above 0.
        """
        length = max(1, round(width_s * self.rate_hz))
        smooth = ndimage.uniform_filter1d(ndimage.uniform_filter1d(self.power, length), length)
        times = self.lead_s + (np.arange(int(self.duration_s * hop_hz)) + 0.5) / hop_hz
        place = np.minimum(times * self.rate_hz, smooth.size - 1.001)
        before = place.astype(np.intp)
        share = (place - before).astype(np.float32)
        values = smooth[before] * (1 - share) + smooth[before + 1] * share
        return np.asarray(np.maximum(values, np.finfo(np.float32).tiny), dtype=np.float32)


def band_envelope(
    spectrum: LongSpectrum, low_hz: float, high_hz: float, whiten_hz: float | None = None
) -> BandEnvelope | None:
    """Return the squared envelope of a band, or None if the band has too few bins (under 8).

    The one-sided spectrum of the band alone is the analytic signal shifted to zero frequency, sampled at the
    bandwidth (Boashash, Estimating and interpreting the instantaneous frequency, 1992). With `whiten_hz` every
    bin is first divided by the effective value of the bins around it, over that width [Hz]: resonances and lines
    lose their weight, and a short event stands out against noise of any colour.
    """
    band = spectrum.bins(low_hz, high_hz)
    values = spectrum.values[band]
    if values.size < 8:
        return None
    if whiten_hz is not None:
        width = max(3, round(whiten_hz / spectrum.resolution_hz))
        level = ndimage.uniform_filter1d(spectrum.power[band], width, mode="nearest")
        values = values / np.sqrt(np.maximum(level, np.finfo(np.float32).tiny))
    size = fft.next_fast_len(values.size)
    analytic = fft.ifft(values, size)
    rate_hz = size * spectrum.resolution_hz
    return BandEnvelope(
        analytic.real**2 + analytic.imag**2,
        rate_hz,
        spectrum.lead / spectrum.rate_hz,
        spectrum.samples / spectrum.rate_hz,
        high_hz - low_hz,
    )


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
