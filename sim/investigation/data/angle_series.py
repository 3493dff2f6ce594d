"""A curve over the angle of the load, as a series: of a whole turn its harmonics, of less any curve over the way."""

from __future__ import annotations

import math

import numpy as np

from sim.chain.model import Array

ERROR_ORDERS = 10  # per turn of the load: errors of assembly; what repeats faster is of teeth
WHOLE = 0.95  # of a turn: what is left of it hides no error once per turn


def is_whole(angle: Array) -> bool:
    """Whether `angle` (n,) passes a whole turn."""
    return float(np.ptp(angle)) > WHOLE * 2.0 * math.pi


def over_the_way(angle: Array, order: int) -> Array:
    """cos(order pi s) of the way s from one end of `angle` (n,) to the other: all together are any curve over it."""
    return np.asarray(np.cos(order * math.pi * (angle - angle.min()) / max(float(np.ptp(angle)), 1e-300)))


def orders_beyond_twice(angle: Array) -> Array:
    """Order of each wave of `beyond_twice`, per turn or per twice the way, shape (k,)."""
    if is_whole(angle):
        return np.tile(np.arange(3.0, ERROR_ORDERS + 3), 2)
    return np.asarray(np.arange(1.0, 2 * ERROR_ORDERS + 1), dtype=np.float64)


def beyond_twice(angle: Array) -> tuple[Array, Array]:
    """What repeats three times per turn of `angle` (n,) and more, or of less than a turn any curve; and its slopes.

    Shape (k, n), with as many waves either way: a motion that goes farther has the same numbers. Slopes per rad.
    """
    orders = orders_beyond_twice(angle)[:, None]
    if not is_whole(angle):
        turn = math.pi / max(float(np.ptp(angle)), 1e-300)
        phase = orders * turn * (angle - angle.min())
        return np.cos(phase), -orders * turn * np.sin(phase)
    half = orders.size // 2
    sine, cosine = np.sin(orders * angle), np.cos(orders * angle)
    waves = np.concatenate([sine[:half], cosine[half:]])
    return waves, orders * np.concatenate([cosine[:half], -sine[half:]])


def errors_over(angle: Array) -> Array:
    """All of an encoder's or a gear's error over `angle` (n,) that is none of teeth: waves of once and twice per turn,
    and those of `beyond_twice`, shape (k, n)."""
    low = [part for k in (1, 2) for part in (np.sin(k * angle), np.cos(k * angle))]
    return np.stack([*low, *beyond_twice(angle)[0]])
