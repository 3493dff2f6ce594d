"""Impacts: what strikes once a stroke, and how strongly, wherever in the cycle it falls."""

import math
from collections.abc import Sequence

import numpy as np

from signals import envelope
from signals.analysis import Analysis
from signals.band import Band
from signals.features.vector import FeatureDefinition, FeatureFamily
from signals.half_cycles import TOLERANCE
from signals.motion import HOP_HZ
from signals.spectra import BandEnvelope

OF_BUMPS = "synchronous averaging (McFadden 1986) on strokes, with a median; height over noise: signals.half_cycles"
SENTENCES = {
    "play_bump": "Highest impact that both directions have while braking or starting: backlash is crossed when the "
    "torque reverses, which is where braking starts, some tenths of a second before the standstill.",
    "standstill_bump": "Highest impact that both directions have while the axis hardly moves: backlash at the new "
    "start, but a healthy gear clicks faintly here, too.",
    "both_directions_bump": "Highest impact that both directions have away from the reversal: an obstacle that is "
    "met either way, or noise.",
    "notch_bump": "Highest impact that one direction has alone, where the axis moves: a damaged tooth meets the mesh "
    "at one angle and on one flank, and never where no tooth moves.",
}


class Repetition(FeatureFamily):
    """Bumps in the folded envelope of three bands, and how the envelope repeats after a cycle and half a cycle."""

    definitions = (
        *(
            FeatureDefinition(f"{name}_{band.label}", "dB", sentence, OF_BUMPS)
            for band in Band
            for name, sentence in SENTENCES.items()
        ),
        FeatureDefinition(
            "repetition_after_full_cycle_12_200_hz",
            "1",
            "Correlation of the envelope with itself one cycle later: high for whatever belongs to the motion.",
            "autocorrelation",
        ),
        FeatureDefinition(
            "repetition_after_half_cycle_12_200_hz",
            "1",
            "Correlation of the envelope with itself one stroke later: high for what both directions have: backlash.",
            "autocorrelation",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return the bumps of every band; NaN without a known reversal."""
        bumps = [height for band in Band for height in self._bumps(analysis, band)]
        trace, period_s = analysis.traced(Band.LOW), analysis.motion.period_s
        if trace is None or period_s is None:
            return [*bumps, math.nan, math.nan]
        stroke = round(period_s * HOP_HZ / 2)
        tolerance = 2 * TOLERANCE
        return [
            *bumps,
            envelope.repetition(trace, 2 * stroke, tolerance),
            envelope.repetition(trace, stroke, tolerance),
        ]

    @staticmethod
    def _bumps(analysis: Analysis, band: Band) -> tuple[float, float, float, float]:
        folded = analysis.folded(band)
        if folded is None:
            return (math.nan,) * 4
        near, quiet = folded.in_zone, folded.in_quiet
        return (
            _highest(folded.both_db[near & ~quiet]),
            _highest(folded.both_db[quiet]),
            _highest(folded.both_db[~near]),
            _highest(folded.asymmetry_db[~quiet]),
        )


def _highest(heights: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    known = heights[np.isfinite(heights)]
    return float(known.max()) if known.size else math.nan


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
                    "extreme value of chi-squared noise; signals.half_cycles.noise_peak_db",
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
            "extreme value of chi-squared noise; signals.half_cycles.noise_peak_db",
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
