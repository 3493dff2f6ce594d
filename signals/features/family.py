"""FeatureFamily: features that are computed together."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from signals.analysis import Analysis
from signals.features.vector import FeatureDefinition


class FeatureFamily(ABC):
    """Features that share their computation; one subclass per file."""

    definitions: ClassVar[tuple[FeatureDefinition, ...]]
    of_the_gear: ClassVar[bool] = True
    """Whether they may say that a gear is unlike any good one; not where they tell of housing and microphone, of one
    axis alone, or of how well one hears."""

    @abstractmethod
    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return one value per definition, NaN where it cannot be computed."""
