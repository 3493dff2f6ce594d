"""Analysis: what several feature families need of one recording, each computed once, when asked for."""

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from casebase.signals import envelope, filters
from casebase.signals.condition import OperatingCondition
from casebase.signals.fold import SMOOTH_S, Fold, fold, noise_peak_db
from casebase.signals.motion import HOP_HZ, Motion, find_motion, loudness_db
from casebase.signals.recording import Recording
from casebase.signals.spectra import BandEnvelope, LongSpectrum, band_envelope, long_spectrum

ANALYSIS_RATE_HZ = 8000.0
"""Sample rate that every recording is brought to [Hz]; the paper's."""

IMPULSES_APART_S = 0.05
"""Impulses closer than this are one [s]."""

USABLE_SHARE = 0.95
"""Share of the band up to half the original sample rate that anti-aliasing filters leave whole."""


class Band(Enum):
    """Bands in which events are looked for: (low [Hz], high [Hz], width of whitening [Hz])."""

    LOW = (12.0, 200.0, 8.0)
    MIDDLE = (200.0, 1000.0, 100.0)
    HIGH = (1000.0, 3600.0, 100.0)

    @property
    def label(self) -> str:
        """The band as it stands in names of features, for example `12_200_hz`."""
        return f"{self.value[0]:.0f}_{self.value[1]:.0f}_hz"


@dataclass(frozen=True, eq=False)
class Analysis:
    """A recording at the analysis rate, with its condition."""

    recording: Recording
    condition: OperatingCondition

    @cached_property
    def samples(self) -> NDArray[np.float32]:
        """Samples at the analysis rate without their mean, shape (n,) [unit]."""
        samples = self.recording.resampled(ANALYSIS_RATE_HZ).samples
        centred: NDArray[np.float32] = samples - samples.mean()
        return centred

    @property
    def duration_s(self) -> float:
        """Length [s]."""
        return self.samples.size / ANALYSIS_RATE_HZ

    @property
    def highest_hz(self) -> float:
        """Up to where the recording can hold sound [Hz]."""
        return USABLE_SHARE * min(self.recording.sample_rate_hz, ANALYSIS_RATE_HZ) / 2

    @cached_property
    def spectrum(self) -> LongSpectrum:
        """Spectrum of the whole record."""
        return long_spectrum(self.samples, ANALYSIS_RATE_HZ)

    @cached_property
    def low_passed(self) -> NDArray[np.float32]:
        """The record below 200 Hz, as in the paper, shape (n,) [unit]."""
        return filters.low_pass(self.spectrum)

    def envelope(self, band: Band) -> BandEnvelope | None:
        """Squared envelope of a band after whitening; None if the recording does not reach there."""
        return self._envelopes[band]

    @cached_property
    def _envelopes(self) -> dict[Band, BandEnvelope | None]:
        found: dict[Band, BandEnvelope | None] = {}
        for band in Band:
            low_hz, high_hz, whiten_hz = band.value
            top_hz = min(high_hz, self.highest_hz)
            whole = top_hz >= low_hz + (high_hz - low_hz) / 4
            found[band] = band_envelope(self.spectrum, low_hz, top_hz, whiten_hz) if whole else None
        return found

    @cached_property
    def loudness_db(self) -> NDArray[np.float32]:
        """Level of the sound above 200 Hz, `HOP_HZ` values per second, shape (k,) [dB]."""
        return loudness_db(self.samples - self.low_passed, ANALYSIS_RATE_HZ)

    @cached_property
    def motion(self) -> Motion:
        """Back and forth, as given or as heard; heard above 200 Hz, or below where nothing is heard there."""
        motion = find_motion(self.loudness_db, self.condition)
        if motion.period_in_sound_s or motion.reversal_times_s:
            return motion
        return find_motion(loudness_db(self.low_passed, ANALYSIS_RATE_HZ), self.condition)

    def traced(self, band: Band) -> NDArray[np.float32] | None:
        """Smoothed squared envelope of a band, `HOP_HZ` values per second, shape (k,)."""
        return self._traces[band]

    @cached_property
    def _traces(self) -> dict[Band, NDArray[np.float32] | None]:
        return {
            band: whole.smoothed(SMOOTH_S, HOP_HZ) if whole is not None else None
            for band, whole in self._envelopes.items()
        }

    def freedom(self, band: Band) -> float:
        """Degrees of freedom of noise in the trace of a band: two per independent value in the triangle."""
        whole = self._envelopes[band]
        return 2 * 1.5 * SMOOTH_S * whole.bandwidth_hz if whole is not None else 0.0

    def noise_peak_db(self, band: Band) -> float:
        """Height over the median that noise reaches somewhere in the trace of a band [dB]."""
        return noise_peak_db(1, self.freedom(band), max(1.0, self.duration_s / (2 * SMOOTH_S)))

    def strongest_db(self, band: Band) -> float:
        """Highest point of the trace of a band above what noise would reach [dB]; NaN without the band."""
        trace = self.traced(band)
        if trace is None or trace.size == 0:
            return math.nan
        return 10 * math.log10(float(trace.max()) / float(np.median(trace))) - self.noise_peak_db(band)

    def impulses(self, band: Band) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times [s] and heights above what noise would reach [dB] of the impulses of a band."""
        trace = self.traced(band)
        if trace is None or trace.size == 0:
            return np.empty(0), np.empty(0)
        apart = int(IMPULSES_APART_S * HOP_HZ)
        places, heights = envelope.impulses(trace, self.noise_peak_db(band), apart)
        return (places.astype(np.float64) + 0.5) / HOP_HZ, heights

    def folded(self, band: Band) -> Fold | None:
        """The trace of a band folded on the motion; None without a reversal."""
        return self._folds[band]

    @cached_property
    def _folds(self) -> dict[Band, Fold | None]:
        return {
            band: fold(trace, self.motion, self.freedom(band)) if trace is not None else None
            for band, trace in self._traces.items()
        }
