"""What a component is: its flanges, and its equations as linear forms, one set per branch of its law.

Sign convention (Modelica.Mechanics.Rotational): at a connection all angles are equal and the torques sum to zero; a
flange torque counts positive into the component. A `support` that is not connected is the ground (angle zero); any
other flange that is not connected carries no torque.

A component states its law piece by piece: a `Branch` is one affine piece, with the inequalities that hold while it is
valid. Rows are vectors over all variables of the train (`Variables` hands them out), so that equations read like
equations: ``tau = self.c * v.phi_rel + self.d * v.w_rel``.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.errors import ParameterError, number

Row = NDArray[np.float64]

BACKWARD, STUCK, FORWARD, FREE, UNKNOWN = -1, 0, 1, 2, 3
SLIDING_NAMES: Mapping[int, str] = {
    BACKWARD: "backward",
    STUCK: "stuck",
    FORWARD: "forward",
    FREE: "free",
    UNKNOWN: "unknown",
}
CONTACT_NAMES: Mapping[int, str] = {-1: "contact backward", 0: "gap", 1: "contact forward"}


UNITS: Mapping[str, str] = {
    "phi": "rad", "w": "rad/s", "a": "rad/s2", "tau": "N.m", "tauLoss": "N.m", "lossPower": "W", "power": "W",
    "s": "m", "v": "m/s", "f": "N", "fn": "N", "mode": "1", "reference": "rad",
}  # fmt: skip
"""Units of channels by what they are called behind the last dot and before the first underscore."""


class Range(NamedTuple):
    """Unit of a number, and where it may lie."""

    unit: str = ""
    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf


class Checked:
    """A dataclass whose parameters are checked as it is made; one that is None by default may stay so.

    Raises ParameterError naming class and parameter, what is right for it and what came.
    """

    ranges: ClassVar[Mapping[str, Range]] = {}
    """Of parameters that are numbers."""

    def __post_init__(self) -> None:
        for item in fields(self):  # type: ignore[arg-type]
            name, value = f"{type(self).__name__}.{item.name}", getattr(self, item.name)
            if value is None and item.default is None:
                continue
            if item.name in self.ranges:
                number(name, value, **self.ranges[item.name]._asdict())
            elif item.type is Signal and not isinstance(value, Signal):
                raise ParameterError(f"{name}: must be a signal such as Sine or Sampled, got {value!r}")


class Signal(Checked, ABC):
    """A function of time [s]: between its breakpoints a level plus a sine (that may die away), or a straight line."""

    @property
    def omega(self) -> float:
        """Angular frequency of the swing [rad/s]; 0 where it is a straight line."""
        return 0.0

    @property
    def damping(self) -> float:
        """How fast the swing dies away [1/s]: swing'' = -2 damping swing' - (omega^2 + damping^2) swing."""
        return 0.0

    @property
    def has_level(self) -> bool:
        """Whether a level stands beside the sine."""
        return False

    @abstractmethod
    def breakpoints(self, begin: float, end: float) -> NDArray[np.float64]:
        """Times strictly between `begin` and `end` at which another piece begins [s], ascending."""

    @abstractmethod
    def pieces(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Level, swing and rate of the piece that holds from each time on, shape (n, 3)."""

    def __call__(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at the times [s], right-hand limits at breakpoints; shape (n,)."""
        pieces = self.pieces(np.atleast_1d(np.asarray(time_s, dtype=np.float64)))
        return pieces[:, 0] + pieces[:, 1]


class Variables(ABC):
    """Hands a component the rows of its variables and of its unknown torques."""

    one: Row

    @abstractmethod
    def phi(self, flange: str) -> Row:
        """Angle of a flange [rad]."""

    @abstractmethod
    def w(self, flange: str) -> Row:
        """Speed of a flange [rad/s]."""

    @abstractmethod
    def a(self, flange: str) -> Row:
        """Acceleration of a flange [rad/s2]."""

    @abstractmethod
    def unknown(self, i: int) -> Row:
        """Unknown torque number i of this component [N m]; it declares how many it has."""

    @abstractmethod
    def signal(self, i: int = 0, derivative: int = 0) -> Row:
        """Signal number i of this component, or its first or second derivative by time."""

    def motion(self, flange: str, support: str = "support") -> tuple[Row, Row, Row]:
        """Angle, speed and acceleration of a flange against its support."""
        phi, w, a = (row(flange) - row(support) for row in (self.phi, self.w, self.a))
        return phi, w, a

    @property
    def phi_rel(self) -> Row:
        return self.phi("flange_b") - self.phi("flange_a")

    @property
    def w_rel(self) -> Row:
        return self.w("flange_b") - self.w("flange_a")

    @property
    def a_rel(self) -> Row:
        return self.a("flange_b") - self.a("flange_a")


@dataclass(frozen=True)
class Branch:
    """One affine piece of a component's law.

    Parameters
    ----------
    torques
        Torque into the component at each flange [N m]; a flange left out carries none.
    equations
        Rows that are zero, as many as the component has unknowns beyond its kinematics.
    holds
        Rows that are >= 0 as long as the branch is valid.
    strict
        Rows that are > 0 from then on, not zero for good: a speed (else the shaft is stuck, not sliding), a force that
        presses (else the friction is free).
    stops
        Speeds that are exactly zero in this branch [rad/s].
    mode
        Modelica's number of the mode, None for a component that has none.
    channels
        Named results with their rows.
    powers
        Named results that are products of two rows [W]: a torque of friction or damping, and its speed.
    """

    torques: Mapping[str, Row]
    equations: tuple[Row, ...] = ()
    holds: tuple[Row, ...] = ()
    strict: tuple[Row, ...] = ()
    stops: tuple[Row, ...] = ()
    mode: int | None = None
    channels: Mapping[str, Row] = field(default_factory=dict)
    powers: Mapping[str, tuple[Row, Row]] = field(default_factory=dict)


@dataclass(frozen=True)
class Start:
    """A start value: the row of an angle or a speed, and what it is at the beginning."""

    row: Row
    value: float


class Component(Checked, ABC):
    """A part of a drive train: frozen, named and parameterised as in Modelica.Mechanics.Rotational."""

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b")
    grounded: ClassVar[tuple[str, ...]] = ()
    """Flanges that are the ground when nothing is connected to them."""
    units: ClassVar[Mapping[str, str]] = UNITS
    """Units of its channels, by their names as in `UNITS`."""
    mode_names: ClassVar[Mapping[int, str]] = SLIDING_NAMES
    affine: ClassVar[bool] = True
    """Whether every branch is affine, so that the exact engine can have it."""
    unknowns: ClassVar[int] = 0
    """How many unknown torques the branches speak of, those of `kinematics` first."""

    @property
    def loses_torque(self) -> bool:
        """Whether its loss depends on the torque that it carries, so that this must be determined."""
        return False

    @property
    def inertia(self) -> float:
        """Moment of inertia at its first flange [kg.m2]; a mass [kg] where the flange moves straight."""
        return 0.0

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Signals that drive the component: those among its parameters."""
        return tuple(value for value in vars(self).values() if isinstance(value, Signal))

    def unit(self, channel: str) -> str:
        """Unit of a channel."""
        return self.units[channel.rpartition(".")[2].partition("_")[0]]

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        """Rows of angles that are zero at all times."""
        return ()

    def prescribed(self, v: Variables) -> tuple[Row, ...]:
        """Angles whose motion this component gives, whatever torque it takes."""
        return ()

    def follows(self, v: Variables) -> tuple[tuple[Row, Signal], ...]:
        """Angles and speeds that are to be those of a signal at all times."""
        return ()

    def states(self, v: Variables) -> tuple[Row, ...]:
        """Angles that this component would have as states, as Modelica's stateSelect."""
        return ()

    def starts(self, v: Variables) -> tuple[Start, ...]:
        """Start values that were given."""
        return ()

    @abstractmethod
    def branches(self, v: Variables) -> tuple[Branch, ...]:
        """Return all pieces of the law, the preferred ones first where two are possible."""


class WithStarts(Component):
    """A component with a motion of its own, the relative one of its flanges, and start values of it.

    A start acceleration is refused: Modelica takes it as a guess, or to find the position or speed that makes it; here
    positions and speeds are what is given.
    """

    start_names: ClassVar[tuple[str, str, str]] = ("phi_rel", "w_rel", "a_rel")
    ranges: ClassVar[Mapping[str, Range]] = {"phi_rel": Range("rad"), "w_rel": Range("rad/s")}

    def __post_init__(self) -> None:
        super().__post_init__()
        position, speed, acceleration = self.start_names
        if getattr(self, acceleration) is not None:
            raise ParameterError(
                f"{type(self).__name__}.{acceleration}: a start acceleration is not taken, it follows from the torques "
                f"at the start; give {position} and {speed} instead"
            )

    def own_motion(self, v: Variables) -> tuple[Row, Row]:
        """Angle and speed that the start values are of."""
        return v.phi_rel, v.w_rel

    def states(self, v: Variables) -> tuple[Row, ...]:
        return self.own_motion(v)[:1]

    def starts(self, v: Variables) -> tuple[Start, ...]:
        given = ((row, getattr(self, name)) for row, name in zip(self.own_motion(v), self.start_names[:2], strict=True))
        return tuple(Start(row, value) for row, value in given if value is not None)
