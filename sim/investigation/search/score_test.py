"""What terms promise before one is fitted: least squares on simulated changes, the rest of the model following."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import lsq_linear

from sim.chain.model import Array, ChainError
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.parallel import each

Screened = tuple[float, Term, Mapping[str, float]]
BESIDE_HZ = 3.0  # to either side of a line, where others may be


def screen(problem: Problem, fit: Fit, terms: Sequence[Term]) -> list[Screened]:
    """What each start of each term promises in the linear picture, with the rest of the model free to follow."""
    left, rate_hz = fit.residual[: fit.torque_rows], problem.measurement.rate_hz
    power = np.abs(np.fft.rfft(left)) ** 2
    m = problem.measurement
    speed = np.where(m.weight > 0.5, np.abs(m.speed), np.nan)
    rest = {gone: Rest.of(fit, gone) for gone in {term.replaces for term in terms}}

    def promise(job: tuple[Term, tuple[Mapping[str, float], ...]]) -> tuple[float, Term, Mapping[str, float]]:
        term, group = job
        line = term.frequency_hz
        if line is not None and not (is_line(left, power, rate_hz, line) and keeps_on(left, rate_hz, line, speed)):
            return 0.0, term, {}
        values = {**{p.name: p.start for p in (*term.brings, *term.parameters)}, **fit.values}
        changes = []
        for jump in group:
            try:
                changed = problem.residual((*fit.terms, term), {**values, **jump})
            except ChainError:
                return 0.0, term, {}
            changes.append(changed - fit.residual)
        block = np.stack(changes)
        if not np.isfinite(block).all():
            return 0.0, term, {}
        own, pull, relief = rest[term.replaces].against(block, fit.residual)
        share = np.ones(1) if term.contact else least_squares_within(own, pull, lowest_shares(term, group, values))
        if term.positive and share[0] <= 0.0:
            return 0.0, term, {}
        drop = float(2.0 * share @ pull - share @ own @ share)
        return drop + relief, term, {**values, **start_of(term, group, share, values)}

    jobs = [(term, group) for term in terms for group in term.probes]
    out = each(promise, jobs)
    return sorted(out, key=lambda o: (-o[0], str(o[1].key)))


def is_line(left: Array, power: Array, rate_hz: float, frequency_hz: float) -> bool:
    """Whether a whitened residual (n,) of this spectrum has more at a frequency than anywhere beside it.

    Hum is a line alone. A motion that repeats makes a comb of them, and where noise that is not quite white is loud all
    around, a sine of any frequency gains.
    """
    time = np.arange(left.size) / rate_hz
    there = abs(np.sum(left * np.exp(-2j * math.pi * frequency_hz * time))) ** 2
    apart = np.abs(np.fft.rfftfreq(left.size, 1.0 / rate_hz) - frequency_hz)
    beside = power[(apart > 2.0 * rate_hz / left.size) & (apart < BESIDE_HZ)]
    return bool(there > float(beside.max(initial=0.0)))


def keeps_on(left: Array, rate_hz: float, frequency_hz: float, speed: Array) -> bool:
    """Whether one sine at every speed explains a whitened residual (n,) better than one at slow or at fast rows alone.

    Hum does not know whether the axis moves; what the motion shakes or turns at a frequency is there while it does. All
    three models have a sine and a cosine, so that the squares they take away are compared as they are. `speed`: size of
    it in the rows that count (n,), else not a number.
    """
    wave = left * np.exp(-2j * math.pi * frequency_hz / rate_hz * np.arange(left.size))
    middle = float(np.nanmedian(speed))
    always, slowly, fast = (
        abs(wave[rows].sum()) ** 2 / max(int(rows.sum()), 1)
        for rows in (np.isfinite(speed), speed < middle, speed >= middle)
    )
    return bool(always >= max(slowly, fast))


@dataclass(frozen=True)
class Rest:
    """The model around a new term, in the linear picture, without the parameters whose place it takes.

    What is at a limit stays there: free to pass it, it would take away what the term is there for. `relief`: what
    those whose place is taken cost by what was known of them.
    """

    columns: Array
    scale: Array
    factor: tuple[Array, bool]
    gradient: Array
    relief: float

    @staticmethod
    def of(fit: Fit, gone: Sequence[str]) -> Rest:
        offset = np.array([(fit.values[p.name] - p.expected) / p.spread for p in fit.parameters])
        stays = np.array([p.name not in gone for p in fit.parameters])
        follows = stays & ~fit.at_limit
        columns = fit.jacobian[:, follows]
        steps = np.array([p.step / p.spread for p in fit.parameters])[follows]
        information = columns.T @ columns + np.diag(steps**2)
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        factor = cho_factor(information / np.outer(scale, scale) + 1e-10 * np.eye(scale.size))
        gradient = (columns.T @ fit.residual + steps * offset[follows]) / scale
        return Rest(columns, scale, factor, gradient, float(np.sum(offset[~stays] ** 2)))

    def against(self, block: Array, residual: Array) -> tuple[Array, Array, float]:
        """Curvature (k, k) and slope (k,) of the squares over shares of the changes `block` (k, rows)."""
        shared = (block @ self.columns) / self.scale
        absorbed = cho_solve(self.factor, shared.T)
        own = block @ block.T - shared @ absorbed
        return own, -(block @ residual - self.gradient @ absorbed), self.relief


def lowest_shares(term: Term, group: Sequence[Mapping[str, float]], values: Mapping[str, float]) -> Array:
    """Share of each jump at which its number is as low as it may be, shape (jumps,)."""
    low = {p.name: p.low for p in term.parameters}
    out = np.full(len(group), -np.inf)
    for k, jump in enumerate(group):
        name, value = next(iter(jump.items()))
        if not term.nonlinear and len(jump) == 1 and value > values[name]:
            out[k] = (low[name] - values[name]) / (value - values[name])
    return out


def least_squares_within(matrix: Array, pull: Array, low: Array) -> Array:
    """Minimiser of x' matrix x - 2 x' pull with x >= `low`, shape (k,); a touch of ridge where columns are alike."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale) + 1e-6 * np.eye(scale.size)
    root = np.linalg.cholesky(scaled)
    goal = np.linalg.solve(root, pull / scale)
    if not np.isfinite(low).any():
        return np.asarray(np.linalg.solve(root.T, goal) / scale)
    return np.asarray(lsq_linear(root.T, goal, (low * scale, np.inf)).x / scale)


def start_of(
    term: Term, group: tuple[Mapping[str, float], ...], share: Array, values: Mapping[str, float]
) -> dict[str, float]:
    """Jump as far as the linear picture says.

    Of what cannot be linear no further than the probe; where teeth leave each other, to the probe.
    """
    limits = {p.name: p for p in (*term.parameters, *term.brings)}
    if term.contact:
        return dict(group[0])
    out: dict[str, float] = {}
    for jump, part in zip(group, share, strict=True):
        for index, (name, value) in enumerate(jump.items()):
            part_of_jump = float(np.clip(part, 0.1, 1.5)) if term.positive else float(part)
            scaled = values[name] + part_of_jump * (value - values[name])
            out[name] = scaled if index == len(jump) - 1 or not term.positive else value
        if term.positive and len(jump) > 1:
            first = next(iter(jump))
            out = {**jump, first: jump[first] * float(np.clip(part, 0.1, 3.0))}
    return {name: min(max(v, limits[name].low), limits[name].high) for name, v in out.items()}
