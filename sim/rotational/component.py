"""What a component is: its flanges, and its equations as linear forms, one set per branch of its law.

Sign convention (Modelica.Mechanics.Rotational): at a connection all angles are equal and the torques sum to zero; a
flange torque counts positive into the component. A `support` that is not connected is the ground (angle zero); any
other flange that is not connected carries no torque.

A component states its law piece by piece: a `Branch` is one affine piece, with the inequalities that hold while it is
valid. Rows are vectors over all variables of the train (`Variables` hands them out), so that equations read like
equations: ``tau = self.c * v.phi_rel + self.d * v.w_rel``.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

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


class Signal(ABC):
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


class Component(ABC):
    """A part of a drive train: frozen, named and parameterised as in Modelica.Mechanics.Rotational."""

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b")
    grounded: ClassVar[tuple[str, ...]] = ()
    """Flanges that are the ground when nothing is connected to them."""
    units: ClassVar[Mapping[str, str]] = {}
    """Unit of every channel."""
    mode_names: ClassVar[Mapping[int, str]] = SLIDING_NAMES

    @property
    def affine(self) -> bool:
        """Whether every branch is affine, so that the exact engine can have it."""
        return True

    @property
    def loses_torque(self) -> bool:
        """Whether its loss depends on the torque that it carries, so that this must be determined."""
        return False

    @property
    def inertia(self) -> float:
        """Moment of inertia at its first flange [kg.m2]; a mass [kg] where the flange moves straight."""
        return 0.0

    @property
    def unknowns(self) -> int:
        """How many unknown torques the branches speak of, those of `kinematics` first."""
        return 0

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Signals that drive the component."""
        return ()

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
