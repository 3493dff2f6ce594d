"""What a mechanism is: an effect that the plain axis lacks, as a pure map of a drive train or of a measurement.

One class per file in `sim.mechanisms`, one line in its catalogue `MECHANISMS`. A class says what it is as data
(parameters with ranges, equations, source, the signature it leaves); an instance has a place and numbers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from signals.telemetry import Telemetry
from sim.description.axis import Axis, MechanismEntry
from sim.errors import ParameterError, near_match
from sim.mechanisms.differing import Differing
from sim.mechanisms.heard import Heard
from sim.mechanisms.places import axis_of
from sim.mechanisms.traits import Traits
from sim.rotational.drive_train import DriveTrain

Samples = NDArray[np.float32]

SECURED = "Lock out the drive and support the load (it may drop when the brake is released), then"
"""How every step begins in which somebody moves a machine by hand or opens it."""


class Need(Enum):
    """What a record has to have for a mechanism to be told from others: its value is what to record."""

    BOTH_DIRECTIONS = "motion in both directions"
    SEVERAL_SPEEDS = "motion at several speeds"
    HALF_TURN = "half a turn of its shaft"
    LOAD_TURN = "a twelfth of a turn of the load"
    LOAD_ENCODER = "an encoder at the load"
    TWO_ROWS_PER_TOOTH = "two rows for each tooth that passes"
    TWO_ROWS_PER_PERIOD = "more than two rows in a period of the mains"


@dataclass(frozen=True)
class Parameter:
    """One number of a mechanism: its unit, the range in which it makes sense, its default; an angle is periodic."""

    name: str
    unit: str
    low: float
    high: float
    default: float
    periodic: bool = False
    choices: tuple[float, ...] = ()
    shown: bool = True  # to a reader, to whom a phase of one record says nothing


@dataclass(frozen=True)
class Signature:
    """How an effect shows in a measurement.

    Parameters
    ----------
    domain
        What it repeats with, or hangs on. What repeats in time ("frequency") says how often by its parameter in Hz.
    order
        Per revolution of the shaft at its location: a number, `mesh` for the number of teeth, or a parameter's name.
    per_cycle
        How often in one motion back and forth.
    flank
        Whether it acts on one flank of the teeth only.
    direction
        Whether it differs by direction of motion, or comes where the motion turns.
    grows_with
        What makes it larger.
    of_input_shaft
        Whether the order is that of the shaft that drives the gear at its location.
    """

    domain: Literal["angle", "speed", "torque", "twist", "time", "reversal", "frequency", "recording"]
    order: float | str | None = None
    per_cycle: int | None = None
    flank: Literal["one", "both"] = "both"
    direction: Literal["same", "opposite", "one", "reversal"] = "same"
    grows_with: Literal["nothing", "load", "speed", "time", "twist"] = "nothing"
    of_input_shaft: bool = False


@dataclass(frozen=True)
class Mechanism(ABC):
    """One effect at one place with its numbers; parameters that are not given have their defaults.

    Raises
    ------
    ParameterError
        for an unknown parameter, one that is not finite or out of its range, or a place where it cannot be.

    >>> from sim.mechanisms import Backlash
    >>> Backlash("output", {"gap_rad": 0.001})["gap_rad"]
    0.001
    >>> Backlash("output", {"gap_rad": 5})
    Traceback (most recent call last):
    sim.errors.ParameterError: backlash.gap_rad: must be 0 to 0.1 rad, got 5
    """

    location: str | None = None
    values: Mapping[str, float] = field(default_factory=dict)

    name: ClassVar[str]
    kind: ClassVar[Literal["mechanics", "measurement"]] = "mechanics"
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    workshop_name: ClassVar[str] = ""
    """What a workshop calls it, where that is another word."""
    damage: ClassVar[str] = ""
    """Which damage of teeth can make it, by the names of ISO 10825-1; nothing where none does."""
    size: ClassVar[str]
    """The parameter of which 0 means that the effect is not there."""
    needs: ClassVar[frozenset[Need]] = frozenset()
    """Without one of these it is the same in a record as all others that need it."""
    shown_by: ClassVar[frozenset[Need]] = frozenset()
    """Without one of these it cannot be seen at all."""
    signature: ClassVar[Signature]
    equations: ClassVar[str]
    source: ClassVar[str]
    sentence: ClassVar[str] = ""
    """What a finding says, with its numbers in braces; without it, the first line of the docstring and the numbers."""
    action: ClassVar[str] = "Look at the place named here, but change no parts because of it alone."
    """What to do now about a finding."""
    urgent: ClassVar[bool] = False
    """Whether it is damage that grows, so that there is a day by which to act."""
    check: ClassVar[str] = (
        "Repeat the same motion at half the speed and in both directions: what stays the same does not come from the "
        "motion."
    )
    """The measurement that tells it from what looks like it."""
    differs: ClassVar[frozenset[Differing]] = frozenset()
    """Measurements in which it differs from what looks like it."""
    behind_the_motor: ClassVar[bool] = False
    """Whether an encoder at the load tells more of it."""
    of_links: ClassVar[bool] = False
    """Whether an axis that moves as one body has none of it."""
    of_unknown_teeth: ClassVar[bool] = False
    """Whether it is looked for only in gears of which the ratio alone is described."""
    unseen_at: ClassVar[frozenset[str]] = frozenset()
    """Places where telemetry does not show it."""
    own_hypothesis: ClassVar[bool] = False
    """Whether an investigation looks for it in a way of its own, and not by what this class says."""
    beside_the_chain: ClassVar[bool] = False
    """Whether an investigation that finds it described has it in the load's own motion or in the measurement."""
    of_the_recording: ClassVar[bool] = False
    """Whether it is of one recording, and another of the same axis knows nothing of it."""
    or_of_the_machine: ClassVar[str | None] = None
    """Of a fault of the measurement: what in the machine has the same data, in words."""
    told_by: ClassVar[str | None] = None
    """The parameter that tells one from another at the same place."""
    checked: ClassVar[tuple[str, str] | None] = None
    """What a recording is checked for before any physics, and what is said where it has none of it."""
    heard: ClassVar[Heard | None] = None
    """What is said of it where sound alone can show it."""
    traits: ClassVar[Traits] = Traits()
    """How an investigation weighs it."""

    def __post_init__(self) -> None:
        known = {parameter.name: parameter for parameter in self.parameters}
        for key in self.values:
            if key not in known:
                raise ParameterError(f"{self.name}.{key}: unknown parameter{near_match(key, known)}")
        full = {name: self._checked(one, self.values.get(name, one.default)) for name, one in known.items()}
        object.__setattr__(self, "values", MappingProxyType(full))

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.location, dict(self.values))

    def __hash__(self) -> int:
        return hash((self.name, self.location, tuple(self.values.items())))

    @classmethod
    @abstractmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        """Where it can act on an axis; the first is meant when no place is given. None: the axis as a whole."""

    @classmethod
    def sizes(cls) -> tuple[str, ...]:
        """Parameters of which one at least is not 0 where the effect is there."""
        return (cls.size,)

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        """Size that a new axis has at most, by its description."""
        return 0.0

    @classmethod
    def looks_like(cls, axis: Axis, location: str | None, load_encoder: bool) -> tuple[str, ...]:
        """Mechanisms that no measurement of motor and load tells from it; `load_encoder`: whether there is one."""
        return ()

    def placed(self, axis: Axis) -> str:
        """Return the place where it acts, the default where none was given."""
        possible = self.locations(axis)
        if not possible:
            raise ParameterError(f"{self.name}: has no place on axis {axis.name!r}")
        if self.location is None:
            return possible[0] or ""
        if self.location not in possible:
            names = ", ".join(str(place) for place in possible if place)
            raise ParameterError(f"{self.name}.location: must be one of {names or 'none'}, got {self.location!r}")
        return self.location

    def entry(self) -> MechanismEntry:
        """The table of an axis description that says this."""
        return MechanismEntry(self.name, self.location, dict(self.values))

    def _checked(self, parameter: Parameter, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ParameterError(f"{self.name}.{parameter.name}: must be a finite number, got {value!r}")
        if parameter.choices and value not in parameter.choices:
            choices = " or ".join(f"{choice:g}" for choice in parameter.choices)
            raise ParameterError(f"{self.name}.{parameter.name}: must be {choices}, got {value:g}")
        if not (parameter.periodic or parameter.low <= value <= parameter.high):
            raise ParameterError(
                f"{self.name}.{parameter.name}: must be {parameter.low:g} to {parameter.high:g} {parameter.unit}, "
                f"got {value:g}"
            )
        return float(value)


class Mechanics(Mechanism):
    """An effect in the machine."""

    def apply(self, train: DriveTrain) -> DriveTrain:
        """Return the train with the effect; `train.axis` says what stands where."""
        place = self.placed(axis_of(train))
        return self.act(train, place) if any(self[size] for size in self.sizes()) else train

    @abstractmethod
    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        """Return the train with an effect that is not 0 at a place, an empty one where it is of the whole axis."""


class Measurement(Mechanism):
    """An effect of the measurement itself: the machine is not touched."""

    kind: ClassVar[Literal["mechanics", "measurement"]] = "measurement"

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        """Return the telemetry as it would have been measured."""
        return telemetry

    def distort_sound(self, samples: Samples, sample_rate_hz: float, seed: int = 0) -> Samples:
        """Return the recording as it would have been taken."""
        return samples
