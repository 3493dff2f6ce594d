"""What hypotheses of periodic effects share: a cosine and a sine, and the amplitude of both."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sim.investigation.hypotheses.hypothesis import Report
from sim.investigation.model.parameters import Parameter, Values

ENCODER_ERROR = ("load_encoder.error_sine_rad", "load_encoder.error_cosine_rad")
AS_NEW_FACTOR = 3.0  # more than this above as new is a finding


def parameter_key(mechanism: str, location: str | None, parameter: str) -> str:
    """How a parameter of a mechanism at its place is called."""
    return f"{mechanism}@{location}.{parameter}"


def cosine_and_sine(prefix: str, step: float, unit: str) -> tuple[Parameter, Parameter]:
    """Both parameters of an oscillation of which neither size nor phase is known, at none of it."""
    return Parameter(f"{prefix}.sine", 0.0, step, unit=unit), Parameter(f"{prefix}.cosine", 0.0, step, unit=unit)


def cosine_and_sine_probe(prefix: str, step: float) -> tuple[tuple[Mapping[str, float], ...], ...]:
    """The step by which such an oscillation is tried; its phase follows from the fit."""
    return (({f"{prefix}.sine": step}, {f"{prefix}.cosine": step}),)


def amplitude(pair: Sequence[Parameter], name: str, phase: str) -> Report:
    """A report of size and phase [rad] from both parameters."""
    sine, cosine = (p.name for p in pair)

    def report(values: Values) -> dict[str, float]:
        return {name: math.hypot(values[sine], values[cosine]), phase: math.atan2(values[cosine], values[sine])}

    return report
