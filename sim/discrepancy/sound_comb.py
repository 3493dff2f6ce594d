"""All multiples of one order together, of which hardly one may stand out by itself: of a bearing, or a gear's turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.special import gammaincc
from scipy.stats import gamma

from sim.chain_model import Array

MULTIPLES = 8
WITHIN, SLIP = 0.35, 0.0005  # of the resolution, and relative: where a multiple is looked for
LARGEST = 7.0  # nats of one multiple: none alone makes a bearing
CLEAR = 3.0  # nats
LEAST_CLEAR, LEAST_FIRST, FIRST = 4, 2, 3  # multiples that are clear, and of the first three
LEAST_FREE = 3  # multiples that no gear explains


def strongest_comb(
    grid: Array, power: Array, averages: int, resolution: float, of_gears: NDArray[np.bool_], bases: Array, top: float
) -> tuple[float, float]:
    """Score and order of the base whose multiples stand out most, together; minus infinity where none does.

    `power` (m,) at the orders `grid` (m,): noise of mean 1, averaged so often; `of_gears` (m,): where lines of gears
    may stand, which do not count; `top`: highest order in the recording. Score: nats of Fisher's sum of the multiples'
    p-values over what as many independent bases reach by chance; lines that noise does not make have far more.
    """
    step = float(grid[1] - grid[0])
    chance = gammaincc(averages, np.maximum(averages * power, 1e-9))
    nats = np.zeros((MULTIPLES, bases.size))
    free = np.zeros((MULTIPLES, bases.size), dtype=np.bool_)
    for k in range(1, MULTIPLES + 1):
        at = np.clip(np.rint((k * bases - grid[0]) / step).astype(np.intp), 0, grid.size - 1)
        half = np.maximum(np.rint((WITHIN * resolution + SLIP * k * bases) / step).astype(np.intp), 1)
        for width in np.unique(half):
            here = half == width
            lowest = minimum_filter1d(chance, 2 * int(width) + 1)[at[here]]
            places = max(1.0, 4.0 * width * step / resolution)
            nats[k - 1, here] = -np.log(np.clip(lowest * places, math.exp(-LARGEST), 1.0))
        free[k - 1] = ~of_gears[at] & (k * bases < top)
    nats = np.where(free, nats, 0.0)
    count = free.sum(axis=0)
    enough = (count >= LEAST_FREE) & ((nats > CLEAR).sum(axis=0) >= LEAST_CLEAR)
    enough &= (nats[:FIRST] > CLEAR).sum(axis=0) >= LEAST_FIRST
    if not enough.any():
        return -math.inf, 0.0
    trials = math.log(max(bases.size * step / (WITHIN * resolution), 1.0))
    score = np.where(enough, -gamma.logsf(nats.sum(axis=0), np.maximum(count, 1)) - trials, -np.inf)
    best = int(np.argmax(score))
    return float(score[best]), _refined(grid, power, float(bases[best]), resolution, free[:, best])


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


def _refined(grid: Array, power: Array, base: float, resolution: float, free: NDArray[np.bool_]) -> float:
    """The base through the peaks on its free multiples, by least squares."""
    step = float(grid[1] - grid[0])
    over = under = 0.0
    for k in np.flatnonzero(free) + 1:
        at, half = round((k * base - grid[0]) / step), max(1, round((WITHIN * resolution + SLIP * k * base) / step))
        window = slice(max(at - half, 0), at + half + 1)
        over += k * float(grid[window][np.argmax(power[window])])
        under += float(k * k)
    return float(over / under)
