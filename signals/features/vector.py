"""The nouns of feature extraction: definition, family, vector, extraction."""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from signals.analysis import Analysis
from signals.events import Event
from signals.motion import Motion
from signals.recording_quality.quality import FlagLevel, QualityFlag

IMPACTS = {
    "play_bump": "impacts at the reversal",
    "notch_bump": "impacts in one direction",
    "standstill_bump": "impacts at standstill",
    "both_directions_bump": "impacts in both directions",
    "strongest_impulse": "strongest impact of a cycle",
}
"""What people call some features, by the beginning of a name."""


def feature_words(name: str) -> str:
    """Return the name of a feature as words, with the units of its numbers.

    >>> feature_words("notch_bump_12_200_hz")
    'impacts in one direction, 12 to 200 Hz'
    >>> feature_words("crest_factor_low_pass_200_hz_mean_of_1_s_windows")
    'crest factor below 200 Hz, mean of 1 s windows'
    """
    text = next((name.replace(part, words) for part, words in IMPACTS.items() if part in name), name)
    text = text.replace("_low_pass_200_hz", " below 200 Hz").replace("_whole_record", ", whole record")
    text = re.sub(r"_(mean|median)_of_", r", \1 of ", text)
    return re.sub(r"_(\d+)_(\d+)_hz$", r", \1 to \2 Hz", text).replace("_", " ")


@dataclass(frozen=True)
class FeatureDefinition:
    """One entry of the catalogue: what a feature is.

    Args:
        name: unique name; windows and bands stand in it.
        unit: UCUM code; "1" for ratios, "dB" for levels.
        physics: one sentence on what it tells.
        source: where the formula comes from.
        compared: False for what follows the gain or the recorder, and so must not enter a distance.
    """

    name: str
    unit: str
    physics: str
    source: str
    compared: bool = True


@dataclass(frozen=True, eq=False)
class FeatureVector:
    """Feature values by name; NaN where a feature is not computable for this recording.

    Args:
        names: in the order of the catalogue, shape (n,).
        values: shape (n,), float32.
    """

    names: tuple[str, ...]
    values: NDArray[np.float32]

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.names.index(name)])

    def to_dict(self) -> dict[str, float | None]:
        """Return values by name for JSON: None instead of NaN."""
        return {
            name: None if math.isnan(value) else value
            for name, value in zip(self.names, self.values.tolist(), strict=True)
        }


@dataclass(frozen=True, eq=False)
class Extraction:
    """All that is taken from one recording.

    Args:
        features: the vector, in the order of the catalogue.
        quality: what weakens it.
        motion: the back and forth that was given or found.
        events: in order of time.
        extractor_version: `EXTRACTOR_VERSION` at the time.
    """

    features: FeatureVector
    quality: tuple[QualityFlag, ...]
    motion: Motion
    events: tuple[Event, ...]
    extractor_version: str

    @property
    def unusable_reason(self) -> str | None:
        """Why the recording cannot be diagnosed; None if it can."""
        reasons = [flag.reason for flag in self.quality if flag.severity is FlagLevel.UNUSABLE]
        return "; ".join(reasons) or None

    @property
    def poor(self) -> bool:
        """Whether no label may be said with confidence."""
        return any(flag.severity is not FlagLevel.NOTE for flag in self.quality)

    @property
    def usable(self) -> bool:
        """Whether the recording can be diagnosed, if poorly."""
        return self.unusable_reason is None


class FeatureFamily(ABC):
    """Features that share their computation; one subclass per file."""

    definitions: ClassVar[tuple[FeatureDefinition, ...]]
    of_the_gear: ClassVar[bool] = True
    """Whether they may say that a gear is unlike any good one; not where they tell of housing and microphone, of one
    axis alone, or of how well one hears."""

    @abstractmethod
    def compute(self, analysis: Analysis) -> Sequence[float]:
        """Return one value per definition, NaN where it cannot be computed."""
