"""All multiples of one order together, of which hardly one may stand out by itself: of a bearing, or a gear's turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc
from scipy.stats import gamma, rankdata

from sim.torsional.model import Array

MULTIPLES = 8
WITHIN = 0.35  # of the resolution: where a multiple is looked for
LARGEST = 7.0  # nats of one multiple: none alone makes a bearing
CLEAR = 3.0  # nats
LEAST_CLEAR, LEAST_FIRST, FIRST = 4, 2, 3  # multiples that are clear, and of the first three
LEAST_FREE = 3  # multiples that no gear explains
UNEVEN = 0.01  # of the way from one impact to the next, at random: rolling elements slip
WIDTHS = 1.5  # of a line at half its height, over which it is summed
NEIGHBOURS = 0.5  # independent bins per bin under a Hann window
PER_BIN = 4  # bases per bin
LARGEST_RANK = 9.0  # nats of one multiple, where they are a rank within the recording
OF_DOUBLE = 1.5  # times the nats of the multiples between
MOST_HEIGHT = 60.0  # times the noise, of one bin


def _most(nats: Array, free: NDArray[np.bool_], trials: float) -> tuple[float, int | None]:
    """Score and place of the base whose multiples stand out most, None where none does.

    `nats` and `free`, both (multiples, bases): how far each stands out, and whether no gear explains it.
    """
    count = free.sum(axis=0)
    enough = (count >= LEAST_FREE) & ((nats > CLEAR).sum(axis=0) >= LEAST_CLEAR)
    enough &= (nats[:FIRST] > CLEAR).sum(axis=0) >= LEAST_FIRST
    if not enough.any():
        return -math.inf, None
    chance = -gamma.logsf(nats.sum(axis=0), np.maximum(count, 1)) - math.log(max(trials, 1.0))
    score = np.where(enough, chance, -np.inf)
    best = int(np.argmax(score))
    return float(score[best]), best


def slipping_comb(
    power: Array, step: float, of_gears: NDArray[np.bool_], between: tuple[float, float], top: float
) -> tuple[float, float, int]:
    """Of impacts whose way to the next varies: score, order and number of clear multiples of the base that stands out.

    `power` (m,): one periodogram over the path, noise of mean 1, at multiples of `step`; `of_gears` (m,): lines of
    gears, which do not count; `top`: highest order; `between`: lowest and highest base. Score: nats of Fisher's sum of
    the multiples' p-values over what as many independent bases reach by chance. From impact to impact the phase of
    multiple k walks by 2 pi k `UNEVEN` (Randall and Antoni, Mech. Syst. Signal Process. 25 (2011) 485), so that its
    line has half the height at pi (k `UNEVEN`)^2 times the base to either side: it is summed over that. How seldom a
    sum is so large is asked of multiple k of all bases: whatever turns makes lines in this recording, and only a family
    has all of its own. Where every second multiple stands out more than those between, the base is the double: impacts
    are clearest in their first multiples.
    """
    orders = np.arange(power.size) * step
    summed = np.concatenate([[0.0], np.cumsum(np.where(of_gears, 0.0, np.minimum(power, MOST_HEIGHT)))])
    counted = np.concatenate([[0], np.cumsum(~of_gears)])
    end = min(top, float(orders[-1]))
    bases = np.arange(between[0], min(between[1], end / LEAST_CLEAR), step / PER_BIN)
    if not bases.size:
        return -math.inf, 0.0, 0
    nats = np.zeros((MULTIPLES, bases.size))
    free = np.zeros((MULTIPLES, bases.size), dtype=np.bool_)
    for k in range(1, MULTIPLES + 1):
        half = np.maximum(WIDTHS * math.pi * (k * UNEVEN) ** 2 * bases, step)
        first = np.clip(np.rint((k * bases - half) / step).astype(np.intp), 0, power.size)
        last = np.clip(np.rint((k * bases + half) / step).astype(np.intp) + 1, 0, power.size)
        bins = counted[last] - counted[first]
        at = np.clip(np.rint(k * bases / step).astype(np.intp), 0, power.size - 1)
        use = free[k - 1] = ~of_gears[at] & (2 * bins > last - first) & (k * bases + half < end)
        independent = np.maximum(NEIGHBOURS * bins[use], 1.0)
        mean = (summed[last] - summed[first])[use] / bins[use]
        chance = gammaincc(independent, independent * mean)
        seldom = rankdata(chance, "max") / chance.size
        nats[k - 1, use] = np.minimum(-np.log(np.maximum(chance, seldom)), LARGEST_RANK)
    score, best = _most(nats, free, 2.0 * bases.size / PER_BIN)
    if best is None:
        return score, 0.0, 0
    odd, even = (nats[k::2, best][free[k::2, best]] for k in (0, 1))
    if even.size > 0 and even.mean() > OF_DOUBLE * (odd.mean() if odd.size else 0.0):
        return score, 2.0 * float(bases[best]), int((even > CLEAR).sum())
    return score, float(bases[best]), int((nats[:, best] > CLEAR).sum())


def usual_height(grid: Array, power: Array, averages: int, resolution: float, places: Array) -> tuple[float, int]:
    """Median of the nats by which given orders `places` (k,) stand out of noise, and how many are clear.

    What is fixed in hertz, or another family, makes some of them stand out, but not half.
    """
    half = WITHIN * resolution
    nats = np.zeros(places.size)
    for index, place in enumerate(places):
        near = np.abs(grid - place) < half
        chance = gammaincc(averages, averages * float(power[near].max())) * max(1.0, 4.0 * half / resolution)
        nats[index] = -math.log(min(max(float(chance), math.exp(-LARGEST)), 1.0))
    return float(np.median(nats)), int((nats > CLEAR).sum())
