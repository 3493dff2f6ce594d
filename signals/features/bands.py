"""Log band energies: the colour of the sound, without its level."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from signals.analysis import Analysis
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition

EDGES_HZ = tuple(16.0 * 2 ** (k / 2) for k in range(16))
"""Edges of half-octave bands from 16 Hz to 2.9 kHz [Hz]."""

BANDS_HZ = (*itertools.pairwise(EDGES_HZ), (EDGES_HZ[-1], 3800.0))


class LogBandEnergies(FeatureFamily):
    """Energy per half-octave band over the mean of all bands, in decibel."""

    of_the_gear = False
    definitions = tuple(
        FeatureDefinition(
            f"band_level_{low:.0f}_{high:.0f}_hz",
            "dB",
            f"Share of {low:.0f} to {high:.0f} Hz in the sound, against the mean of all bands: where mesh and "
            "housing put their energy, whatever the gain.",
            "centred log-ratio of band energies; Aitchison 1986",
        )
        for low, high in BANDS_HZ
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return the level of each band; NaN where the recording has no such frequencies."""
        levels = np.array([self._level_db(analysis, low, high) for low, high in BANDS_HZ])
        known = np.isfinite(levels)
        if not known.any():
            return [math.nan] * len(BANDS_HZ)
        return [float(level) for level in levels - levels[known].mean()]

    @staticmethod
    def _level_db(analysis: Analysis, low_hz: float, high_hz: float) -> float:
        if high_hz > analysis.highest_hz or low_hz * analysis.duration_s < 1:
            return math.nan
        power = analysis.spectrum.band_power(low_hz, high_hz)
        return 10 * math.log10(power) if power > 0 else math.nan
