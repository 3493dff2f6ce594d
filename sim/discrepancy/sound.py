"""What the sound says: orders of bearings, fixed frequencies, hum, clipping."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from casebase.signals.recording import Recording
from sim.axis import Axis
from sim.discrepancy.measurement import Measurement


@dataclass(frozen=True)
class Heard:
    """A finding from sound; `parameters`: name to value, low, high."""

    mechanism: str
    location: str | None
    probability: float
    parameters: Mapping[str, tuple[float, float, float]]
    explanation: str


def listen(axis: Axis, sound: Recording, measurement: Measurement | None, offset_s: float) -> tuple[Heard, ...]:
    return ()
