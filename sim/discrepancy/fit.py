"""Gauss-Newton on simulated outputs: residuals of every channel, whitened, against all parameters at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from sim.axis import Axis
from sim.chain_model import Chain, ChainError
from sim.discrepancy.entries import with_entries
from sim.discrepancy.measurement import LOAD_CUT_HZ, Measurement
from sim.discrepancy.model import base_parameters, chain_of, nuisance_of
from sim.discrepancy.observer import Observer
from sim.discrepancy.parameters import Parameter
from sim.discrepancy.terms import Term

Array = NDArray[np.float64]
TORQUE_ORDER, GUIDE_ORDER = 32, 16
WORKERS = 2


@dataclass(frozen=True)
class Noise:
    """Whitening filters: prediction error of an autoregression over its standard deviation, per channel."""

    torque: Array
    guide: Array

    @staticmethod
    def flat(torque_sd: float, guide_sd: float) -> Noise:
        return Noise(np.array([1.0 / torque_sd]), np.array([1.0 / guide_sd]))


@dataclass(frozen=True)
class Fit:
    """A converged model: numbers by name, terms on top of the description, whitened residual and sensitivities.

    `residual` (rows,) and `jacobian` (rows, parameters), the latter per `steps`; `cost` includes what was known before.
    """

    terms: tuple[Term, ...]
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]
    residual: Array
    jacobian: Array
    cost: float
    runs: int

    @property
    def misfit(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.residual @ self.residual)

    def deviations(self) -> dict[str, float]:
        """Standard deviation of each parameter from the curvature at the optimum."""
        steps = np.array([p.step for p in self.parameters])
        spread = np.array([p.spread for p in self.parameters])
        information = self.jacobian.T @ self.jacobian + np.diag((steps / spread) ** 2)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        covariance = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True)
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale * steps
        return {p.name: float(s) for p, s in zip(self.parameters, sd, strict=True)}


@dataclass
class Problem:
    """One measurement of one axis, and how its residuals are weighed."""

    axis: Axis
    measurement: Measurement
    noise: Noise
    observer: Observer = field(init=False)
    runs: int = 0

    def __post_init__(self) -> None:
        inertia = chain_of(self.axis, {}).shafts[0].inertia_kg_m2
        self.observer = Observer(self.measurement, max(self.axis.load.inertia_kg_m2, 1e-12), inertia)
        start = {p.name: p.start for p in self.base()}
        self.observer.learn_noise(chain_of(self.axis, start), nuisance_of(start))

    @property
    def guided(self) -> bool:
        m = self.measurement
        return m.load_angle is not None and len(chain_of(self.axis, {}).links) > 0

    @property
    def guide_stride(self) -> int:
        return max(1, int(self.measurement.rate_hz / (4.0 * LOAD_CUT_HZ)))

    def base(self) -> tuple[Parameter, ...]:
        level = float(np.sqrt(np.mean(self.measurement.torque**2)))
        return base_parameters(self.axis, self.guided, level)

    def parameters(self, terms: Sequence[Term]) -> tuple[Parameter, ...]:
        """Those of the description that no term replaces, then those of the terms."""
        gone = {name for term in terms for name in term.replaces}
        return tuple(p for p in self.base() if p.name not in gone) + tuple(p for term in terms for p in term.parameters)

    def raw_residuals(
        self, terms: Sequence[Term], values: Mapping[str, float], *, weighted: bool = True
    ) -> tuple[Array, Array]:
        """Motor torque [N m], shape (n,), and guide torque [N m] on its own slower clock."""
        m = self.measurement
        self.runs += 1
        prediction = self.observer.predict(self.chain(terms, values), nuisance_of(values))
        torque = m.torque - prediction.torque
        for term in terms:
            if term.torque is not None:
                torque = torque - term.torque(m, values)
        guide = prediction.guide[:: self.guide_stride] if self.guided else np.zeros(0)
        if not weighted:
            return torque, guide
        return torque * m.weight, guide * m.load_weight[:: self.guide_stride] if guide.size else guide

    def residual(self, terms: Sequence[Term], values: Mapping[str, float]) -> Array:
        """Whitened residuals of all channels in one row."""
        torque, guide = self.raw_residuals(terms, values)
        return self.whiten(torque, guide)

    def whiten(self, torque: Array, guide: Array) -> Array:
        first = lfilter(self.noise.torque, np.ones(1), torque)
        return np.concatenate([first, lfilter(self.noise.guide, np.ones(1), guide)]) if guide.size else first

    def columns(
        self,
        terms: Sequence[Term],
        values: Mapping[str, float],
        parameters: Sequence[Parameter],
        base: Array,
        known: Mapping[str, Array] = MappingProxyType({}),
    ) -> Array:
        """Change of the whitened residual for one step of each parameter, shape (rows, parameters)."""

        def column(p: Parameter) -> Array:
            if p.name in known:
                return known[p.name]
            step = p.step if values[p.name] + p.step <= p.high else -p.step
            return (self.residual(terms, {**values, p.name: values[p.name] + step}) - base) * (p.step / step)

        with ThreadPoolExecutor(WORKERS) as pool:
            return np.stack(list(pool.map(column, parameters)), axis=1) if parameters else np.zeros((base.size, 0))

    def fit(
        self,
        terms: Sequence[Term] = (),
        start: Mapping[str, float] | None = None,
        iterations: int = 5,
        tolerance: float = 1e-3,
        frozen: Fit | None = None,
    ) -> Fit:
        """Levenberg-Marquardt from `start` (default: what is described).

        Sensitivities that `frozen` has already are taken from it: enough for comparing terms, at a tenth of the runs.
        """
        parameters = self.parameters(terms)
        known = _known_columns(frozen)
        values = {p.name: p.start for p in parameters}
        values.update({k: v for k, v in (start or {}).items() if k in values})
        before = self.runs
        residual = self.residual(terms, values)
        cost = _cost(residual, parameters, values)
        damping = 1e-3
        columns = np.zeros((residual.size, 0))
        for _round in range(iterations):
            columns = self.columns(terms, values, parameters, residual, known)
            improved = False
            for _ in range(6):
                trial = _stepped(parameters, values, residual, columns, damping)
                try:
                    new = self.residual(terms, trial)
                except ChainError:
                    damping *= 10.0
                    continue
                new_cost = _cost(new, parameters, trial)
                if new_cost < cost:
                    improved = True
                    break
                damping *= 10.0
            if not improved:
                break
            gain, values, residual, cost = cost - new_cost, trial, new, new_cost
            damping = max(damping / 10.0, 1e-7)
            if gain < tolerance * residual.size * 0.01 + 1e-4 * cost:
                break
        return Fit(tuple(terms), parameters, values, residual, columns, cost, self.runs - before)

    def chain(self, terms: Sequence[Term], values: Mapping[str, float]) -> Chain:
        chain = with_entries(chain_of(self.axis, values), self.axis)
        for term in terms:
            chain = term.apply(chain, values)
        return chain

    def learn_noise(self, fit: Fit) -> None:
        self.observer.learn_noise(self.chain(fit.terms, fit.values), nuisance_of(fit.values))

    def noise_of(self, fit: Fit) -> Noise:
        """Autoregressions fitted on the residual of `fit`."""
        torque, guide = self.raw_residuals(fit.terms, fit.values)
        m = self.measurement
        first = floor_filter(torque, m.weight, TORQUE_ORDER, int(m.rate_hz))
        second = np.ones(1)
        if guide.size:
            stride = self.guide_stride
            second = floor_filter(guide, m.load_weight[::stride], GUIDE_ORDER, int(m.rate_hz / stride))
        return Noise(first, second)

    def with_noise(self, noise: Noise) -> Problem:
        other = replace(self, noise=noise)
        other.observer = self.observer
        return other


def floor_filter(values: Array, weight: Array, order: int, block: int) -> Array:
    """Whitening filter (order + 1,) of the noise under a residual that may still hold effects.

    The lower quartile over blocks of the spectrum, at each frequency, then a running median over frequency: neither
    what comes and goes (reversals, passages of a tooth) nor lines of one order are taken for noise.
    """
    block = max(64, min(block, values.size // 8))
    window = np.hanning(block)
    starts = range(0, values.size - block + 1, block // 2)
    used = (
        [s for s in starts if weight[s : s + block].min() > 0.99]
        or [s for s in starts if weight[s : s + block].mean() > 0.6]
        or list(starts)
    )
    power = np.array([np.abs(np.fft.rfft(values[s : s + block] * window)) ** 2 for s in used]) / np.sum(window**2)
    floor = np.quantile(power, 0.25, axis=0) / -math.log(0.75)
    half = 4
    padded = np.concatenate([floor[half:0:-1], floor, floor[-2 : -2 - half : -1]])
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    correlation = np.fft.irfft(smooth)[: order + 1]
    correlation[0] = correlation[0] * (1.0 + 1e-6) + 1e-300
    weights = solve_toeplitz(correlation[:-1], correlation[1:])
    variance = float(correlation[0] - weights @ correlation[1:])
    return np.concatenate([[1.0], -weights]) / math.sqrt(max(variance, 1e-300))


def _known_columns(fit: Fit | None) -> dict[str, Array]:
    if fit is None:
        return {}
    return {p.name: fit.jacobian[:, k] for k, p in enumerate(fit.parameters)}


def _cost(residual: Array, parameters: Sequence[Parameter], values: Mapping[str, float]) -> float:
    known = sum(((values[p.name] - p.expected) / p.spread) ** 2 for p in parameters)
    return float(residual @ residual) + known


def _stepped(
    parameters: Sequence[Parameter], values: Mapping[str, float], residual: Array, columns: Array, damping: float
) -> dict[str, float]:
    steps = np.array([p.step for p in parameters])
    spread = np.array([p.spread for p in parameters])
    offset = np.array([values[p.name] - p.expected for p in parameters])
    gradient = -columns.T @ residual - offset * steps / spread**2
    information = columns.T @ columns + np.diag((steps / spread) ** 2)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-12))
    scaled = information / np.outer(scale, scale) + damping * np.eye(len(parameters))
    move = np.linalg.solve(scaled, gradient / scale) / scale * steps
    return {p.name: float(min(max(values[p.name] + d, p.low), p.high)) for p, d in zip(parameters, move, strict=True)}
