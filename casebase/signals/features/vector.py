"""The nouns of feature extraction: definitions, vectors, events, motion, the extraction as a whole."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FeatureDefinition:
    """One entry of the catalogue: what a feature is.

    Args:
        name: unique name; windows and bands stand in it.
        unit: UCUM code; "1" for ratios, "dB" for levels.
        physics: one sentence on what it tells.
        source: where the formula comes from.
    """

    name: str
    unit: str
    physics: str
    source: str


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


class Severity(StrEnum):
    """How much a quality flag matters."""

    NOTE = "note"
    POOR = "poor"
    UNUSABLE = "unusable"


@dataclass(frozen=True)
class QualityFlag:
    """Something about the recording that weakens what can be said.

    Args:
        name: clipped, dropouts, dc_offset, too_quiet, too_short_for_motion, bandwidth_too_low,
            unsteady_hum or default_channel.
        severity: note, poor (diagnosed nevertheless) or unusable.
        reason: one sentence with numbers, and what would be right.
    """

    name: str
    severity: Severity
    reason: str


class MotionSource(StrEnum):
    """Where the knowledge of the motion comes from."""

    GIVEN = "given"
    SOUND = "sound"
    NONE = "none"


@dataclass(frozen=True)
class Motion:
    """Back and forth of the axis.

    Args:
        period_s: one full cycle of back and forth [s]; None if there is none to be found.
        reversal_times_s: standstills from the start of the recording, ascending [s].
        source: given with the recording, or found in the sound.
        cycles: how many periods the recording covers.
        confidence: from 0 to 1, the share of the loudness that repeats with the period.
    """

    period_s: float | None
    reversal_times_s: tuple[float, ...]
    source: MotionSource
    cycles: float = 0.0
    confidence: float = 0.0


class EventKind(StrEnum):
    """What an event in the sound is."""

    IMPULSE = "impulse"
    REVERSAL = "reversal"
    NOTCH = "notch"
    PLAY = "play"


@dataclass(frozen=True)
class Event:
    """Something that happens at one time.

    Args:
        time_s: from the start of the recording [s].
        kind: what it is; notch and play mark where the bumps of these features lie.
        strength: height above the background [dB]; 0 for a reversal.
    """

    time_s: float
    kind: EventKind
    strength: float = 0.0


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
        reasons = [flag.reason for flag in self.quality if flag.severity is Severity.UNUSABLE]
        return "; ".join(reasons) or None

    @property
    def usable(self) -> bool:
        """Whether the recording can be diagnosed, if poorly."""
        return self.unusable_reason is None
