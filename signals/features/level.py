"""Level and crest factor, as recorded and in the paper's band."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from signals import crest
from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition

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
