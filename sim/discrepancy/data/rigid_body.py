"""An axis taken for one body with friction: enough to tell units, lost rows and descriptions that cannot be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.torsional.model import Array


def one_body(
    torque: Array, acceleration: Array, speed: Array, used: NDArray[np.bool_] | slice = slice(None)
) -> tuple[Array, Array]:
    """Inertia, dry and viscous friction and offset by least squares over `used`, shape (4,), and the torque beyond.

    [kg m2], [N m], [N m s/rad], [N m]; the torque that one body does not need is of all rows [N m], shape (n,).
    """
    columns = np.stack([acceleration, np.sign(speed), speed, np.ones(speed.size)], 1)
    scale = np.abs(columns).max(axis=0) + 1e-300
    found = np.linalg.lstsq(columns[used] / scale, torque[used], rcond=None)[0] / scale
    return found, torque - columns @ found
