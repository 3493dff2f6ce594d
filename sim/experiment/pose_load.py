"""What the links of a robot ask of one joint while all its joints move together from one pose to another and back.

On such a way every joint is as far as the one that is heard, so that its torque hangs on that one's angle alone:

    torque = inertia(angle) acceleration + centrifugal(angle) speed^2 + gravity(angle)

The others follow their own servos whatever this joint does. So what its gear moves when it swings beside that way is
its own inertia alone; the rest of the torque is one from outside.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseLoad:
    """Torques at the joint, in even steps of its angle over the way; of a sliding joint N for N m, kg for kg m2.

    Parameters
    ----------
    robot, joint, payload_kg
        Which robot and joint, and what hangs at its last link.
    first_rad, last_rad
        The two poses: angles of all logged joints, shape (joints,).
    ends_rad
        Angle of this joint in both of them.
    own_inertia_kg_m2
        What it feels while the others are held, shape (n,).
    inertia_kg_m2
        What it needs per acceleration of its own while the others come along, shape (n,).
    centrifugal_kg_m2
        What it needs per square of its speed, shape (n,).
    gravity_n_m
        What it needs to hold still, shape (n,).
    """

    robot: str
    joint: str
    payload_kg: float
    first_rad: tuple[float, ...]
    last_rad: tuple[float, ...]
    ends_rad: tuple[float, float]
    own_inertia_kg_m2: tuple[float, ...]
    inertia_kg_m2: tuple[float, ...]
    centrifugal_kg_m2: tuple[float, ...]
    gravity_n_m: tuple[float, ...]

    def along(self, motion: Array) -> tuple[Array, Array]:
        """Own inertia [kg m2] and the whole torque [N m] along a motion of the joint, shape (n,) each.

        `motion`: angle, speed and acceleration, shape (3, n).
        """
        angle, speed, acceleration = motion
        rows = np.array([self.own_inertia_kg_m2, self.inertia_kg_m2, self.centrifugal_kg_m2, self.gravity_n_m])
        from scipy.interpolate import CubicSpline  # slow to import

        curves = CubicSpline(np.linspace(*self.ends_rad, rows.shape[1]), rows, axis=1)
        own, inertia, centrifugal, gravity = curves(angle)
        return own, np.asarray(inertia * acceleration + centrifugal * speed**2 + gravity)


def pose_load_of(document: Mapping[str, Any]) -> PoseLoad:
    """Read a load back from what `dataclasses.asdict` made of it (JSON)."""
    read: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in document.items()}
    return PoseLoad(**read)
