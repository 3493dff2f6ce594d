"""The catalogue: a mechanism by its name, applied to a description, to telemetry and to sound."""

from __future__ import annotations

from dataclasses import replace

from signals.telemetry import Telemetry
from sim import mechanisms
from sim.description.axis import Axis, MechanismEntry
from sim.errors import AxisError, near_match
from sim.mechanisms.mechanism import Measurement, Mechanics, Mechanism, Samples
from sim.rotational.drive_train import DriveTrain


def kind_of(name: str) -> type[Mechanism]:
    """Raises AxisError for a name that is not in the catalogue."""
    if name not in mechanisms.MECHANISMS:
        raise AxisError(f"mechanisms: no mechanism {name!r}{near_match(name, mechanisms.MECHANISMS)}")
    return mechanisms.MECHANISMS[name]


def is_in_every_axis(name: str) -> bool:
    """Whether every axis has it, and nearly every description leaves it out: friction."""
    return kind_or_any(name).traits.in_every_axis


def kind_or_any(name: str) -> type[Mechanism]:
    """What is known of a name: the class in the catalogue, or `Mechanism` itself, which says what holds of any."""
    return mechanisms.MECHANISMS.get(name, Mechanism)


def mechanism_of(entry: MechanismEntry) -> Mechanism:
    """The mechanism that a table of an axis description means.

    Raises
    ------
    AxisError
        for a name that is not in the catalogue; ParameterError for its parameters.
    """
    return kind_of(entry.name)(entry.location, entry.parameters)


def apply_mechanisms(train: DriveTrain) -> DriveTrain:
    """Apply all effects in the machine that the train's axis description has, in order; `train.axis` stays."""
    for entry in train.axis.mechanisms if train.axis else ():
        mechanism = mechanism_of(entry)
        if isinstance(mechanism, Mechanics):
            train = mechanism.apply(train)
    return train


def distort_telemetry(telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
    """Apply all effects of the measurement that the axis description has."""
    for i, entry in enumerate(axis.mechanisms):
        mechanism = mechanism_of(entry)
        if isinstance(mechanism, Measurement):
            telemetry = mechanism.distort(telemetry, axis, seed + i)
    return telemetry


def distort_sound(samples: Samples, sample_rate_hz: float, axis: Axis, seed: int = 0) -> Samples:
    """Apply all effects of the measurement that the axis description has to a recording."""
    for i, entry in enumerate(axis.mechanisms):
        mechanism = mechanism_of(entry)
        if isinstance(mechanism, Measurement):
            samples = mechanism.distort_sound(samples, sample_rate_hz, seed + i)
    return samples


def with_mechanism(axis: Axis, mechanism: Mechanism) -> Axis:
    """The axis with one more effect. Raises ParameterError where it cannot be there."""
    entry = replace(mechanism.entry(), location=mechanism.placed(axis) or None)
    return replace(axis, mechanisms=(*axis.mechanisms, entry))
