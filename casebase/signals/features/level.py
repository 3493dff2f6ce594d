"""Level and crest factor, as recorded and in the paper's band."""

import math
from collections.abc import Sequence

import numpy as np

from casebase.signals import crest
from casebase.signals.analysis import ANALYSIS_RATE_HZ, Analysis
from casebase.signals.features.family import FeatureFamily
from casebase.signals.features.vector import FeatureDefinition

PAPER = "Olsson and Stolyarchuk, Dynamic Modeling and Sound (Noise) Diagnostics of Robot Gearboxes"
WINDOW_S = 1.0
STEPS_PER_WINDOW = 2


def _level(name: str, what: str) -> FeatureDefinition:
    return FeatureDefinition(name, "unit of the samples", what, "definition; IEC 60050-103", compared=False)


class Level(FeatureFamily):
    """RMS, peak, crest factor and kurtosis; the first two are shown, not compared, for they follow the gain."""

    definitions = (
        _level("rms", "Effective value of the record; crest factor means little without it."),
        _level("peak", "Largest magnitude of the record (detector 0-pk)."),
        _level("rms_low_pass_200_hz", "Effective value below 200 Hz, where the paper listens."),
        _level("peak_low_pass_200_hz", "Largest magnitude below 200 Hz (detector 0-pk)."),
        FeatureDefinition(
            "crest_factor_whole_record",
            "1",
            "Impacts raise the peak before they raise the effective value.",
            f"{PAPER}, equation (1)",
        ),
        FeatureDefinition(
            "crest_factor_low_pass_200_hz_whole_record",
            "1",
            "Impacts of meshing teeth that shake the whole arm lie below 200 Hz.",
            f"{PAPER}, equation (1) after the low-pass",
        ),
        FeatureDefinition(
            "crest_factor_low_pass_200_hz_mean_of_1_s_windows",
            "1",
            "Averaged over windows of 1 s while the axis moves, one knock says little and a knock every second much.",
            f"{PAPER}, equation (2)",
        ),
        FeatureDefinition(
            "crest_factor_low_pass_200_hz_largest_of_1_s_windows",
            "1",
            "The window of 1 s with the hardest single impact for its own level, while the axis moves.",
            f"{PAPER}, equation (2)",
        ),
        FeatureDefinition(
            "kurtosis_low_pass_200_hz",
            "1",
            "Fourth moment over squared variance while the axis moves: 3 for noise, more where few large values are.",
            "Pearson 1905; Dyer and Stewart 1978 for bearings",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return level, peak, crest factors and kurtosis."""
        whole = analysis.kept(analysis.samples, ANALYSIS_RATE_HZ)
        low = analysis.kept(analysis.low_passed, ANALYSIS_RATE_HZ)
        window = int(WINDOW_S * ANALYSIS_RATE_HZ)
        mean = largest = math.nan
        moving = analysis.on_the_way(analysis.low_passed, ANALYSIS_RATE_HZ)
        if moving.size >= window:
            trace = crest.crest_factor_trace(moving, window, window // STEPS_PER_WINDOW)
            trace = trace[np.isfinite(trace)]
            if trace.size:
                mean, largest = float(trace.mean(dtype=np.float64)), float(trace.max())
        return (
            crest.root_mean_square(whole),
            crest.peak(whole),
            crest.root_mean_square(low),
            crest.peak(low),
            crest.crest_factor(whole),
            crest.crest_factor(low),
            mean,
            largest,
            crest.kurtosis(moving),
        )
