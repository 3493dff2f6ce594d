"""Levenberg-Marquardt: normal equations, damped steps within limits, Broyden's update of sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dger

from sim.investigation.estimation.estimate import Array, Raw
from sim.investigation.model.parameters import Parameter

ACTIVE_ROUNDS = 4
MOST_STEPS = {False: 48, True: 16}  # by whether teeth hit: there the way is rough, and leads ever on
DAMPINGS = 8
FIRST_DAMPING = 1e-4
HOPELESS = 30.0  # times the noise, in power: what two steps leave of a try that leads nowhere
FORETOLD = 0.1  # of the gain of a step: sensitivities that are off by less are true there


def cost_of(residual: Array, parameters: Sequence[Parameter], values: Mapping[str, float]) -> float:
    """What is minimised: squares of the whitened residual, and of how far the numbers are from what was known."""
    known = sum(p.deviation(values) ** 2 for p in parameters)
    return float(residual @ residual) + known


@dataclass
class State:
    """Where a fit stands."""

    values: Mapping[str, float]
    raw: Raw
    residual: Array
    cost: float


def broyden_update(
    parameters: Sequence[Parameter], known: dict[str, Raw], columns: Array, old: State, new: State
) -> None:
    """Let the sensitivities agree with the last step: Broyden's rank-one change (Math. Comp. 19 (1965) 577)."""
    moved = np.array([(new.values[p.name] - old.values[p.name]) / p.step for p in parameters])
    share = moved / max(float(moved @ moved), 1e-300)
    torque, guide = (b - a for a, b in zip(old.raw, new.raw, strict=True))
    for p, m in zip(parameters, moved, strict=True):
        torque = torque - known[p.name][0] * (m * p.step)
        guide = guide - known[p.name][1] * (m * p.step)
    for p, part in zip(parameters, share, strict=True):
        by = part / p.step
        known[p.name] = (known[p.name][0] + torque * by, known[p.name][1] + guide * by)
    left = new.residual - old.residual - columns @ moved
    dger(1.0, left, share, a=columns, overwrite_a=True)  # in place: the columns lie one after the other


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of one set of sensitivities."""

    columns: Array
    information: Array
    steps: Array
    spread: Array

    @staticmethod
    def of(parameters: Sequence[Parameter], columns: Array) -> NormalEquations:
        steps = np.array([p.step for p in parameters])
        spread = np.array([p.spread for p in parameters])
        return NormalEquations(columns, columns.T @ columns + np.diag((steps / spread) ** 2), steps, spread)

    def _descent(self, parameters: Sequence[Parameter], values: Mapping[str, float], pull: Array) -> Array:
        """Half of how the cost falls per step of each parameter, shape (p,); `pull`: columns times residual."""
        offset = np.array([values[p.name] - p.expected for p in parameters])
        return np.asarray(-pull - offset * self.steps / self.spread**2)

    def promised(self, parameters: Sequence[Parameter], old: State, new: State) -> float:
        """Drop of the cost from `old` to `new` in the linear picture."""
        move = np.array([(new.values[p.name] - old.values[p.name]) / p.step for p in parameters])
        descent = self._descent(parameters, old.values, self.columns.T @ old.residual)
        return float(2.0 * descent @ move - move @ self.information @ move)

    def stepped(
        self, parameters: Sequence[Parameter], values: Mapping[str, float], pull: Array, damping: float
    ) -> dict[str, float]:
        """Where the linear picture has its least squares, held back by `damping`, within what is allowed.

        `pull`: columns times residual, shape (p,).
        """
        scale = np.sqrt(np.maximum(np.diag(self.information), 1e-12))
        scaled = self.information / np.outer(scale, scale) + damping * np.eye(len(parameters))
        goal = self._descent(parameters, values, pull) / scale
        unit = self.steps / scale
        low = np.array([p.low - values[p.name] for p in parameters]) / unit
        high = np.array([p.high - values[p.name] for p in parameters]) / unit
        move = np.zeros(len(parameters))
        free = np.ones(len(parameters), dtype=np.bool_)
        for _ in range(ACTIVE_ROUNDS):  # what runs into its limit stays there, the others go on without it
            right = goal[free] - scaled[np.ix_(free, ~free)] @ move[~free]
            move[free] = np.linalg.solve(scaled[np.ix_(free, free)], right)
            out = (move < low) | (move > high)
            move = np.clip(move, low, high)
            if not out[free].any():
                break
            free &= ~out
        return {
            p.name: min(max(float(values[p.name] + d), p.low), p.high)
            for p, d in zip(parameters, move * unit, strict=True)
        }
