"""Features: an explicit catalogue of families, and `extract` that runs them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from signals.analysis import Analysis
from signals.condition import UNKNOWN, OperatingCondition
from signals.errors import BrokenAudioError
from signals.events import Event, EventKind, find_events
from signals.features.impacts import Impulses, Repetition
from signals.features.levels import Circumstances, Level, LogBandEnergies, Loudness
from signals.features.lines import EnvelopeLines, Meshing, Modulation
from signals.features.vector import Extraction, FeatureDefinition, FeatureFamily, FeatureVector, feature_words
from signals.motion import Motion, MotionSource
from signals.recording import SHORTEST_S, Recording
from signals.recording_quality.disturbances import flags, survey
from signals.recording_quality.quality import FlagLevel, QualityFlag

__all__ = [
    "EXTRACTOR_VERSION",
    "FEATURES",
    "Event",
    "EventKind",
    "Extraction",
    "FeatureDefinition",
    "FeatureFamily",
    "FeatureVector",
    "FlagLevel",
    "Motion",
    "MotionSource",
    "QualityFlag",
    "catalogue",
    "extract",
    "feature_values",
    "feature_words",
]

EXTRACTOR_VERSION = "8"
"""Changes whenever a feature is added, removed or computed differently; vectors of two versions never mix."""

FEATURES: tuple[FeatureFamily, ...] = (
    Level(),
    Repetition(),
    Impulses(),
    LogBandEnergies(),
    Modulation(),
    EnvelopeLines(),
    Meshing(),
    Loudness(),
    Circumstances(),
)
"""The catalogue of feature families; a new family is a class beside its like and a line here."""

NAMES: tuple[str, ...] = tuple(entry.name for family in FEATURES for entry in family.definitions)


def catalogue() -> dict[str, FeatureDefinition]:
    """Return every feature's definition by name, in the order of the vector."""
    return {entry.name: entry for family in FEATURES for entry in family.definitions}


def feature_values(analysis: Analysis) -> NDArray[np.float32]:
    """Return the values of all features in the order of the vector, shape (n,), NaN where missing."""
    return np.array([v for family in FEATURES for v in family.compute(analysis)], dtype=np.float32)


def extract(recording: Recording, condition: OperatingCondition = UNKNOWN) -> Extraction:
    """Return features, quality, motion and events of a recording.

    A poor recording has flags, an unusable one `usable == False` with the reason; neither is an error.

    Raises:
        BrokenAudioError: if the recording is shorter than 50 ms.
    """
    if recording.duration_s < SHORTEST_S:
        raise BrokenAudioError(
            f"the recording lasts {1000 * recording.duration_s:.1f} ms; at least {1000 * SHORTEST_S:g} ms are needed"
        )
    surveyed = survey(recording, condition)
    analysis = surveyed.analysis
    return Extraction(
        FeatureVector(NAMES, feature_values(analysis)),
        flags(surveyed),
        _moved(analysis.motion, surveyed.start_s),
        tuple(replace(event, time_s=event.time_s + surveyed.start_s) for event in find_events(analysis)),
        EXTRACTOR_VERSION,
    )


def _moved(motion: Motion, by_s: float) -> Motion:
    """Return the motion with times from the start of the recording."""
    return replace(motion, reversal_times_s=tuple(time + by_s for time in motion.reversal_times_s)) if by_s else motion
