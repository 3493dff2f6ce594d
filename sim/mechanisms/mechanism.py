"""What a mechanism is: an effect that the plain axis lacks, as a pure map of a drive train or of a measurement.

One class per file in the folders beside this one, one line in the catalogue `MECHANISMS`. A class says what it is as
data (parameters with ranges, the signature it leaves); its docstring has equations and source. An instance has a place
and numbers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from signals.telemetry import Telemetry
from sim.description.axis import Axis, MechanismEntry
from sim.errors import ParameterError, near_match
from sim.mechanisms.locations import axis_of, stage_at
from sim.rotational.drive_train import DriveTrain

Array = NDArray[np.float64]
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
    of_input_shaft
        Whether the order is that of the shaft that drives the gear at its location.
    """

    domain: Literal["angle", "speed", "torque", "twist", "time", "reversal", "frequency", "recording"]
    order: float | str | None = None
    per_cycle: int | None = None
    flank: Literal["one", "both"] = "both"
    direction: Literal["same", "opposite", "one", "reversal"] = "same"
    of_input_shaft: bool = False


LEAST_GAIN = 20.0  # whitened squares, of a mechanism that says nothing else
LEAST_SHARE = 0.0006  # of the squared residual: what the form of a model differs from any real axis
FORM_SHARE = 0.015  # of another's gain: what any law leaves of its form
SIZE_SHARE = 0.08  # of a size, which the form of its law leaves open

UNLIKE = 0.03  # of a joint's friction, in both directions: published offsets of six joints of one arm are 0.4 to 5.6 %
WARMED = 0.05  # of a joint's friction, within a log: 6 and 10 % at two joints of that arm within 20 s


class Law(Enum):
    """Laws of one part of the machine: of two that follow it, each leaves its errors of form to the other.

    `share`: of another's gain, below which one is the error of its form.
    """

    SPRING = "torque over twist", 0.1
    FRICTION = "torque over speed and load", 0.35
    DISSIPATION = "torque against the motion", 0.1
    OFFSET = "torque that differs at rest alone", 0.1
    RIPPLE_OF_TEETH = "torque once per tooth", 0.05
    FLANKS = "contact of single teeth or of all", 0.05
    RUNOUT_OR_DENT = "once per turn of a gear, in contact", 0.05
    RUNOUT_OR_RIPPLE = "once per turn; an error of teeth also varies the ratio of the torques", 0.1

    @property
    def share(self) -> float:
        return self.value[1]


@dataclass(frozen=True)
class Traits:
    """What an investigation knows of a mechanism beforehand; the defaults hold for one of which nothing more is known.

    It reads these and never a name. The numbers were set on simulated axes with and without the mechanism.

    Parameters
    ----------
    own_hypothesis
        It is looked for in a way of its own, and not by what its class says.
    urgent
        Damage that grows, so that there is a day by which to act.
    behind_the_motor
        An encoder at the load tells more of it.
    of_links
        An axis that moves as one body has none of it.
    of_unknown_teeth
        It is looked for only in gears of which the ratio alone is described.
    unseen_at
        Places where telemetry does not show it.
    beside_the_chain
        Where it is described, it is in the load's own motion or in the measurement.
    of_the_recording
        It is of one recording, and another of the same axis knows nothing of it.
    identified_by
        The parameter by which two at the same place are not the same.
    least_gain
        Whitened squares that it must gain to be looked at; less where nothing else bends to it.
    least_share
        Of the squared residual: the least that it must gain, since no model has quite the form of an axis.
    laws
        What it is a law of.
    form_left
        Share of its own gain that its form leaves to others.
    form_of_any
        Share of any other's gain below which it is the error of the other's form.
    damping
        The same of what erring teeth gain: less damps what they shake.
    erring_teeth
        It shakes what is damped.
    size_open
        Share of its size that the form of its law leaves open.
    in_every_axis
        Every axis has it: a description without it leaves it out.
    known_within_a_little
        A number of the description itself: what it gains over that is no error of a form.
    like_an_offset
        The same torque as an offset while anything moves.
    in_good_order
        Share of a robot's joint's friction that a joint in good order has of it, within a log.
    over_strokes
        It acts over whole strokes, so that few rows say something of their own.
    restless
        It never rests: it gains in all blocks of a record.
    torque_over_angle
        It is torque over the angle of its shaft, which on one stiff body others have as well.
    shakes_load
        It is seen by what shakes the load.
    gap
        Its size is the gap of a mesh: the same lost motion may lie in another mesh.
    dent
        A dent of one flank: its place is scanned for along the wheels, and teeth may leave it before its bottom.
    once
        It happens once in a record, at times that the rows around them alone know.
    like_noise
        Noise that is taken from a fit without it holds none of it: it is seen by what noise is.
    """

    own_hypothesis: bool = False
    urgent: bool = False
    behind_the_motor: bool = False
    of_links: bool = False
    of_unknown_teeth: bool = False
    unseen_at: frozenset[str] = frozenset()
    beside_the_chain: bool = False
    of_the_recording: bool = False
    identified_by: str | None = None
    least_gain: float = LEAST_GAIN
    least_share: float = LEAST_SHARE
    laws: frozenset[Law] = frozenset()
    form_left: float = FORM_SHARE
    form_of_any: float = 0.0
    damping: float = 0.0
    erring_teeth: bool = False
    size_open: float = SIZE_SHARE
    in_every_axis: bool = False
    known_within_a_little: bool = False
    like_an_offset: bool = False
    in_good_order: float = 0.0
    over_strokes: bool = False
    restless: bool = False
    torque_over_angle: bool = False
    shakes_load: bool = False
    gap: bool = False
    dent: bool = False
    once: bool = False
    like_noise: bool = False

    @property
    def loses_contact(self) -> bool:
        """Whether teeth leave each other by it."""
        return self.gap or self.dent


class Discriminating(Enum):
    """Measurements in which mechanisms differ that look alike in a record, the most telling first.

    Of a pair the first in which either differs is to be made, or both where both must.
    """

    AT_REST = (
        "With nobody near (the load may drop when the brake is released), let the drive hold the axis at rest with the "
        "brake open and log the torque, then move it at two speeds in both directions: an offset is the same in all of "
        "it, friction that differs by direction is not."
    )
    BY_SECOND_ENCODER = (
        "Put a dial gauge, a second encoder or a laser at the load and turn it slowly once: runout of the gear moves "
        "the load, an error of the encoder does not."
    )
    BY_LOOK = (
        "Look by endoscope at all teeth of the gear, or turn it slowly through a whole turn under load and log the "
        "torque: one damaged tooth makes it drop at one angle, errors of all teeth change it everywhere."
    )
    BLOCKED = (
        "Block the load, let the motor push slowly to and fro up to its torque limit and log torque against angle: "
        "backlash shows a flat middle, hardening a bend, hysteresis a loop."
    )
    OVER_A_TURN = (
        "Turn the load slowly through more than one revolution in both directions: an encoder's error needs no torque, "
        "eccentricity grows with speed squared, weight does not."
    )

    @property
    def of_both(self) -> bool:
        """Whether it is for two mechanisms that both name it, and not for one of them and any other."""
        return self in (Discriminating.BY_SECOND_ENCODER, Discriminating.BY_LOOK)


@dataclass(frozen=True)
class SoundReport:
    """What a report says of a mechanism that sound alone can show.

    `name`: in a list of what was looked for; `then`: what to record next where it is found; `rejected`: why it was
    weighed and not named; `absent`: the same beside telemetry, along its path.
    """

    name: str
    then: str
    rejected: str = ""
    absent: str = ""


def only(*locations: str | None) -> Callable[[Axis], tuple[str | None, ...]]:
    """These locations, whatever the axis is."""
    return lambda axis: locations


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
    damage: ClassVar[str] = ""
    """Which damage of teeth can make it, by the names of ISO 10825-1; nothing where none does."""
    size: ClassVar[str]
    """The parameter of which 0 means that the effect is not there."""
    locations: ClassVar[Callable[[Axis], tuple[str | None, ...]]]
    """Where it can act on an axis; the first is meant when no place is given. None: the axis as a whole."""
    as_new_key: ClassVar[str] = ""
    """What the description of a stage calls the size that a new axis has at most; nothing: it has none of it."""
    needs: ClassVar[frozenset[Need]] = frozenset()
    """Without one of these it is the same in a record as all others that need it."""
    shown_by: ClassVar[frozenset[Need]] = frozenset()
    """Without one of these it cannot be seen at all."""
    signature: ClassVar[Signature]
    sentence: ClassVar[str] = ""
    """What a finding says, with its numbers in braces; without it, the first line of the docstring and the numbers."""
    action: ClassVar[str] = "Look at the place named here, but change no parts because of it alone."
    """What to do now about a finding."""
    check: ClassVar[str] = (
        "Repeat the same motion at half the speed and in both directions: what stays the same does not come from the "
        "motion."
    )
    """The measurement that tells it from what looks like it."""
    discriminated_by: ClassVar[frozenset[Discriminating]] = frozenset()
    """Measurements in which it differs from what looks like it."""
    or_of_the_machine: ClassVar[str | None] = None
    """Of a fault of the measurement: what in the machine has the same data, in words."""
    checked: ClassVar[tuple[str, str] | None] = None
    """What a recording is checked for before any physics, and what is said where it has none of it."""
    sound: ClassVar[SoundReport | None] = None
    """What is said of it where sound alone can show it."""
    traits: ClassVar[Traits] = Traits()
    """What an investigation knows of it beforehand."""

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
    def sizes(cls) -> tuple[str, ...]:
        """Parameters of which one at least is not 0 where the effect is there."""
        return (cls.size,)

    @classmethod
    def as_new(cls, axis: Axis, location: str | None) -> float:
        """Size that a new axis has at most, by its description."""
        if not (cls.as_new_key and axis.stages and location):
            return 0.0
        return float(getattr(stage_at(axis, location), cls.as_new_key))

    @classmethod
    def largest(cls, axis: Axis) -> float:
        """Size beyond which an axis cannot have it."""
        return math.inf

    @classmethod
    def looks_like(cls, axis: Axis, location: str | None, load_encoder: bool) -> tuple[str, ...]:
        """Mechanisms that no measurement of motor and load tells from it; `load_encoder`: whether there is one."""
        return ()

    def placed(self, axis: Axis) -> str:
        """Return the place where it acts, the default where none was given."""
        possible = type(self).locations(axis)
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
        """Return the telemetry as it would have been measured: the motor torque is another, unless a subclass says."""
        if "motor_torque_nm" not in telemetry:
            return telemetry
        torque = self.torque(telemetry.time_s, telemetry["motor_torque_nm"])
        return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": torque})

    def torque(self, time_s: Array, torque: Array) -> Array:
        """The motor torque [N m] as it would have been measured, shape (n,)."""
        return torque

    def distort_sound(self, samples: Samples, sample_rate_hz: float, seed: int = 0) -> Samples:
        """Return the recording as it would have been taken."""
        return samples
