"""Level and crest factor of the whole record."""

from collections.abc import Sequence

from casebase.signals import crest
from casebase.signals.analysis import Analysis
from casebase.signals.features.family import FeatureFamily
from casebase.signals.features.vector import FeatureDefinition


class Level(FeatureFamily):
    """RMS, peak and crest factor."""

    definitions = (
        FeatureDefinition(
            "crest_factor_whole_record",
            "1",
            "Impacts raise the peak before the effective value.",
            "Olsson and Stolyarchuk, equation (1)",
        ),
    )

    def compute(self, analysis: Analysis) -> Sequence[float]:
        return [crest.crest_factor(analysis.samples)]
