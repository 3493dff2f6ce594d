"""Rows that a simulation cannot tell: any change of a number changes all that rattling teeth do from there on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import label, maximum, uniform_filter1d

from sim.chain.model import Array

KICK = 0.01  # of a step, by which all numbers are moved to see where
MOST_BENT = 0.01  # noise deviations by which twice the kick may do other than twice as much: a step, one
LEAST_BENT = 0.002  # the same where such a spell begins and ends
FELT_S = 0.05  # on either side of a row, over which that is asked
FEWEST_PREDICTABLE = 1.0 / 3.0  # of all rows; fewer say less than what is rough


def linear_rows(kicked: Sequence[Array], rate_hz: float) -> Array:
    """1 where twice the kick does twice as much, else 0, shape (n,); all 1 where hardly any row would be left.

    `kicked`: whitened residuals (n,) without a kick, with one and with two.
    """
    bent = kicked[0] - 2.0 * kicked[1] + kicked[2]
    rough = uniform_filter1d(bent**2, 2 * int(FELT_S * rate_hz) + 1)
    spells, count = label(rough > LEAST_BENT**2)
    worst = maximum(rough, spells, np.arange(count + 1))
    smooth = (spells == 0) | (worst[spells] < MOST_BENT**2)
    return np.asarray(smooth, dtype=np.float64) if smooth.mean() > FEWEST_PREDICTABLE else np.ones(smooth.size)
