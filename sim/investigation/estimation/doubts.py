"""What a residual says of the ways in which the known torque may be wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim.investigation.data.preprocessing import Measurement
from sim.investigation.estimation.estimate import Array
from sim.investigation.estimation.whitening import Noise


def by_doubts(m: Measurement, noise: Noise, left: Array, unseen: NDArray[np.bool_] | None = None) -> Array:
    """What of `left` all rows but the `unseen`, shape (n,), expect along the ways in which the known torque may be
    wrong, shape (n,) [N m]."""
    if not m.doubts.size:
        return np.zeros(m.samples)
    plain = replace(noise, ways=np.zeros((0, 0)), less=np.zeros(0))
    rows = (*m.wrong_ways.T, m.across(left))
    table = np.stack([plain.whiten(np.ascontiguousarray(row), np.zeros(0), m.awake) for row in rows], axis=1)
    if unseen is not None:
        table[unseen] = 0.0
    ways, seen = table[:, :-1], table[:, -1]
    return np.asarray(m.doubts @ np.linalg.solve(np.eye(ways.shape[1]) + ways.T @ ways, ways.T @ seen))
