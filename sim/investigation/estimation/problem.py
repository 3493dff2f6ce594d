"""Gauss-Newton on simulated outputs: residuals of every channel, whitened, against all parameters at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from threading import Lock
from types import MappingProxyType

import numpy as np

from sim.chain.model import Chain, ChainError
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import KICK, Measurement, linear_rows
from sim.investigation.estimation.doubts import by_doubts
from sim.investigation.estimation.estimate import Array, Fit, Raw, Start
from sim.investigation.estimation.levenberg_marquardt import (
    DAMPINGS,
    FIRST_DAMPING,
    FORETOLD,
    HOPELESS,
    MOST_STEPS,
    NormalEquations,
    State,
    broyden_update,
    cost_of,
)
from sim.investigation.estimation.load_noise import LoadNoise
from sim.investigation.estimation.whitening import SHORT, Memory, Noise, whitener
from sim.investigation.hypotheses.generic import read_too_much
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.effects import swinging
from sim.investigation.model.known_mechanisms import Described
from sim.investigation.model.nominal import base_parameters, chain_of, has_links, hums, locked_mode_hz, nuisance_of
from sim.investigation.model.observer import Observer
from sim.investigation.model.parameters import Parameter, Stated
from sim.investigation.parallel import each

MISTAKEN = 5.0  # standard deviations off a data sheet, beyond which it has a number wrong
BURST = 1e6  # times the torque: what a simulation that has burst is off by
LEAST_NOISE, LEAST_GUIDE_NOISE = 2e-3, 1.5e-4  # of the torque, and of that at the load: no drive measures better


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

    `doubts`: how many times less well numbers are known that a data sheet seems to have wrong; `unknown`: numbers that
    no data sheet has.
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
    unknown: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        inertia = chain_of(self.axis, {}).shafts[0].inertia_kg_m2
        self._describe()
        self.observer = Observer(self.measurement, max(self.axis.load.inertia_kg_m2, 1e-12), inertia)
        start = self.numbers()
        self.observer.learn_noise(
            chain_of(self.axis, start), nuisance_of(start), has_contact_loss=self.has_contact_loss(())
        )

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

    def has_contact_loss(self, terms: Sequence[Term]) -> bool:
        """Whether teeth leave each other and meet again, by a term or as described."""
        return any(t.contact for t in terms) or self.described.contact

    @property
    def guided(self) -> bool:
        m = self.measurement
        return m.load_angle is not None and has_links(self.axis)

    def base(self) -> tuple[Parameter, ...]:
        m = self.measurement
        parameters = base_parameters(self.axis, self.guided, m.torque_rms, m.rests, of_joint=m.doubts.size > 0)
        known = (p.unknown() if p.name in self.unknown else p for p in parameters)
        return tuple(p.doubted(self.doubts[p.name]) if p.name in self.doubts else p for p in known)

    def parameters(self, terms: Sequence[Term]) -> tuple[Parameter, ...]:
        """Those of the description that no term replaces, then what the terms bring along, then their own."""
        gone = {name for term in terms for name in term.replaces}
        kept = {p.name: p for p in self.base() if p.name not in gone}
        brought = {p.name: p for term in terms for p in term.brings if p.name not in kept}
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
        with np.errstate(over="ignore", invalid="ignore"):  # of a simulation that has burst
            size = float(torque @ torque) + float(guide @ guide)
        if not math.isfinite(size):
            torque, guide = (_within(BURST * float(np.std(m.torque)), x) for x in (torque, guide))
        if not weighted:
            return torque, guide
        if self.load_noise is not None:
            guide = guide * m.load_weight[:: m.load_stride] * self.load_noise.factor(terms, values)
        return m.across(torque), guide

    def white(self, raw: Raw) -> Array:
        """Both residuals in one row, white and of unit level, 0 in rests."""
        return self.noise.whiten(*raw, self.measurement.awake)

    def residual(self, terms: Sequence[Term], values: Mapping[str, float]) -> Array:
        """Whitened residuals of all channels in one row."""
        return self.white(self.raw_residuals(terms, values))

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
            out[:, k] = self.white(raw[parameters[k].name]) * parameters[k].step

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
        state = State(values, raw, self.white(raw), 0.0)
        state.cost = cost_of(state.residual, parameters, values)
        acts = {name for name, column in held.items() if any(part.any() for part in column)}  # what did not, may now
        known = {p.name: held[p.name] for p in parameters if p.name in acts - follow}
        known |= self.sensitivities(terms, values, [p for p in parameters if p.name not in known], raw)
        columns = self.whitened(parameters, known)
        system = NormalEquations.of(parameters, columns)
        damping, anew, corrected = FIRST_DAMPING, False, False
        for round_ in range(MOST_STEPS[self.has_contact_loss(terms)] if to_end else iterations):
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
                broyden_update(parameters, known, columns, old, state)
            corrected = not small
            if changed:
                known |= self.sensitivities(terms, state.values, changed, state.raw)
                columns[:, [parameters.index(p) for p in changed]] = self.whitened(changed, known)
            system = NormalEquations.of(parameters, columns)
        if to_end and corrected:
            known = self.sensitivities(terms, state.values, parameters, state.raw)
            columns = self.whitened(parameters, known)
        return Fit(
            tuple(terms), parameters, state.values, state.residual, columns, state.cost, self.measurement.samples, known
        )

    def best(self, terms: Sequence[Term], starts: Sequence[Start], *, to_end: bool = True) -> Fit | None:
        """The best fit from several starts, each with the sensitivities known there; None where none can be simulated.

        `to_end`: the one that is ahead after a few steps is finished, the others are not. Where teeth come loose and
        meet again, the way to the least squares is rough: all are.
        """
        at_once = to_end and (len(starts) == 1 or any(t.contact for t in terms))

        def fitted(start: Start) -> Fit | None:
            values, held = start
            try:
                return self.fit(terms, values, held=held, to_end=at_once)
            except ChainError:
                return None

        first = min((f for f in each(fitted, starts) if f), key=lambda f: f.cost, default=None)
        if first is None or not to_end or at_once:
            return first
        return self.fit(terms, first.values, held=first.sensitivities, to_end=True)

    def _step(
        self,
        terms: Sequence[Term],
        parameters: Sequence[Parameter],
        state: State,
        system: NormalEquations,
        damping: float,
    ) -> tuple[float, float]:
        """Move `state` to a smaller cost if there is one on the way; its gain and the next damping.

        Two dampings at a time, on two cores, of which the better is taken; none further once so little is promised
        that it would end the fit.
        """
        pull = system.columns.T @ state.residual

        def tried(damping: float) -> State | None:
            values = system.stepped(parameters, state.values, pull, damping)
            try:
                raw = self.raw_residuals(terms, values)
            except ChainError:
                return None
            residual = self.white(raw)
            return State(values, raw, residual, cost_of(residual, parameters, values))

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

    def with_reestimated_noise(self, fit: Fit) -> Problem:
        """The same with what the encoders' noise makes of the chain of `fit`, under what `fit` leaves as noise.

        What `fit` bends beyond `MISTAKEN` deviations the data sheet has wrong: it costs their square, and hardly more.
        Of the chain as new where a term is far from linear: what noise makes of teeth that hit and leave each other
        hangs on when they do, and kept from one fit it would hold every other to the same hits.
        """
        other = copy(self)
        other.observer = copy(self.observer)
        terms = tuple(t for t in fit.terms if not t.contact)
        values = self.numbers(terms) | dict(fit.values)
        other.observer.learn_noise(
            self.chain(terms, values), nuisance_of(values), has_contact_loss=self.has_contact_loss(fit.terms)
        )
        other.doubts = {}
        far = {
            p.name: p.deviation(fit.values) / MISTAKEN
            for p in other.base()
            if p.stated is Stated.WELL and p.name in fit.values
        }
        other.doubts = {name: times for name, times in far.items() if times > 1.0}
        return other.with_noise(other.noise_of(fit))

    def neg2_log_posterior(self, fit: Fit) -> float:
        """Minus twice the log likelihood of `fit` with what is known of its numbers, but for a constant."""
        doubted = 2.0 * sum(math.log(times) for times in self.doubts.values())
        return fit.cost + doubted + self.noise.log_scale(fit.torque_rows, fit.residual.size - fit.torque_rows)

    def noise_of(self, fit: Fit) -> Noise:
        """Filters that make the noise under the residual of `fit` white.

        What the known torque is wrong by along its doubted ways is counted there, and is no noise.
        """
        torque, guide = self.raw_residuals(fit.terms, fit.values)
        m = self.measurement
        torque = torque - m.across(by_doubts(m, self.noise, torque))
        unseen, teeth = has_links(self.axis) and not self.guided, bool(self.axis.stages)
        mode_hz = locked_mode_hz(self.axis) if unseen else None
        least = LEAST_NOISE * m.torque_rms
        first, level = whitener(torque, m.weight, m.rate_hz, self.memory, mode_hz, teeth=teeth, least=least)
        unsure = m.wrong_ways
        if not guide.size:
            return Noise(first, np.ones(1), level).with_inflated_prior(unsure, m.awake)
        stride = m.load_stride
        least = LEAST_GUIDE_NOISE * m.torque_rms * self.axis.ratio
        weight, rate_hz = m.load_weight[::stride], m.rate_hz / stride
        second, other = whitener(guide, weight, rate_hz, self.memory, teeth=teeth, least=least)
        return Noise(first, second, level, other).with_inflated_prior(unsure, m.awake)

    def measuring(self, measurement: Measurement) -> Problem:
        """The same of other rows, or of another torque, along the same motion."""
        other = copy(self)
        other.measurement = measurement
        return other

    def resting(self, fit: Fit) -> Problem:
        """The same with the rows at rest, where `fit` can say what friction holds there.

        Ahead of gears, whose encoder sees how far friction gives way before it slides, and while no teeth leave each
        other, which they do first at rest.
        """
        rests = bool(self.axis.stages) and not self.has_contact_loss(fit.terms)
        return self.measuring(replace(self.measurement, rests=rests))

    def with_predictable_rows(self, terms: Sequence[Term], values: Mapping[str, float]) -> Problem:
        """The same without the rows whose torque this model cannot tell.

        Teeth that nothing presses together rattle in the play that is as new, and any change of a number changes all
        that they do from there on: what is left there says nothing, and no sensitivity is true. Play and dents that
        are there show in the same rows.
        """
        other = self.with_all_rows()
        if not self.axis.stages or self.has_contact_loss(terms):
            return other
        parameters = self.parameters(terms)
        values = {p.name: values.get(p.name, p.start) for p in parameters}
        rows = self.measurement.samples
        kicked = [
            other.residual(terms, {p.name: values[p.name] + kick * _inwards(p, values[p.name]) for p in parameters})
            for kick in (0.0, KICK, 2.0 * KICK)
        ]
        counts = linear_rows([left[:rows] for left in kicked], self.measurement.rate_hz)
        return other.measuring(replace(other.measurement, predictable=counts))

    def with_all_rows(self) -> Problem:
        """The same with the rows in which teeth rattle."""
        return self.measuring(replace(self.measurement, predictable=np.ones(1)))

    def remembering(self, memory: Memory) -> Problem:
        """The same for noise that is taken anew to remember otherwise."""
        other = copy(self)
        other.memory = memory
        return other

    def with_noise(self, noise: Noise) -> Problem:
        other = copy(self)
        other.noise = noise
        other._hear()
        return other


def _within(far: float, values: Array) -> Array:
    """No further from 0 than `far`: numbers with which a simulation bursts are worse than any others, and no error."""
    return np.clip(np.nan_to_num(values, nan=far), -far, far)


def _inwards(parameter: Parameter, value: float) -> float:
    """The parameter's step, backwards where it would lead beyond what is allowed."""
    return parameter.step if value + parameter.step <= parameter.high else -parameter.step
