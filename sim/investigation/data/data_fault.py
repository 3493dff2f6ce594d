"""What is wrong with a measurement: a fault that is named and repaired, or an error that ends the investigation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sim.errors import SimulationError


class InvestigationError(SimulationError):
    """The data cannot be investigated; the text says what is wrong and what would be right."""


class TooLittleMotion(InvestigationError):
    """Too few rows in motion count to tell anything of an axis."""


@dataclass(frozen=True)
class Fault:
    """A fault of the measurement itself, found before any physics."""

    mechanism: str
    location: str | None
    parameters: Mapping[str, float]
    explanation: str
