"""Features: an explicit catalogue of families, each one file, and `extract` that runs them."""

import numpy as np

from casebase.signals.analysis import Analysis
from casebase.signals.condition import UNKNOWN, OperatingCondition
from casebase.signals.features.family import FeatureFamily
from casebase.signals.features.level import Level
from casebase.signals.features.vector import (
    Event,
    EventKind,
    Extraction,
    FeatureDefinition,
    FeatureVector,
    Motion,
    MotionSource,
    QualityFlag,
    Severity,
)
from casebase.signals.recording import Recording

__all__ = [
    "EXTRACTOR_VERSION",
    "FEATURES",
    "Event",
    "EventKind",
    "Extraction",
    "FeatureDefinition",
    "FeatureFamily",
    "FeatureVector",
    "Motion",
    "MotionSource",
    "QualityFlag",
    "Severity",
    "catalogue",
    "extract",
]

EXTRACTOR_VERSION = "1"
"""Changes whenever a feature is added, removed or computed differently; vectors of two versions never mix."""

FEATURES: tuple[FeatureFamily, ...] = (Level(),)
"""The catalogue of feature families; a new family is one file and one line here."""

NAMES: tuple[str, ...] = tuple(entry.name for family in FEATURES for entry in family.definitions)


def catalogue() -> dict[str, FeatureDefinition]:
    """Return every feature's definition by name, in the order of the vector."""
    return {entry.name: entry for family in FEATURES for entry in family.definitions}


def extract(recording: Recording, condition: OperatingCondition = UNKNOWN) -> Extraction:
    """Return features, quality, motion and events of a recording.

    A poor recording has flags, an unusable one `usable == False` with the reason; neither is an error.
    """
    analysis = Analysis(recording, condition)
    values = np.array([v for family in FEATURES for v in family.compute(analysis)], dtype=np.float32)
    motion = Motion(None, (), MotionSource.NONE)
    return Extraction(FeatureVector(NAMES, values), (), motion, (), EXTRACTOR_VERSION)
