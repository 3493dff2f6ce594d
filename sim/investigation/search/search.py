"""Which terms the data ask for: added one after the other, swapped for their rivals, taken away where needless."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from sim.description.axis import MechanismEntry
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import multistart, rewhiten, with_slow_noise
from sim.investigation.estimation.whitening import LONG
from sim.investigation.hypotheses.hypothesis import AS_NEW, Key, Term, mechanisms_with
from sim.investigation.parallel import each
from sim.investigation.search.comparison import ModelComparison, in_place, named_alone, own_of, standings
from sim.investigation.search.criterion import (
    LEAST_EFFECT,
    evidence,
    exceeds_model_error,
    is_model_error,
    is_relevant,
    least_gain,
    predicts_unseen_rows,
    shifts_prior,
)
from sim.investigation.search.effect_size import effect_size
from sim.investigation.search.held_out_blocks import advantage, paired
from sim.investigation.search.noise_swap import NearRivals, ahead, exchanged, near_rivals, under_both_noises
from sim.investigation.search.proposals import (
    FAR_MOVED,
    FEW_TRIES,
    MOST_TRIES,
    Rival,
    faint,
    settled,
    try_terms,
)

Progress = Callable[[str, float], None]
SHORTLIST = 5
MOST_TERMS = 4
MOST_ROUNDS = 6  # with those that are as new or have no name
MOST_ENTRIES = 3  # of one round
MOST_RUNS = 2400  # simulations after which of all candidates only the most promising are fitted
LAST_RUNS = 4800  # the same after which only constants and what promised much are looked for: the rest is unnamed
CLEARLY = 1.2  # times what the best mechanism explains, where something without a name is taken instead
SWAPS = 3
RIVAL_SHARE = 0.25  # of the gain of the best: less is no rival
SWAP_SHARE = 0.5  # of the gain of what came in
LEAST_SWAP = 10.0  # drop of the squared residual
LARGE = 0.01  # of the squared residual: what brings less waits until slow noise is known
PLENTY = 0.1  # of the squared residual: a term whose lack costs more after a few steps is not needless
SURE, MOST_HIDDEN = 1.0, 2  # tempered nats of what noise has hidden, and how many of those
ENOUGH = 0.0  # tempered nats that a term must bring
MORE = 4.0  # the same for what is as new or has no name: it only stands aside


@dataclass(frozen=True)
class Selection:
    """The last fit; per accepted term what it gains over the fit without it, and its rivals when it came in.

    `found`: mechanisms of a size that matters; `fit` also has what is as new, so that nothing else is blamed for it,
    and what has no name.
    """

    problem: Problem
    base: Fit
    fit: Fit
    gains: Mapping[Key, float]
    rivals: Mapping[Key, tuple[Rival, ...]]
    rejected: tuple[Rival, ...]
    found: tuple[Term, ...]
    standings: Mapping[Key, ModelComparison]

    @property
    def nameless(self) -> tuple[Term, ...]:
        """What the residual asks for beyond them, most of it first."""
        spoken = (t for t in self.fit.terms if not t.named and t.mechanism != AS_NEW)
        return tuple(sorted(spoken, key=lambda t: -self.gains[t.key]))


def select(problem: Problem, base: Fit, progress: Progress) -> Selection:
    """Forward selection with refits, backward elimination after every step."""
    state = SelectionState(problem, base, described(problem, base))
    for step in range(MOST_ROUNDS):
        progress(f"candidates, round {step + 1}", 0.25 + 0.07 * step)
        if not state.advance() or state.is_full:
            break
    state.settle()
    state.unmask()
    return state.selection(base)


@dataclass
class SelectionState:
    """The model so far, and what was tried on the way to it.

    `entered`: what each term gained as it came in; `promised`: mechanisms that seemed to take away much.
    """

    problem: Problem
    fit: Fit
    entered: dict[Key, float]
    rivals: Mapping[Key, tuple[Rival, ...]] = field(default_factory=dict)
    nearly: NearRivals = field(default_factory=dict)
    rejected: tuple[Rival, ...] = ()
    promised: frozenset[str] = frozenset()
    gains: Mapping[Key, float] = field(default_factory=dict)

    @property
    def is_full(self) -> bool:
        """Whether as many terms of a size that matters are in as are believed."""
        counted = (t for t in self.fit.terms if not (t.traits.in_every_axis or t.mechanism == AS_NEW))
        return sum(effect_size(t, self.fit) > LEAST_EFFECT for t in counted) >= MOST_TERMS

    def advance(self) -> bool:
        """Let the best candidate in; whether there was one."""
        only = (
            None
            if self.problem.runs.count <= LAST_RUNS
            else mechanisms_with(lambda t: t.known_within_a_little) | self.promised
        )
        tried, entry = self._tried(only)
        last = tried if only is None else self.rejected  # some alone say nothing of the others
        self.promised = frozenset(r.term.mechanism for r in tried if is_large(r, self.fit))
        names = {r.term.key for r in entry.new}
        self.rejected = tuple(r for r in last if r.term.key not in names and r.term.named)
        if entry.new:
            self._take(tried, entry)
        return bool(entry.new)

    def _tried(self, only: Collection[str] | None) -> tuple[list[Rival], Entry]:
        """What was tried and what of it comes in; under slow noise, if nothing does else."""
        tried, entry = search(self.problem, self.fit, self.entered, only)
        if not entry.new and self.problem.memory != LONG:
            self.problem, self.fit = with_slow_noise(self.problem, self.fit)
            tried, entry = search(self.problem, self.fit, self.entered, only)
        return tried, entry

    def _take(self, tried: Sequence[Rival], entry: Entry) -> None:
        self.problem, self.fit = entry.problem, entry.fit
        self.entered |= entry.brought
        self.nearly = {**self.nearly, **{r.term.key: near_rivals(r, tried) for r in entry.new}}
        shortlist = tuple(r for r in tried if r.term.named)[:SHORTLIST]
        self.rivals = {**self.rivals, **{r.term.key: shortlist for r in entry.new}}

    def settle(self) -> None:
        """What is in, held against its rivals and against what the others have made needless."""
        if self.problem.memory != LONG:
            self.problem, self.fit = with_slow_noise(self.problem, self.fit)
        self.fit, self.rivals = swap(self.problem, self.fit, self.rivals, self.entered)
        self.problem, self.fit, self.nearly = exchanged(self.problem, self.fit, self.nearly)
        self.problem, self.fit, self.gains = prune(self.problem, self.fit, strict=True)

    def unmask(self) -> None:
        """Let in what noise has hidden."""
        for _ in range(MOST_HIDDEN):
            tried, entry = select_hidden(self.problem, self.fit, self.entered)
            self.problem, self.fit, self.gains = entry.problem, entry.fit, dict(entry.brought) or self.gains
            self.rivals = {**self.rivals, **{r.term.key: tuple(tried) for r in entry.new}}
            self.nearly = {**self.nearly, **{r.term.key: near_rivals(r, tried) for r in entry.new}}
            if not entry.new:
                break

    def selection(self, base: Fit) -> Selection:
        """What is in, each mechanism that matters compared with its rivals in its place."""
        problem, fit = self.problem, self.fit
        in_place = {key: [(r.term, r.values) for r in likely(tried)] for key, tried in self.rivals.items()}
        found = tuple(t for t in fit.terms if t.named and is_reported(t, fit))
        standing = standings(problem, fit, found, self.gains, in_place)
        standing |= {
            t.key: under_both_noises(problem, fit, t, standing[t.key], self.nearly.get(t.key, [])) for t in found
        }
        return Selection(problem, base, fit, self.gains, self.rivals, self.rejected, found, standing)


def is_reported(term: Term, fit: Fit) -> bool:
    """Whether a term is a mechanism of a size that matters, or something without a name."""
    return term.mechanism != AS_NEW and effect_size(term, fit) > LEAST_EFFECT


def select_hidden(problem: Problem, fit: Fit, entered: Mapping[Key, float]) -> tuple[list[Rival], Entry]:
    """What was tried, and of it what stands once noise is taken from its own fit, beside all that stands in `fit`.

    What each then gains is told of all of them. Where teeth hit none is looked for.
    """
    if problem.has_contact_loss(fit.terms) or problem.runs.count > LAST_RUNS or problem.memory != LONG:
        return [], Entry((), problem, fit)
    stood = {t.key for t in fit.terms if t.named}
    finished = faint(problem, fit)
    tried = [replace(r, finished=None) for r in finished]
    for best in finished:
        if best.finished is None or best.effect_size <= LEAST_EFFECT:
            continue
        anew, more = rewhiten(*multistart(*rewhiten(problem, best.finished)))
        anew, more, gains = prune(anew, more, strict=True)
        gain = gains.get(best.term.key, 0.0)
        worth = evidence(best.term, gain, more.residual.size)
        if stood <= gains.keys() and worth > SURE and not is_model_error(best.term, gain, entered):
            return tried, Entry([replace(best, finished=None)], anew, more, gains)
    return tried, Entry((), problem, fit)


def described(problem: Problem, base: Fit) -> dict[Key, float]:
    """What each mechanism that the description already has gains over a description without it."""

    def without(entry: MechanismEntry) -> float:
        rest = tuple(e for e in problem.axis.mechanisms if e is not entry)
        other = problem.of(replace(problem.axis, mechanisms=rest))
        return other.fit(start=base.values, held=base.sensitivities).cost - base.cost

    entries = problem.axis.mechanisms
    return {_key(e): gain for e, gain in zip(entries, each(without, entries), strict=True)}


def _key(entry: MechanismEntry) -> Key:
    return Key(entry.name, entry.location)


def is_large(rival: Rival, fit: Fit) -> bool:
    """Whether a mechanism of a size that matters, teeth in contact, takes away much."""
    sure = rival.term.named and not rival.term.contact and rival.effect_size > LEAST_EFFECT
    return sure and rival.gain > LARGE * fit.misfit


def likely(tried: Sequence[Rival]) -> list[Rival]:
    """Those of a size that may matter which gain at least a share of what the best of them does.

    An offset and an asymmetry are the same torque while anything moves: whichever ended in the better valley, either
    may be meant.
    """
    large = [r for r in tried if r.effect_size > 0.0]
    if not large:
        return []
    best = max(large, key=lambda r: r.gain)
    return [r for r in large if r.gain > RIVAL_SHARE * best.gain or (_is_shift(r.term) and _is_shift(best.term))]


def _is_shift(term: Term) -> bool:
    return term.traits.known_within_a_little or term.traits.like_an_offset


def search(
    problem: Problem, fit: Fit, entered: Mapping[Key, float], only: Collection[str] | None
) -> tuple[list[Rival], Entry]:
    """What was tried on top of `fit`, best first, and what of it comes in; `only`: mechanisms, default all."""
    least = 0.0 if problem.memory == LONG else LARGE * fit.misfit
    tried = try_terms(problem, fit, only, least, MOST_TRIES if problem.runs.count <= MOST_RUNS else FEW_TRIES)
    entry = enter(problem, fit, [r for r in tried if r.gain > least and not is_model_error(r.term, r.gain, entered)])
    return [replace(r, finished=None) for r in tried], entry


@dataclass(frozen=True)
class Entry:
    """What came in and the fit with it; nothing new: the fit as it was.

    `brought`: what each gained as it came in. Of what has no name, what it gains under noise taken from it, if more:
    noise had held the most of it, and what is left of it looks like anything.
    """

    new: Sequence[Rival]
    problem: Problem
    fit: Fit
    brought: Mapping[Key, float] = field(default_factory=dict)


def enter(problem: Problem, fit: Fit, tried: Sequence[Rival]) -> Entry:
    """The best candidate that stays once the noise is taken anew; the next best where one does not.

    Beside teeth that hit, what bends the description further stands for the error of their form.
    """
    for _ in range(MOST_ENTRIES):
        new, more = entering(problem, fit, tried)
        if more is None:
            break
        wider, more = multistart(*rewhiten(problem, more))
        wider, more, gains = prune(wider, more, strict=False)
        best = new[0].term
        if best.key in gains and not (
            problem.has_contact_loss(fit.terms) and shifts_prior(best, fit, more, gains[best.key])
        ):
            brought = {r.term.key: r.gain if r.term.named else max(r.gain, gains.get(r.term.key, 0.0)) for r in new}
            return Entry(new, wider, more, brought)
        tried = [r for r in tried if r.term.key != new[0].term.key]
    return Entry((), problem, fit)


def entering(problem: Problem, fit: Fit, tried: Sequence[Rival]) -> tuple[list[Rival], Fit | None]:
    """The candidate of most evidence and the fit with it; all that are as new come in together.

    So does what every axis has and the description leaves out, friction and errors over the load's angle: noise taken
    from a fit with one of them alone holds the others, which shake no faster than the axis moves.

    A mechanism goes before what has no name, unless that explains clearly more and holds on unseen rows; any that keeps
    the teeth in contact before a dent, which bends to whatever is missing.
    """
    rows = fit.residual.size
    worth = {r.term.key: evidence(r.term, r.gain, rows) for r in tried}
    fitting = [
        r
        for r in tried
        if worth[r.term.key] > (ENOUGH if r.term.named and r.effect_size > LEAST_EFFECT else MORE)
        and is_relevant(r.term, r.effect_size)
    ]
    as_new = [r for r in fitting if r.term.mechanism == AS_NEW or r.effect_size <= LEAST_EFFECT]
    most = max((worth[r.term.key] for r in fitting if r.term.named), default=0.0)
    touching = max(
        (worth[r.term.key] for r in fitting if r.term.named and not (r in as_new or r.term.contact)), default=0.0
    )
    for best in sorted(fitting, key=lambda r: -worth[r.term.key]):
        clearly = 1.0 if best in as_new or best.term.traits.in_every_axis else CLEARLY
        if not best.term.named and worth[best.term.key] < clearly * most:
            continue
        if best.term.traits.dent and worth[best.term.key] < CLEARLY * touching:
            continue
        new = [best]
        if best in as_new and best.term.named:
            new += [r for r in as_new if r is not best and r.term.named]
        if best.term.traits.in_every_axis:
            new += [r for r in tried if r is not best and r.term.traits.in_every_axis]
        start = {**best.values, **{p.name: r.values[p.name] for r in new for p in r.term.parameters}}
        held = fit.sensitivities if best.gain < FAR_MOVED else {}
        more = best.finished if len(new) == 1 else None
        more = more or settled(problem, (*fit.terms, *(r.term for r in new)), start, held)
        gain = fit.cost - more.cost
        if (
            best.term.named
            or best in as_new
            or (predicts_unseen_rows(best.term, fit, more) and exceeds_model_error(best.term, gain, more))
        ):
            return new, more
    return [], None


def prune(problem: Problem, fit: Fit, *, strict: bool) -> tuple[Problem, Fit, dict[Key, float]]:
    """Take away every term that the others have made needless; gains of those that stay.

    `strict`, once all are in: also what does not hold on unseen rows or is only the error of another's form. What has
    no name cannot make a mechanism needless. The one that costs least goes first: without it others may hold. A fit
    without what is clearly needed is not finished: that gain is at most as large as reported.
    """
    while fit.terms:
        plain = named_alone(problem, fit)

        def without(term: Term, problem: Problem = problem, fit: Fit = fit, plain: Fit = plain) -> Fit:
            more = plain if term.named else fit
            rest = tuple(t for t in more.terms if t is not term)
            less = problem.fit(rest, more.values, held=more.sensitivities)
            if not strict or less.cost - more.cost > PLENTY * more.misfit:
                return less
            return problem.fit(rest, less.values, held=less.sensitivities, to_end=True)

        less = dict(zip((t.key for t in fit.terms), each(without, fit.terms), strict=True))
        gains: dict[Key, float] = {}
        costs: dict[Key, float] = {}
        for term in fit.terms:
            more = plain if term.named else fit
            gain = costs[term.key] = less[term.key].cost - more.cost
            held = not strict or predicts_unseen_rows(term, less[term.key], more)
            held = held and not (strict and term.named and shifts_prior(term, less[term.key], more, gain))
            gains[term.key] = gain if held else 0.0
        rows = fit.residual.size
        weak = [
            t
            for t in fit.terms
            if evidence(t, gains[t.key], rows) <= ENOUGH
            or gains[t.key] < least_gain(t)
            or not is_relevant(t, effect_size(t, fit))
            or (strict and not exceeds_model_error(t, gains[t.key], fit))
        ]
        if not weak:
            return problem, fit, gains
        weakest = min(weak, key=lambda t: costs[t.key])
        without_it = less[weakest.key]
        rest = tuple(t for t in fit.terms if t is not weakest)
        fit = problem.fit(rest, {**fit.values, **without_it.values}, held=fit.sensitivities, to_end=True)
    return problem, fit, {}


def with_rival(problem: Problem, fit: Fit, rival: Rival) -> Fit:
    """`fit` with a rival on top of all else."""
    own = {p.name: rival.values[p.name] for p in rival.term.parameters}
    return problem.fit((*fit.terms, rival.term), {**fit.values, **own}, held=fit.sensitivities, to_end=True)


def swap(
    problem: Problem,
    fit: Fit,
    rivals: Mapping[Key, tuple[Rival, ...]],
    entered: Mapping[Key, float],
    most: int = MOST_TERMS,
) -> tuple[Fit, Mapping[Key, tuple[Rival, ...]]]:
    """Put in place of a mechanism one that was close to it when it came in, where that is better now.

    What comes in first is chosen while other things are still missing. What is as new takes no place: it comes in
    beside the other, and what it makes needless is taken away later. Of two that explain as much, the one that does
    better on unseen blocks, if it would stay. Nothing takes the place of friction that the description leaves out, as
    every axis has it whatever else it has. Rivals keep the numbers of their last fit. `entered`: what terms gained when
    they came in.
    """
    for term in fit.terms:
        tried = {r.term.key: r for r in rivals.get(term.key, ())}
        own = tried.get(term.key)
        if own is None or term.traits.in_every_axis:
            continue
        present = {t.key for t in fit.terms}
        absent = [r for r in tried.values() if r.term.key not in present]
        options = [r for r in absent if r.gain > SWAP_SHARE * own.gain][:SWAPS]

        def instead(rival: Rival, term: Term = term) -> Fit | None:
            return in_place(problem, fit, term, rival.term, [own_of(term, rival.term, rival.values)])

        @cache
        def less(term: Term = term) -> Fit:
            rest = tuple(t for t in fit.terms if t is not term)
            return problem.fit(rest, fit.values, held=fit.sensitivities, to_end=True)

        best = fit
        for known, other in zip(options, each(instead, options), strict=True):
            if other is None:
                continue
            rival = replace(known, gain=own.gain - (other.cost - fit.cost), values=other.values)
            kept = present - {term.key} | {_key(entry) for entry in problem.axis.mechanisms}
            others = {k: gain for k, gain in entered.items() if k in kept}
            form = is_model_error(rival.term, rival.gain, others) and not is_model_error(term, own.gain, others)
            if form or not is_relevant(rival.term, effect_size(rival.term, other)):
                continue  # it would not have come in, or be taken away again
            tried[rival.term.key] = rival
            margin = ahead(term if best is fit else best.terms[-1], rival.term)
            even = abs(other.cost - best.cost) < LEAST_SWAP and paired(advantage(best, other)) > margin
            even = even and predicts_unseen_rows(rival.term, less(), other)
            as_new = effect_size(rival.term, other) <= LEAST_EFFECT  # it would have come in by itself
            if other.cost < best.cost - LEAST_SWAP or (even and not as_new):
                best = with_rival(problem, fit, rival) if as_new else other
        rivals = {**rivals, term.key: tuple(sorted(tried.values(), key=lambda r: (-r.gain, str(r.term.key))))}
        if most and best is not fit:
            rivals = {**rivals, best.terms[-1].key: rivals[term.key]}
            now = {**entered, best.terms[-1].key: entered.get(term.key, own.gain)}
            return swap(problem, best, rivals, now, most - 1)
    return fit, rivals
