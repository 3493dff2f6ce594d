"""Levels: how loud, how peaked, of which colour, and how much a recording lets hear."""

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from signals import crest
from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.band import Band
from signals.features.vector import FeatureDefinition, FeatureFamily
from signals.motion import fall_over_scatter
from signals.recording_quality.circumstances import louder_after_start_db, low_band_level_db, standstill_db

PAPER = "Olsson and Stolyarchuk, Dynamic Modeling and Sound (Noise) Diagnostics of Robot Gearboxes"
WINDOW_S = 1.0
STEPS_PER_WINDOW = 2


def _level(name: str, what: str) -> FeatureDefinition:
    return FeatureDefinition(name, "unit of the samples", what, "definition; IEC 60050-103", compared=False)


def _typical(statistic: Callable[[NDArray[np.float32]], float], cycles: Sequence[NDArray[np.float32]]) -> float:
    """Return the median over cycles."""
    return float(np.median([statistic(each) for each in cycles]))


class Level(FeatureFamily):
    """RMS, peak, crest factor, kurtosis; what follows the gain, or counts standstill in, is shown and not compared."""

    definitions = (
        _level("rms", "Effective value of the record; crest factor means little without it."),
        _level("peak", "Largest magnitude of the record (detector 0-pk)."),
        _level("rms_low_pass_200_hz", "Effective value below 200 Hz, where the paper listens."),
        _level("peak_low_pass_200_hz", "Largest magnitude below 200 Hz (detector 0-pk)."),
        FeatureDefinition(
            "crest_factor_whole_record",
            "1",
            "Impacts raise the peak before they raise the effective value; a knock at standstill does so, too.",
            f"{PAPER}, equation (1)",
            compared=False,
        ),
        FeatureDefinition(
            "crest_factor_low_pass_200_hz_whole_record",
            "1",
            "Impacts of meshing teeth that shake the whole arm lie below 200 Hz; those at standstill count, too.",
            f"{PAPER}, equation (1) after the low-pass",
            compared=False,
        ),
        FeatureDefinition(
            "crest_factor_median_of_cycles",
            "1",
            "Impacts raise the peak before they raise the effective value; of the typical cycle while the axis moves, "
            "so that one knock does not count.",
            f"{PAPER}, equation (1)",
        ),
        FeatureDefinition(
            "crest_factor_low_pass_200_hz_median_of_cycles",
            "1",
            "Impacts of meshing teeth that shake the whole arm lie below 200 Hz; of the typical cycle while the axis "
            "moves.",
            f"{PAPER}, equation (1) after the low-pass",
        ),
        FeatureDefinition(
            "crest_factor_low_pass_200_hz_mean_of_1_s_windows",
            "1",
            "Averaged over windows of 1 s while the axis moves, one knock says little and a knock every second much.",
            f"{PAPER}, equation (2)",
        ),
        FeatureDefinition(
            "kurtosis_low_pass_200_hz",
            "1",
            "Fourth moment over squared variance of the typical cycle while the axis moves: 3 for noise, more where "
            "few large values are.",
            "Pearson 1905; Dyer and Stewart 1978 for bearings",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return level, peak, crest factors and kurtosis."""
        whole = analysis.kept(analysis.samples, ANALYSIS_RATE_HZ)
        low = analysis.kept(analysis.low_passed, ANALYSIS_RATE_HZ)
        window = int(WINDOW_S * ANALYSIS_RATE_HZ)
        mean = math.nan
        cycles = analysis.cycles(analysis.low_passed, ANALYSIS_RATE_HZ)
        moving = np.concatenate(cycles)
        if moving.size >= window:
            trace = crest.crest_factor_trace(moving, window, window // STEPS_PER_WINDOW)
            trace = trace[np.isfinite(trace)]
            if trace.size:
                mean = float(trace.mean(dtype=np.float64))
        return (
            crest.root_mean_square(whole),
            crest.peak(whole),
            crest.root_mean_square(low),
            crest.peak(low),
            crest.crest_factor(whole),
            crest.crest_factor(low),
            _typical(crest.crest_factor, analysis.cycles(analysis.samples, ANALYSIS_RATE_HZ)),
            _typical(crest.crest_factor, cycles),
            mean,
            _typical(crest.kurtosis, cycles),
        )


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


LARGEST_FALL = 1e3


class Loudness(FeatureFamily):
    """How clearly the loudness falls between motion and standstill; there for every recording, whatever it is of."""

    of_the_gear = False
    definitions = (
        FeatureDefinition(
            "loudness_fall_over_scatter",
            "1",
            "How much quieter it is at standstill than in motion, over how much the loudness scatters anyway: the "
            "sound of a gear grows with its speed, a hiss or a fan does not care, and speech has no plateau.",
            "70th less 2nd percentile of the level above 200 Hz over 80 ms; signals.motion",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return the fall over the scatter."""
        return [min(fall_over_scatter(analysis.loudness_db), LARGEST_FALL)]


MOST_CYCLES = 100.0


def _definition(name: str, unit: str, physics: str) -> FeatureDefinition:
    return FeatureDefinition(name, unit, physics, "definition; signals.recording_quality.circumstances", compared=False)


class Circumstances(FeatureFamily):
    """How many cycles are left, how much of the sound is the machine's, and what the recorder did to it."""

    of_the_gear = False
    definitions = (
        _definition("cycles_left", "1", "Cycles of the motion that are left when what is not the machine is left out."),
        _definition("share_left_out", "1", "Share of the piece of motion that is left out as none of the machine."),
        _definition(
            "standstill_fall_above_200_hz",
            "dB",
            "How much quieter it is at standstill than on the way; what is left at standstill is noise of the "
            "surroundings, under which a fault may hide.",
        ),
        _definition(
            "noise_on_the_way_12_200_hz",
            "dB",
            "Level of the band on the way against what the machine itself sounds like above 200 Hz: under how much low "
            "noise an impact may hide, whatever the gain.",
        ),
        _definition(
            "unrepeated_share_12_200_hz",
            "1",
            "Share of the time in which the band is more than twice or less than half as loud as in other cycles.",
        ),
        _definition("unrepeated_share_above_200_hz", "1", "The same above 200 Hz, in the worse of two bands."),
        _definition(
            "louder_after_start",
            "dB",
            "How much louder the sound is just after a start than before braking: a recorder that turns up its gain "
            "at standstill does that.",
        ),
        _definition(
            "low_band_level",
            "dB",
            "Level per hertz of 30 to 120 Hz against 250 to 500 Hz: what telephones and voice recorders filter away.",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return all of them; 0 where there is no motion, never NaN."""
        period_s = analysis.motion.period_s
        left_out = sum(span.duration_s for span in analysis.left_out)
        kept_s = max(0.0, analysis.duration_s - left_out)
        share = {} if analysis.unrepeated is None else analysis.unrepeated.share
        return [
            min(kept_s / period_s, MOST_CYCLES) if period_s else 0.0,
            min(1.0, left_out / analysis.duration_s),
            *standstill_db(analysis),
            share.get(Band.LOW, 0.0),
            max(share.get(Band.MIDDLE, 0.0), share.get(Band.HIGH, 0.0)),
            louder_after_start_db(analysis),
            low_band_level_db(analysis),
        ]
