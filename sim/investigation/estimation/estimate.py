"""An estimate: values, residual and sensitivities of a model that was fitted."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.parameters import Parameter

Array = NDArray[np.float64]
Raw = tuple[Array, Array]  # motor torque and guide torque
Start = tuple[Mapping[str, float], Mapping[str, Raw]]  # numbers and sensitivities
SCORE_BLOCKS = 40
UNKNOWN = 1e-6  # information of one step below which a parameter is not known


@dataclass(frozen=True)
class Fit:
    """A converged model: numbers by name, terms on top of the description, whitened residual and sensitivities.

    `residual` (rows,) and `jacobian` (rows, parameters), the latter per `steps`; `cost` includes what was known before.
    `torque_rows`: that many rows come first, those of the guide follow, over the same time. `sensitivities`: the same
    columns by name before whitening, per unit: a term may take a parameter's place with another step.
    """

    terms: tuple[Term, ...]
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]
    residual: Array
    jacobian: Array
    cost: float
    torque_rows: int
    sensitivities: Mapping[str, Raw] = field(repr=False, default_factory=dict)

    @property
    def misfit(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.residual @ self.residual)

    @property
    def prior_penalty(self) -> float:
        """What the fit costs by bending what was known: squared deviations of the numbers from it."""
        return self.cost - self.misfit

    @property
    def own(self) -> dict[str, float]:
        """What the terms have of their own of all numbers."""
        return {p.name: self.values[p.name] for term in self.terms for p in term.parameters}

    @property
    def at_limit(self) -> NDArray[np.bool_]:
        """Which parameters lie as low or as high as they may, shape (p,)."""
        return np.array([not p.low < self.values[p.name] < p.high for p in self.parameters], dtype=np.bool_)

    def blocks(self, count: int, *, counting: bool = False) -> list[NDArray[np.int64]]:
        """Rows of each of `count` equal parts of the time, or of that in which the torque is `counting`, of both
        channels."""
        torque = np.linspace(0, self.torque_rows, count + 1).astype(np.int64)
        if counting:
            gone = np.cumsum(self.residual[: self.torque_rows] != 0.0)
            torque[1:-1] = np.searchsorted(gone, np.linspace(0, gone[-1], count + 1)[1:-1])
        share = (self.residual.size - self.torque_rows) / max(self.torque_rows, 1)
        guide = self.torque_rows + (torque * share).astype(np.int64)
        return [
            np.concatenate([np.arange(a, b), np.arange(c, d)])
            for (a, b), (c, d) in zip(pairwise(torque), pairwise(guide), strict=True)
        ]

    @cached_property
    def influence(self) -> tuple[Array, Array]:
        """Covariance of the parameters by the curvature at the optimum (p, p), and what each block of time pulls each
        of them by (SCORE_BLOCKS, p)."""
        steps = np.array([p.step for p in self.parameters])
        spread = np.array([p.spread for p in self.parameters])
        information = self.jacobian.T @ self.jacobian + np.diag((steps / spread) ** 2)
        scale = np.sqrt(np.maximum(np.diag(information), UNKNOWN))
        curved = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
        curved += np.diag(np.diag(information) < UNKNOWN)  # the data do not know it at all
        parts = self.blocks(SCORE_BLOCKS)
        scores = np.array([self.jacobian[part].T @ self.residual[part] for part in parts]) / scale
        pulls = (scores - scores.mean(axis=0)) @ curved
        unit = steps / scale
        return curved * np.outer(unit, unit), pulls * unit

    def deviation(self, change: Mapping[str, float], known: Collection[str] = ()) -> float:
        """Standard deviation of a number that changes by `change` per unit of each parameter, were `known` known.

        By the curvature at the optimum, or by how blocks of time disagree where that says more: the sandwich of White
        (Econometrica 48 (1980) 817) over contiguous blocks holds for noise that the whitening has left coloured and
        for a form that is not quite that of the axis. What has run into a limit stays there, as in any step of a fit.
        """
        curved, pulls = self.influence
        limit = self.at_limit
        held = [k for k, p in enumerate(self.parameters) if p.name in known or (limit[k] and p.name not in change)]
        if held:
            share = curved[:, held] @ np.linalg.pinv(curved[np.ix_(held, held)], hermitian=True)
            curved, pulls = curved - share @ curved[held], pulls - pulls[:, held] @ share.T
        slope = np.array([change.get(p.name, 0.0) for p in self.parameters])
        return math.sqrt(max(float(slope @ curved @ slope), float(np.sum((pulls @ slope) ** 2))))

    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return {p.name: self.deviation({p.name: 1.0}) for p in self.parameters}


@dataclass(frozen=True)
class Refits:
    """Linear refits of a fit without some of its rows.

    It is taken for stationary in everything that is not at a limit, and what is stays there: free to pass it, it would
    move all that it has in common with others. `moving`, shape (p,): what is not; `jacobian`, shape (rows, moving).
    `still`: numbers that stay as well.
    """

    moving: NDArray[np.bool_]
    jacobian: Array
    information: Array

    @staticmethod
    def of(fit: Fit, still: Collection[str] = ()) -> Refits:
        moving = ~fit.at_limit & np.array([p.name not in still for p in fit.parameters], dtype=np.bool_)
        known = np.array([p.step / p.spread for p in fit.parameters])[moving]
        jacobian = fit.jacobian[:, moving]
        return Refits(moving, jacobian, jacobian.T @ jacobian + np.diag(known**2 + 1e-9))

    def steps(self, columns: Array, residual: Array, kept: float = 0.0) -> Array:
        """By how many steps each number moves without these rows, but for a `kept` part of what they know of it."""
        rest = self.information - (1.0 - kept) * (columns.T @ columns)
        scale = np.sqrt(np.maximum(np.diag(rest), 1e-12))
        scaled = rest / np.outer(scale, scale) + 1e-9 * np.eye(scale.size)
        return np.asarray(np.linalg.solve(scaled, (columns.T @ residual) / scale) / scale)
