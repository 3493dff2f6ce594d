"""An axis taken for one body with friction: enough to tell units, lost rows and descriptions that cannot be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.chain.model import Array


def one_body(
    torque: Array,
    acceleration: Array,
    speed: Array,
    used: NDArray[np.bool_] | slice = slice(None),
    beside: Sequence[Array] = (),
) -> tuple[Array, Array]:
    """Inertia, dry and viscous friction and offset by least squares over `used`, shape (4 + k,), and the torque beyond.

    [kg m2], [N m], [N m s/rad], [N m]; the torque that one body does not need is of all rows [N m], shape (n,).
    `beside`: k other laws of the torque, each of shape (n,).
    """
    columns = np.stack([acceleration, np.sign(speed), speed, np.ones(speed.size), *beside], 1)
    scale = np.abs(columns).max(axis=0) + 1e-300
    found = np.linalg.lstsq(columns[used] / scale, torque[used], rcond=None)[0] / scale
    return found, torque - columns @ found
