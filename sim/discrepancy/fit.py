"""Gauss-Newton on simulated outputs: residuals of every channel, whitened, against all parameters at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from threading import Lock
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg.blas import dger
from scipy.signal import oaconvolve

from sim.axis import Axis
from sim.chain_model import Chain, ChainError
from sim.discrepancy import rattle
from sim.discrepancy.catalogued import read_too_much
from sim.discrepancy.described import Described
from sim.discrepancy.entries import swinging
from sim.discrepancy.load_noise import LoadNoise
from sim.discrepancy.measurement import Measurement
from sim.discrepancy.model import base_parameters, chain_of, has_links, hums, locked_mode_hz, nuisance_of
from sim.discrepancy.observer import Observer
from sim.discrepancy.parameters import Parameter
from sim.discrepancy.terms import Term

Array = NDArray[np.float64]
Raw = tuple[Array, Array]  # motor torque and guide torque
Start = tuple[Mapping[str, float], Mapping[str, Raw]]  # numbers and sensitivities
Spectrum = NDArray[np.complex128]
A = TypeVar("A")
B = TypeVar("B")
SMOOTH_BINS = 4  # half of the running median over a noise spectrum, and at most this many hertz
WORKERS = 2
BY_CONTACT = ("backlash", "tooth_damage")  # mechanisms by which teeth leave each other
WITH_TEETH, WITHOUT = 0.25, 0.5  # quantile over blocks that is noise: without teeth little else comes and goes
SCORE_BLOCKS = 40
FEWEST_BLOCKS = 16  # for the quartile of a spectrum
MODE_BAND = 0.2  # around the load's own frequency
MODE_NOISE = 3.0  # power of the noise there over its floor, where no encoder sees the load
ACTIVE_ROUNDS = 4
MOST_STEPS = {False: 48, True: 16}  # by whether teeth hit: there the way is rough, and leads ever on
DAMPINGS = 8
FIRST_DAMPING = 1e-4
MISTAKEN = 5.0  # standard deviations off a data sheet, beyond which it has a number wrong
UNKNOWN = 1e-6  # information of one step below which a parameter is not known
BURST = 1e6  # times the torque: what a simulation that has burst is off by
HOPELESS = 30.0  # times the noise, in power: what two steps leave of a try that leads nowhere
LEAST_NOISE, LEAST_GUIDE_NOISE = 2e-3, 1.5e-4  # of the torque, and of that at the load: no drive measures better
LITTLE = 1e-3  # by which a way may count less and be left as it is
FORETOLD = 0.1  # of the gain of a step: sensitivities that are off by less are true there


@dataclass(frozen=True)
class Memory:
    """How long noise is taken to remember: whitening filters of `filter_s`, spectra over blocks of `block_s`.

    `least_drop`: of the squared residual in one step of a fit; less says nothing where the noise is known so roughly.
    """

    block_s: float
    filter_s: float
    least_drop: float


SHORT, LONG = Memory(1.0, 0.4, 2.0), Memory(4.0, 2.0, 1.0)


@dataclass(frozen=True)
class Noise:
    """Per channel a causal whitening filter and the level of the noise over time, relative to the filter's [1].

    `ways`, orthonormal, shape (torque rows, p): in them the whitened torque is noisier; `less`, shape (p,): the share
    by which they count less.
    """

    torque: Array
    guide: Array
    torque_level: Array = field(default_factory=lambda: np.ones(1))
    guide_level: Array = field(default_factory=lambda: np.ones(1))
    ways: Array = field(default_factory=lambda: np.zeros((0, 0)))
    less: Array = field(default_factory=lambda: np.zeros(0))
    _spectra: dict[tuple[str, int], Spectrum] = field(init=False, repr=False, compare=False, default_factory=dict)

    @staticmethod
    def flat(torque_sd: float, guide_sd: float) -> Noise:
        return Noise(np.array([1.0 / torque_sd]), np.array([1.0 / guide_sd]))

    def whiten(self, torque: Array, guide: Array) -> Array:
        """Both residuals in one row, white and of unit level."""
        first = self._filtered("torque", torque) / self.torque_level
        if self.less.size:
            first -= self.ways @ (self.less * (self.ways.T @ first))
        if not guide.size:
            return first
        return np.concatenate([first, self._filtered("guide", guide) / self.guide_level])

    def log_scale(self, torque_rows: int, guide_rows: int) -> float:
        """Twice the log of how much larger residuals are than white ones: fits under different noise are as likely as
        the sum of this and their cost is small. The first tap of a minimum phase filter is its geometric mean."""
        loud = [(self.torque, self.torque_level, torque_rows), (self.guide, self.guide_level, guide_rows)]
        return -2.0 * float(np.sum(np.log1p(-self.less))) + sum(
            2.0 * rows * (float(np.mean(np.log(level))) - math.log(abs(taps[0]))) for taps, level, rows in loud if rows
        )

    def doubting(self, unsure: Array) -> Noise:
        """The same where the torque may also be wrong as a whole by each column of `unsure`, shape (rows, p) [N m]."""
        if not unsure.size:
            return self
        white = np.stack([self._filtered("torque", column) / self.torque_level for column in unsure.T], axis=1)
        ways, size, _ = np.linalg.svd(white, full_matrices=False)
        less = 1.0 - 1.0 / np.hypot(1.0, size)
        return replace(self, ways=np.ascontiguousarray(ways[:, less > LITTLE]), less=less[less > LITTLE])

    def _filtered(self, channel: str, values: Array) -> Array:
        """By one transform: the filter's own is kept, as nearly all signals of a channel have one length.

        What was before the first row is taken for its mirror: slow noise does not begin with the record.
        """
        taps: Array = getattr(self, channel)
        if taps.size == 1:
            return np.asarray(taps[0] * values)
        before = values[taps.size - 1 : 0 : -1]
        padded = np.concatenate([before, values])
        size = next_fast_len(padded.size + taps.size - 1, real=True)
        if (channel, size) not in self._spectra:
            self._spectra[channel, size] = rfft(taps, size)
        return np.asarray(irfft(rfft(padded, size) * self._spectra[channel, size], size)[before.size : padded.size])


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
    def strain(self) -> float:
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

    def blocks(self, count: int) -> list[NDArray[np.int64]]:
        """Rows of each of `count` equal parts of the time, of both channels."""
        torque = np.linspace(0, self.torque_rows, count + 1).astype(np.int64)
        guide = np.linspace(self.torque_rows, self.residual.size, count + 1).astype(np.int64)
        return [
            np.concatenate([np.arange(a, b), np.arange(c, d)])
            for (a, b), (c, d) in zip(pairwise(torque), pairwise(guide), strict=True)
        ]

    @cached_property
    def _influence(self) -> tuple[Array, Array]:
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
        curved, pulls = self._influence
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


def each(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """`function` of all items, in order, on all cores: the simulation leaves the interpreter alone."""
    with ThreadPoolExecutor(WORKERS) as pool:
        return list(pool.map(function, items))


@dataclass
class Runs:
    """How often was simulated."""

    count: int = 0
    lock: Lock = field(default_factory=Lock)

    def add(self) -> None:
        with self.lock:
            self.count += 1


@dataclass
class Problem:
    """One measurement of one axis, and how its residuals are weighed; `runs` are those of all that is made of it.

    `doubts`: how many times less well numbers are known that a data sheet seems to have wrong.
    """

    axis: Axis
    measurement: Measurement
    noise: Noise
    memory: Memory = SHORT
    observer: Observer = field(init=False)
    described: Described = field(init=False)
    swinging: Array = field(init=False)
    read_too_much: Array = field(init=False)
    load_noise: LoadNoise | None = field(init=False)
    runs: Runs = field(default_factory=Runs)
    doubts: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        inertia = chain_of(self.axis, {}).shafts[0].inertia_kg_m2
        self._describe()
        self.observer = Observer(self.measurement, max(self.axis.load.inertia_kg_m2, 1e-12), inertia)
        start = self.numbers()
        self.observer.learn_noise(chain_of(self.axis, start), nuisance_of(start), hits=self.hits(()))

    def _describe(self) -> None:
        self.described = Described.by(self.axis)
        self.swinging = swinging(self.axis, self.measurement)
        self.read_too_much = read_too_much(self.axis, self.measurement)
        self._hear()

    def _hear(self) -> None:
        self.load_noise = LoadNoise.under(self.axis, self.measurement, self.noise.guide) if self.guided else None

    def of(self, axis: Axis) -> Problem:
        """The same measurement, noise included, held against another description."""
        other = copy(self)
        other.axis = axis
        other._describe()
        return other

    def hits(self, terms: Sequence[Term]) -> bool:
        """Whether teeth leave each other and meet again, by a term or as described."""
        return any(t.contact for t in terms) or self.described.contact

    @property
    def guided(self) -> bool:
        m = self.measurement
        return m.load_angle is not None and has_links(self.axis)

    def base(self) -> tuple[Parameter, ...]:
        m = self.measurement
        parameters = base_parameters(self.axis, self.guided, m.torque_rms, m.rests)
        return tuple(p.doubted(self.doubts[p.name]) if p.name in self.doubts else p for p in parameters)

    def parameters(self, terms: Sequence[Term]) -> tuple[Parameter, ...]:
        """Those of the description that no term replaces, then what the terms bring along, then their own."""
        gone = {name for term in terms for name in term.replaces}
        kept = {p.name: p for p in self.base() if p.name not in gone}
        brought = {p.name: p for term in terms for p in term.brings}
        return tuple({**kept, **brought}.values()) + tuple(p for term in terms for p in term.parameters)

    def numbers(self, terms: Sequence[Term] = ()) -> dict[str, float]:
        """All parameters as they are described, those of `terms` at none of them."""
        return {p.name: p.start for p in self.parameters(terms)}

    def raw_residuals(
        self, terms: Sequence[Term], values: Mapping[str, float], *, weighted: bool = True
    ) -> tuple[Array, Array]:
        """Motor torque [N m], shape (n,), and guide torque [N m] on its own slower clock."""
        m = self.measurement
        self.runs.add()
        prediction = self.observer.predict(self.chain(terms, values), nuisance_of(values))
        torque = m.torque - self.read_too_much - prediction.torque
        for name, frequency_hz, _ in hums(self.axis):
            turn = 2.0 * np.pi * frequency_hz * m.time_s
            torque = torque - values[f"{name}.sine"] * np.sin(turn) - values[f"{name}.cosine"] * np.cos(turn)
        for term in terms:
            if term.torque is not None:
                torque = torque - term.torque(m, values)
        guide = np.zeros(0)
        if self.guided:
            lacking = prediction.guide + self.swinging
            for term in terms:
                if term.load_torque is not None:
                    lacking = lacking - term.load_torque(m, values)
            guide = m.thinned(lacking)
        if not math.isfinite(float(torque @ torque) + float(guide @ guide)):
            torque, guide = (_within(BURST * float(np.std(m.torque)), x) for x in (torque, guide))
        if not weighted:
            return torque, guide
        if self.load_noise is not None:
            guide = guide * m.load_weight[:: m.load_stride] * self.load_noise.factor(terms, values)
        return m.bridge.across(torque) * m.counts, guide

    def residual(self, terms: Sequence[Term], values: Mapping[str, float]) -> Array:
        """Whitened residuals of all channels in one row."""
        torque, guide = self.raw_residuals(terms, values)
        return self.noise.whiten(torque, guide)

    def sensitivities(
        self, terms: Sequence[Term], values: Mapping[str, float], parameters: Sequence[Parameter], base: Raw
    ) -> dict[str, Raw]:
        """Change of both residuals per unit of each parameter; `base` are those at `values`."""

        def column(p: Parameter) -> Raw:
            step = _inwards(p, values[p.name])
            torque, guide = self.raw_residuals(terms, {**values, p.name: values[p.name] + step})
            return (torque - base[0]) / step, (guide - base[1]) / step

        return dict(zip((p.name for p in parameters), each(column, parameters), strict=True))

    def whitened(self, parameters: Sequence[Parameter], raw: Mapping[str, Raw]) -> Array:
        """Columns of `raw` whitened, per step of each parameter, shape (rows, parameters)."""
        rows = sum(part.size for part in next(iter(raw.values()))) if raw else 0
        out = np.empty((rows, len(parameters)), order="F")

        def fill(k: int) -> None:
            out[:, k] = self.noise.whiten(*raw[parameters[k].name]) * parameters[k].step

        each(fill, range(len(parameters)))
        return out

    def fit(
        self,
        terms: Sequence[Term] = (),
        start: Mapping[str, float] | None = None,
        iterations: int = 6,
        held: Mapping[str, Raw] = MappingProxyType({}),
        *,
        to_end: bool = False,
    ) -> Fit:
        """Levenberg-Marquardt from `start` (default: what is described), by sensitivities that are kept (chord method).

        `held`: sensitivities known from a fit nearby. Those of terms whose effect is far from linear follow every
        step; `to_end`, all others are taken anew whenever the steps by the old ones gain no more, until steps by new
        ones gain nothing either: what an unfinished fit leaves looks like whatever is added to it. New ones stay as
        good as new while they foretell what steps gain; those of the end are taken there, since what is foretold of
        unseen rows hangs on them. A fit that is not finished also ends where two steps leave it far above the noise.
        """
        parameters = self.parameters(terms)
        follow = {p.name for term in terms if term.nonlinear for p in term.parameters}
        values = {p.name: p.start for p in parameters}
        values.update({k: v for k, v in (start or {}).items() if k in values})
        values = {p.name: min(max(values[p.name], p.low), p.high) for p in parameters}
        raw = self.raw_residuals(terms, values)
        state = _State(values, raw, self.noise.whiten(*raw), 0.0)
        state.cost = _cost(state.residual, parameters, values)
        acts = {name for name, column in held.items() if any(part.any() for part in column)}  # what did not, may now
        known = {p.name: held[p.name] for p in parameters if p.name in acts - follow}
        known |= self.sensitivities(terms, values, [p for p in parameters if p.name not in known], raw)
        columns = self.whitened(parameters, known)
        system = _System.of(parameters, columns)
        damping, anew, corrected = FIRST_DAMPING, False, False
        for round_ in range(MOST_STEPS[self.hits(terms)] if to_end else iterations):
            old = replace(state)
            gain, damping = self._step(terms, parameters, state, system, damping)
            small = gain < self.memory.least_drop + 1e-4 * max(0.0, state.cost - state.residual.size)
            if small and (anew or not to_end):
                state = state if corrected else old  # where the sensitivities were taken
                break
            if not to_end and round_ > 0 and state.cost > HOPELESS * state.residual.size:
                break
            anew = small or (anew and abs(system.promised(parameters, old, state) - gain) < FORETOLD * gain)
            changed = [p for p in parameters if p.name in follow or small]
            if small:
                damping = FIRST_DAMPING
            else:
                _correct(parameters, known, columns, old, state)
            corrected = not small
            if changed:
                known |= self.sensitivities(terms, state.values, changed, state.raw)
                columns[:, [parameters.index(p) for p in changed]] = self.whitened(changed, known)
            system = _System.of(parameters, columns)
        if to_end and corrected:
            known = self.sensitivities(terms, state.values, parameters, state.raw)
            columns = self.whitened(parameters, known)
        return Fit(
            tuple(terms), parameters, state.values, state.residual, columns, state.cost, self.measurement.samples, known
        )

    def best(self, terms: Sequence[Term], starts: Sequence[Start], *, to_end: bool = True) -> Fit | None:
        """The best fit from several starts, each with the sensitivities known there; None where none can be simulated.

        Where teeth come loose and meet again, the way to the least squares is rough.
        """

        def fitted(start: Start) -> Fit | None:
            values, held = start
            try:
                return self.fit(terms, values, held=held, to_end=to_end)
            except ChainError:
                return None

        return min((f for f in each(fitted, starts) if f), key=lambda f: f.cost, default=None)

    def _step(
        self, terms: Sequence[Term], parameters: Sequence[Parameter], state: _State, system: _System, damping: float
    ) -> tuple[float, float]:
        """Move `state` to a smaller cost if there is one on the way; its gain and the next damping.

        Two dampings at a time, on two cores, of which the better is taken; none further once so little is promised
        that it would end the fit.
        """
        pull = system.columns.T @ state.residual

        def tried(damping: float) -> _State | None:
            values = system.stepped(parameters, state.values, pull, damping)
            try:
                raw = self.raw_residuals(terms, values)
            except ChainError:
                return None
            residual = self.noise.whiten(*raw)
            return _State(values, raw, residual, _cost(residual, parameters, values))

        for _ in range(DAMPINGS // 2):
            dampings = (damping, 10.0 * damping)
            trials = [(t, d) for t, d in zip(each(tried, dampings), dampings, strict=True) if t]
            best, by = min(trials, key=lambda trial: trial[0].cost, default=(state, damping))
            if best.cost < state.cost:
                gain = state.cost - best.cost
                state.values, state.raw, state.residual, state.cost = best.values, best.raw, best.residual, best.cost
                return gain, max(by / 10.0, 1e-7)
            if trials and system.promised(parameters, state, trials[-1][0]) < self.memory.least_drop:
                break
            damping *= 100.0
        return 0.0, damping

    def chain(self, terms: Sequence[Term], values: Mapping[str, float]) -> Chain:
        chain = self.described.apply(chain_of(self.axis, values))
        for term in terms:
            chain = term.apply(chain, values)
        return chain

    def learned(self, fit: Fit) -> Problem:
        """The same with what the encoders' noise makes of the chain of `fit`, under what `fit` leaves as noise.

        What `fit` bends beyond `MISTAKEN` deviations the data sheet has wrong: it costs their square, and hardly more.
        Of the chain as new where a term is far from linear: what noise makes of teeth that hit and leave each other
        hangs on when they do, and kept from one fit it would hold every other to the same hits.
        """
        other = copy(self)
        other.observer = copy(self.observer)
        terms = tuple(t for t in fit.terms if not t.contact)
        values = self.numbers(terms) | dict(fit.values)
        other.observer.learn_noise(self.chain(terms, values), nuisance_of(values), hits=self.hits(fit.terms))
        other.doubts = {}
        far = {p.name: p.deviation(fit.values) / MISTAKEN for p in other.base() if p.stated and p.name in fit.values}
        other.doubts = {name: times for name, times in far.items() if times > 1.0}
        return other.with_noise(other.noise_of(fit))

    def unlikelihood(self, fit: Fit) -> float:
        """Minus twice the log likelihood of `fit` with what is known of its numbers, but for a constant."""
        doubted = 2.0 * sum(math.log(times) for times in self.doubts.values())
        return fit.cost + doubted + self.noise.log_scale(fit.torque_rows, fit.residual.size - fit.torque_rows)

    def noise_of(self, fit: Fit) -> Noise:
        """Filters that make the noise under the residual of `fit` white."""
        torque, guide = self.raw_residuals(fit.terms, fit.values)
        m = self.measurement
        unseen, teeth = has_links(self.axis) and not self.guided, bool(self.axis.stages)
        mode_hz = locked_mode_hz(self.axis) if unseen else None
        least = LEAST_NOISE * m.torque_rms
        first, level = _whitener(torque, m.weight, m.rate_hz, self.memory, mode_hz, teeth=teeth, least=least)
        unsure = m.unsure
        if unsure.size:
            unsure = np.stack([m.bridge.across(column) * m.counts for column in unsure.T], axis=1)
        if not guide.size:
            return Noise(first, np.ones(1), level).doubting(unsure)
        stride = m.load_stride
        least = LEAST_GUIDE_NOISE * m.torque_rms * self.axis.ratio
        weight, rate_hz = m.load_weight[::stride], m.rate_hz / stride
        second, other = _whitener(guide, weight, rate_hz, self.memory, teeth=teeth, least=least)
        return Noise(first, second, level, other).doubting(unsure)

    def measuring(self, measurement: Measurement) -> Problem:
        """The same of other rows, or of another torque, along the same motion."""
        other = copy(self)
        other.measurement = measurement
        return other

    def down_to(self, standstill: float) -> Problem:
        """The same with the rows that are faster than this share of the largest speed and no others."""
        return self.measuring(replace(self.measurement, standstill=standstill, rests=False))

    def resting(self, fit: Fit) -> Problem:
        """The same with the rows at rest, where `fit` can say what friction holds there.

        Ahead of gears, whose encoder sees how far friction gives way before it slides, and while no teeth leave each
        other, which they do first at rest.
        """
        rests = bool(self.axis.stages) and not self.hits(fit.terms)
        return self.measuring(replace(self.measurement, rests=rests))

    def told(self, terms: Sequence[Term], values: Mapping[str, float]) -> Problem:
        """The same without the rows whose torque this model cannot tell.

        Teeth that nothing presses together rattle in the play that is as new, and any change of a number changes all
        that they do from there on: what is left there says nothing, and no sensitivity is true. Play and dents that
        are there show in the same rows.
        """
        other = self.with_all_told()
        if not self.axis.stages or self.hits(terms):
            return other
        parameters = self.parameters(terms)
        values = {p.name: values.get(p.name, p.start) for p in parameters}
        rows = self.measurement.samples
        kicked = [
            other.residual(terms, {p.name: values[p.name] + kick * _inwards(p, values[p.name]) for p in parameters})
            for kick in (0.0, rattle.KICK, 2.0 * rattle.KICK)
        ]
        counts = rattle.told([left[:rows] for left in kicked], self.measurement.rate_hz)
        return other.measuring(replace(other.measurement, told=counts))

    def with_all_told(self) -> Problem:
        """The same with the rows in which teeth rattle."""
        return self.measuring(replace(self.measurement, told=np.ones(1)))

    def remembering(self, memory: Memory) -> Problem:
        """The same for noise that is taken anew to remember otherwise."""
        other = copy(self)
        other.memory = memory
        return other

    def doubting(self, times: Mapping[str, float]) -> Problem:
        """The same with numbers of the description known so many times less well."""
        other = copy(self)
        other.doubts = {**self.doubts, **{name: self.doubts.get(name, 1.0) * more for name, more in times.items()}}
        return other

    def with_noise(self, noise: Noise) -> Problem:
        other = copy(self)
        other.noise = noise
        other._hear()
        return other


def _whitener(
    values: Array,
    weight: Array,
    rate_hz: float,
    memory: Memory,
    mode_hz: float | None = None,
    *,
    teeth: bool,
    least: float,
) -> tuple[Array, Array]:
    """Filter and level over time of the noise under `values`, of `least` at least; it counts less around `mode_hz`.

    What shakes the load shakes it at its own frequency, and the drive answers: there the motor's motion, from which the
    torque is predicted, is not independent of the noise, and a fit would damp the load to make it quiet.
    """
    deaf = None if mode_hz is None else mode_hz / rate_hz * np.array([1.0 - MODE_BAND, 1.0 + MODE_BAND])
    block, length = int(memory.block_s * rate_hz), int(memory.filter_s * rate_hz)
    smooth = int(SMOOTH_BINS * memory.block_s)
    taps = floor_filter(values, weight, block, length, deaf, teeth=teeth, smooth=smooth, least=least)
    white = oaconvolve(values, taps)[: values.size]
    level = level_over_time(white, weight, int(rate_hz))
    if not teeth:
        return taps, level
    moving = np.abs(white / level)[weight > 0.5]
    if not moving.size:
        return taps, level
    # quartiles over few blocks lie high where the floor is steep: half of all rows are below 0.67 deviations
    return taps, level * max(min(1.0, 1.4826 * float(np.median(moving))), least * float(taps[0]))


def level_over_time(white: Array, weight: Array, block: int) -> Array:
    """Deviation of whitened noise by the median over blocks and their neighbours, shape (n,), at least 1.

    Noise may come in bursts or grow with speed; by medians, what an effect does at reversals or teeth is left alone.
    """
    count = max(1, white.size // block)
    edges = np.linspace(0, white.size, count + 1).astype(np.int64)
    levels = np.ones(count)
    for k in range(count):
        part = slice(int(edges[max(k - 1, 0)]), int(edges[min(k + 2, count)]))
        used = np.abs(white[part][weight[part] > 0.5])
        if used.size > 20:
            levels[k] = 1.4826 * float(np.median(used))
    centres = 0.5 * (edges[1:] + edges[:-1])
    return np.asarray(np.maximum(np.interp(np.arange(white.size), centres, levels), 1.0), dtype=np.float64)


def floor_filter(
    values: Array,
    weight: Array,
    block: int,
    length: int,
    deaf: Array | None = None,
    *,
    teeth: bool = True,
    smooth: int = SMOOTH_BINS,
    least: float = 0.0,
) -> Array:
    """Whitening filter (length,) of the noise under a residual that may still hold effects.

    The lower quartile over blocks of the spectrum, at each frequency, then a running median over frequency: neither
    what comes and goes (reversals, passages of a tooth) nor lines of one order are taken for noise. Without `teeth` the
    median over all blocks: the steps of an encoder are quiet at even speed and loud while it changes.
    `deaf`: ends of a band [1 over a sample] in which the noise is taken for louder than it is. `least`: deviation of
    white noise that is there in any case, in the unit of `values`.
    """
    wanted, block = block, max(64, min(block, values.size // 4))
    smooth = max(SMOOTH_BINS, smooth * block // wanted)
    window = np.hanning(block)
    starts = range(0, values.size - block + 1, block // 2)
    used = [s for s in starts if weight[s : s + block].min() > 0.99]
    if len(used) < FEWEST_BLOCKS or not teeth:
        used = [s for s in starts if weight[s : s + block].mean() > 0.6] or list(starts)
    power = np.array(
        [
            np.abs(np.fft.rfft(values[s : s + block] * window)) ** 2
            / max(float(np.sum((window * weight[s : s + block]) ** 2)), 1e-300)
            for s in used
        ]
    )
    share = WITH_TEETH if teeth else WITHOUT
    floor = np.quantile(power, share, axis=0) / -math.log(1.0 - share)
    level = np.maximum(running_median(floor, smooth), least**2)
    if deaf is not None:
        place = np.arange(level.size) / block
        level[(place > deaf[0]) & (place < deaf[1])] *= MODE_NOISE
    return minimum_phase(1.0 / np.maximum(level, 1e-9 * level.max() + 1e-300), length)


def running_median(values: Array, most: int) -> Array:
    """Of half its place to either side, between SMOOTH_BINS and `most`: slow noise is steep over frequency."""
    padded = np.concatenate([values[most:0:-1], values, values[-2 : -2 - most : -1]])
    places = np.arange(values.size)
    reach = np.clip(places // 2, SMOOTH_BINS, most)
    out = np.empty(values.size)
    for half in np.unique(reach):
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * int(half) + 1)
        mine = places[reach == half]
        out[mine] = np.median(windows[mine + most - half], axis=1)
    return out


def minimum_phase(power: Array, length: int) -> Array:
    """Causal filter (length,) whose squared gain is `power` on an even grid from 0 to half the rate, by its cepstrum.

    Its first tap is the geometric mean of the gain: white noise stays as likely as it was.
    """
    cepstrum = np.fft.irfft(0.5 * np.log(power))
    size = cepstrum.size
    fold = np.zeros(size)
    fold[0], fold[1 : size // 2], fold[size // 2] = 1.0, 2.0, 1.0
    taps = np.fft.irfft(np.exp(np.fft.rfft(cepstrum * fold)), size)
    return np.asarray(taps[: min(length, size // 2)])


def _within(far: float, values: Array) -> Array:
    """No further from 0 than `far`: numbers with which a simulation bursts are worse than any others, and no error."""
    return np.clip(np.nan_to_num(values, nan=far), -far, far)


def _inwards(parameter: Parameter, value: float) -> float:
    """The parameter's step, backwards where it would lead beyond what is allowed."""
    return parameter.step if value + parameter.step <= parameter.high else -parameter.step


def _cost(residual: Array, parameters: Sequence[Parameter], values: Mapping[str, float]) -> float:
    known = sum(p.deviation(values) ** 2 for p in parameters)
    return float(residual @ residual) + known


@dataclass
class _State:
    """Where a fit stands."""

    values: Mapping[str, float]
    raw: Raw
    residual: Array
    cost: float


def _correct(parameters: Sequence[Parameter], known: dict[str, Raw], columns: Array, old: _State, new: _State) -> None:
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
class _System:
    """Normal equations of one set of sensitivities."""

    columns: Array
    information: Array
    steps: Array
    spread: Array

    @staticmethod
    def of(parameters: Sequence[Parameter], columns: Array) -> _System:
        steps = np.array([p.step for p in parameters])
        spread = np.array([p.spread for p in parameters])
        return _System(columns, columns.T @ columns + np.diag((steps / spread) ** 2), steps, spread)

    def _descent(self, parameters: Sequence[Parameter], values: Mapping[str, float], pull: Array) -> Array:
        """Half of how the cost falls per step of each parameter, shape (p,); `pull`: columns times residual."""
        offset = np.array([values[p.name] - p.expected for p in parameters])
        return np.asarray(-pull - offset * self.steps / self.spread**2)

    def promised(self, parameters: Sequence[Parameter], old: _State, new: _State) -> float:
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
