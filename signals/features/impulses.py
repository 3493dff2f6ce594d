"""Impulses of the typical cycle, wherever in it they fall."""

import math
from collections.abc import Sequence

import numpy as np

from signals import envelope
from signals.analysis import Analysis
from signals.band import Band
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition
from signals.spectra import BandEnvelope


class Impulses(FeatureFamily):
    """Strongest impulse and peakedness of three bands, and how many impulses there are in the lowest."""

    definitions = (
        *(
            definition
            for band in Band
            for definition in (
                FeatureDefinition(
                    f"strongest_impulse_{band.label}",
                    "dB",
                    "Highest point of the envelope in the typical cycle above what noise would reach in it: a "
                    "knock that every second cycle has counts, wherever it falls; a single one does not.",
                    "extreme value of chi-squared noise; signals.synchronous_average.noise_peak_db",
                ),
                FeatureDefinition(
                    f"spectral_kurtosis_{band.label}",
                    "dB",
                    "Peakedness of the band against Gaussian noise in the typical cycle: strong events raise it, "
                    "steady noise of any colour leaves it at 0.",
                    "Antoni 2006, equation (6)",
                ),
            )
        ),
        FeatureDefinition(
            "impulse_rate_12_200_hz",
            "Hz",
            "Impulses per second above what noise would reach.",
            "extreme value of chi-squared noise; signals.synchronous_average.noise_peak_db",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return strongest impulse and spectral kurtosis per band, then the rate."""
        values: list[float] = []
        for band in Band:
            band_envelope = analysis.envelope(band)
            values.append(analysis.strongest_db(band))
            values.append(math.nan if band_envelope is None else self._kurtosis(analysis, band_envelope))
        times = analysis.impulses(Band.LOW)[0]
        return [*values, len(times) / analysis.duration_s]

    @staticmethod
    def _kurtosis(analysis: Analysis, band: BandEnvelope) -> float:
        cycles = analysis.cycles(band.inside(), band.rate_hz)
        return float(np.median([envelope.spectral_kurtosis_db(each) for each in cycles]))
