"""How the loudness follows the motion: what tells a recording of a moving axis from any other sound."""

from collections.abc import Sequence

from signals.analysis import Analysis
from signals.features.family import FeatureFamily
from signals.features.vector import FeatureDefinition
from signals.motion import fall_over_scatter

LARGEST = 1e3


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
        return [min(fall_over_scatter(analysis.loudness_db), LARGEST)]
