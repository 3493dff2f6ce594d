"""How well a run obeys its equations, and the instants at which every run is looked at before it leaves `simulate`."""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from sim.errors import RunError

Array = NDArray[np.float64]
TOLERANCE = 1e-6
"""Largest residual that a result may have, relative to the terms that should cancel."""
INSTANTS = 16
SMALLEST = 1e-6
"""Angles [rad] and speeds [rad/s] of this size are taken to occur, and in every torque this share of the largest."""


@dataclass(frozen=True)
class Residual:
    """How well a run obeys its equations, each relative to the terms that should cancel.

    What was not looked at is nan.

    Parameters
    ----------
    equations
        Balances of torques at the flanges, constraints of shafts and gears, laws of the components.
    limits
        By how much an inequality of a mode is missed: a friction beyond its limit, a flank that pulls.
    motion
        Flanges that follow a signal, from that signal.
    flow
        Each sample from what follows from the one before.
    energy
        Change of kinetic energy from the work of all torques, relative to the energy that is moved.
    """

    equations: float = 0.0
    limits: float = 0.0
    motion: float = 0.0
    flow: float = float("nan")
    energy: float = float("nan")

    @property
    def largest(self) -> float:
        """The largest of all that were looked at."""
        return float(np.nanmax(list(asdict(self).values())))


def instants(samples: int) -> NDArray[np.int64]:
    """Numbers of the samples that are looked at, the first and the last but one among them."""
    return np.unique(np.linspace(0, max(samples - 2, 0), INSTANTS).astype(np.int64))


def check_finite(time_s: Array, values: Array, name: Callable[[int], str]) -> None:
    """Raise RunError with the column's name and the first time at which values of shape (n, columns) are not finite."""
    if np.isfinite(values[-1]).all():
        return
    first = int(np.argmin(np.isfinite(values).all(axis=1)))
    raise RunError(
        f"{name(int(np.argmin(np.isfinite(values[first]))))}: no finite motion from {time_s[first]:.9g} s on"
    )
