"""Blocked cross-validation: what a hypothesis gains on blocks of the record that it was not fitted to."""

from __future__ import annotations

import math

import numpy as np

from sim.chain.model import Array
from sim.investigation.estimation.estimate import Fit, Refits

BLOCKS = 15
KEPT = 0.05  # less than one block
LARGEST_T = 12.0


def advantage(less: Fit, more: Fit) -> Array:
    """By how much `more` predicts blocks better that it has not seen, shape (BLOCKS - 1,).

    What is known of the description counts in equal parts with every block: a model that bends its numbers to explain
    the data is no better. The block of the largest difference is left out: what hangs on one is not known on any other.
    """
    drop = held_out_squares(less) - held_out_squares(more)
    rest = np.delete(drop, largest(drop))
    return np.asarray(rest + (less.prior_penalty - more.prior_penalty) / BLOCKS)


def gain_elsewhere(less: Fit, more: Fit) -> float:
    """What `more` gains, as it was fitted, on all blocks but the one that `advantage` leaves out."""
    out = largest(held_out_squares(less) - held_out_squares(more))
    there = [float(np.sum(fit.residual[fit.blocks(BLOCKS, counting=True)[out]] ** 2)) for fit in (less, more)]
    return less.cost - more.cost - (there[0] - there[1])


def largest(drop: Array) -> int:
    """Place of the largest difference."""
    return int(np.argmax(np.abs(drop)))


def paired(drop: Array) -> float:
    """Mean over blocks in standard errors; of signed roots, as a few blocks with reversals would hide all others.

    Roots of what noise alone makes scatter by about one, however alike two models are here.
    """
    drop = drop[drop != 0.0]
    if drop.size < 4:
        return 0.0
    root = np.sign(drop) * np.sqrt(np.abs(drop))
    error = max(float(root.std(ddof=1)), 1.0) / math.sqrt(root.size)
    return float(np.clip(root.mean() / error, -LARGEST_T, LARGEST_T))


def held_out_squares(fit: Fit) -> Array:
    """Sum of squares per block of time in motion after one linear refit on the other blocks, shape (BLOCKS,).

    A `KEPT` part of all that is known goes into every refit: the other blocks cannot be asked for what one block alone
    knows.
    """
    refits = Refits.of(fit)
    out = np.zeros(BLOCKS)
    for k, part in enumerate(fit.blocks(BLOCKS, counting=True)):
        columns, rows = refits.jacobian[part], fit.residual[part]
        out[k] = float(np.sum((rows + columns @ refits.steps(columns, rows, KEPT)) ** 2))
    return out
