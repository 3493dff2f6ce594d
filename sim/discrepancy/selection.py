"""Which terms the data ask for: screened by simulated sensitivity, refitted by simulation, added and taken away."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from sim.discrepancy.catalogue import AS_NEW_FACTOR, terms_of, tooth_damage
from sim.discrepancy.fit import Fit, Noise, Problem, Raw, Start, each
from sim.discrepancy.measurement import gaussian_kernel
from sim.discrepancy.model import has_links, link_stiffness, ratio_after, stages_of
from sim.discrepancy.nameless import AS_NEW, FIXED, OVER_ANGLE, OVER_SPEED, nameless_terms
from sim.discrepancy.scan import Place, scan
from sim.discrepancy.screening import screen
from sim.discrepancy.size import beyond, magnitude
from sim.discrepancy.terms import Term
from sim.discrepancy.weighing import Standing, advantage, in_place, named_alone, own_of, paired, standings

Progress = Callable[[str, float], None]
SHORTLIST = 5
FORM_SHARE, HITS_SHARE = 0.005, 0.03  # of another's gain: what any law, and what teeth that hit leave of their form
DELAY_SHARE = 0.1  # a shift in time has the shape of what most errors of form leave
LAWS = (  # of one part of the machine, and the share of another's gain below which one is the error of its form
    (frozenset({"backlash", "tooth_damage", "stiffness_hardening", "hysteresis"}), 0.1),
    (frozenset({"stribeck_friction", "load_dependent_loss", "friction_asymmetry"}), 0.35),
    (frozenset({"mesh_error", "torque_ripple"}), 0.05),
    (frozenset({"eccentricity", "torque_ripple"}), 0.05),
)
HITS = ("backlash", "tooth_damage")
ERRORS = ("mesh_error", "eccentricity", "structural_resonance", AS_NEW)  # every new axis has them, if small
LEFT_OUT = ("coulomb_friction", "viscous_friction")  # every axis has them
LEFT_OUT_SHARE = 0.5  # of what others must gain
LEAST_SHARE = 0.0006  # of the squared residual: what the form of a model differs from any real axis
LEAST_SHARES = {  # of what bends to much
    OVER_SPEED: 0.01, OVER_ANGLE: 0.012, FIXED: 0.002,
    "structural_resonance": 0.005, "hysteresis": 0.002, "stiffness_hardening": 0.002, "tooth_damage": 0.012,
}  # fmt: skip
LEAST_GAIN = 20.0  # the same for a short record
MOTION_BAND_HZ = 40.0
MOST_TRIES = 7
DEPTHS = (0.03, 0.1, 0.3)  # of the working twist, where a dent is looked for
SHIFTS = np.linspace(-1.0, 1.0, 11)  # pitches around the place that the scan proposes
CLOSE = 2  # best candidates of which those that are far from linear are refitted in full
MOST_TERMS = 4
MOST_ROUNDS = 6  # with those that are as new or have no name
MOST_ENTRIES = 3  # of one round
MOST_RUNS = 1800  # simulations after which no further round begins: what is left then is unnamed
CLEARLY = 1.2  # times what the best mechanism explains, where something without a name is taken instead
BENT = 60.0  # squared deviations of what is described from what the fit makes of it
LEFT = 0.1  # depth of a dent over the working twist
FAR_MOVED = 500.0  # drop of squares at which all other numbers move far, too
HOLDS_T = 1.5
KEPT_SHARE = 0.33  # of a gain, on rows not seen
LARGEST_LOSS = 3.0  # times the median over blocks
SWAPS = 2
RIVAL_SHARE = 0.25  # of the gain of the best: less is no rival
SWAP_SHARE = 0.7  # of the gain of what came in
LEAST_SWAP = 10.0  # drop of the squared residual
BEYOND = 2.0  # standard deviations
ENOUGH = 0.0  # tempered nats that a term must bring
MORE = 4.0  # the same for what is as new or has no name: it only stands aside
WORTH_TRYING = 20.0  # drop of the whitened sum of squares that a screened term must promise
LINEAR, FAR_FROM_LINEAR = 0.1, 0.03  # of the best promise: less is no rival
TEMPERATURE = 0.3  # model errors make the residual less informative than its whitened length says


@dataclass(frozen=True)
class Rival:
    """A term that was refitted in place of another or on top of the rest, and what it gained.

    `beyond`: standard deviations by which it is larger than what does not matter or is as new; `finished`: its fit on
    top of the rest, where that was finished.
    """

    term: Term
    gain: float
    values: Mapping[str, float]
    beyond: float = math.inf
    finished: Fit | None = field(default=None, repr=False, compare=False)


@dataclass(frozen=True)
class Selection:
    """The last fit; per accepted term what it gains over the fit without it, and its rivals when it came in.

    `found`: mechanisms of a size that matters; `fit` also holds what is as new, so that nothing else is blamed for it,
    and what has no name.
    """

    problem: Problem
    base: Fit
    fit: Fit
    gains: Mapping[str, float]
    rivals: Mapping[str, tuple[Rival, ...]]
    rejected: tuple[Rival, ...]
    found: tuple[Term, ...]
    standings: Mapping[str, Standing]

    @property
    def nameless(self) -> tuple[Term, ...]:
        """What the residual asks for beyond them, most of it first."""
        spoken = (t for t in self.fit.terms if not t.named and t.mechanism != AS_NEW)
        return tuple(sorted(spoken, key=lambda t: -self.gains[t.key]))


def calibrate(problem: Problem) -> tuple[Problem, Fit]:
    """Fit what the description has, whitened by what the description itself leaves, then by what the fit leaves."""
    described = problem.fit(iterations=0)
    problem = problem.with_noise(problem.noise_of(described))
    return rewhiten(problem, problem.fit(held=described.sensitivities))


def rewhiten(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Take the noise from the residual of `fit`, fit again."""
    problem = problem.learned(fit)
    return problem, problem.fit(fit.terms, fit.values, held=fit.sensitivities, to_end=True)


def polish(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Last fit of one stiff body by plain least squares in the band of its motion.

    Whitened rows weigh most what is fast, where a body's model is least true to its form; the least squares of the
    band in which torque is predicted are what its numbers are for.
    """
    if has_links(problem.axis):
        return problem, fit
    torque, _ = problem.raw_residuals(fit.terms, fit.values)
    kernel = gaussian_kernel(MOTION_BAND_HZ, problem.measurement.rate_hz, 0)
    left = float(np.std(np.convolve(torque, kernel, "same")))
    plain = problem.with_noise(Noise(kernel / max(left, 1e-300), np.ones(1)))
    return plain, plain.fit(fit.terms, fit.values, held=fit.sensitivities)


def penalty(term: Term, rows: int) -> float:
    """Nats that a term must pay: half a log of the rows for each number, and for the places it was looked for.

    Nothing for what every axis has: a description without friction is one that leaves it out.
    """
    if term.mechanism in LEFT_OUT:
        return 0.0
    looks = 8.0 if term.mechanism == "tooth_damage" else math.log(max(len(term.probes), 1) + 1.0)
    return 0.5 * len(term.parameters) * math.log(rows) + looks


def evidence(term: Term, gain: float, rows: int) -> float:
    """Tempered log odds that the term belongs to the model."""
    return TEMPERATURE * (0.5 * gain - penalty(term, rows))


def select(problem: Problem, base: Fit, progress: Progress) -> Selection:
    """Forward selection with refits, backward elimination after every step."""
    fit = base
    gains: Mapping[str, float] = {}
    rivals: Mapping[str, tuple[Rival, ...]] = {}
    rejected: tuple[Rival, ...] = ()
    entered: dict[str, float] = {}
    for step in range(MOST_ROUNDS):
        if problem.runs.count > MOST_RUNS:
            break
        progress(f"candidates, round {step + 1}", 0.25 + 0.07 * step)
        tried = try_terms(problem, fit)
        entry = enter(problem, fit, [r for r in tried if not is_form(r, entered)])
        tried = [replace(r, finished=None) for r in tried]
        names = {r.term.key for r in entry.new}
        rejected = tuple(r for r in tried if r.term.key not in names and r.term.named)
        problem, fit = entry.problem, entry.fit
        if not entry.new:
            break
        gains = entry.gains
        entered |= {r.term.key: r.gain for r in entry.new}
        rivals = {**rivals, **{r.term.key: tuple(r for r in tried if r.term.named)[:SHORTLIST] for r in entry.new}}
        if sum(beyond(t, fit) > BEYOND for t in fit.terms) >= MOST_TERMS:
            break
    fit, rivals = swap(problem, fit, rivals)
    problem, fit, gains = prune(problem, fit, strict=True)
    in_place = {
        key: [(r.term, r.values) for r in tried if r.beyond > 0.0 and r.gain > RIVAL_SHARE * max(x.gain for x in tried)]
        for key, tried in rivals.items()
    }
    found = tuple(t for t in fit.terms if t.named and beyond(t, fit) > BEYOND)
    standing = standings(problem, fit, found, gains, in_place)
    return Selection(problem, base, fit, gains, rivals, rejected, found, standing)


@dataclass(frozen=True)
class Entry:
    """What came in, the fit with it and what each of its terms gains; nothing new: the fit as it was."""

    new: Sequence[Rival]
    problem: Problem
    fit: Fit
    gains: Mapping[str, float]


def enter(problem: Problem, fit: Fit, tried: Sequence[Rival]) -> Entry:
    """The best candidate that stays once the noise is taken anew; the next best where one does not."""
    for _ in range(MOST_ENTRIES):
        new, more = entering(problem, fit, tried)
        if more is None:
            break
        wider, more = rewhiten(problem, more)
        wider, more, gains = prune(wider, more, strict=False)
        if new[0].term.key in gains:
            return Entry(new, wider, more, gains)
        tried = [r for r in tried if r.term.key != new[0].term.key]
    return Entry((), problem, fit, {})


def wanted(term: Term, far: float) -> bool:
    """Whether a term `far` beyond as new is worth a place: it matters, or nothing always fitted stands for it."""
    return far > BEYOND or (far > -math.inf and term.mechanism in ERRORS and not term.replaces)


def entering(problem: Problem, fit: Fit, tried: Sequence[Rival]) -> tuple[list[Rival], Fit | None]:
    """The candidate that explains most and the fit with it; all that are as new come in together.

    A mechanism goes before what has no name, unless that explains clearly more and holds on unseen rows.
    """
    rows = fit.residual.size
    worth = {r.term.key: evidence(r.term, r.gain, rows) for r in tried}
    fitting = [
        r
        for r in tried
        if worth[r.term.key] > (ENOUGH if r.term.named and r.beyond > BEYOND else MORE) and wanted(r.term, r.beyond)
    ]
    most = max((worth[r.term.key] for r in fitting if r.term.named), default=0.0)
    as_new = [r for r in fitting if r.term.mechanism == AS_NEW or r.beyond <= BEYOND]
    for best in fitting:
        if not best.term.named and best not in as_new and worth[best.term.key] < CLEARLY * most:
            continue
        new = [best]
        if best in as_new and best.term.named:
            new += [r for r in as_new if r is not best and r.term.named]
        start = {**best.values, **{p.name: r.values[p.name] for r in new for p in r.term.parameters}}
        held = fit.sensitivities if best.gain < FAR_MOVED else {}
        more = best.finished if len(new) == 1 else None
        more = more or settled(problem, (*fit.terms, *(r.term for r in new)), start, held)
        if best.term.named or best in as_new or (holds(fit, more) and matters(best.term, fit.cost - more.cost, more)):
            return new, more
    return [], None


def matters(term: Term, gain: float, fit: Fit) -> bool:
    """Whether a gain is more than what the form of a model differs from any axis."""
    part = LEFT_OUT_SHARE if term.mechanism in LEFT_OUT else 1.0
    share = LEAST_SHARES.get(term.mechanism, LEAST_SHARE)
    return gain >= part * max(share * fit.misfit, LEAST_GAIN * max(1.0, fit.misfit / fit.residual.size))


def prune(problem: Problem, fit: Fit, *, strict: bool) -> tuple[Problem, Fit, dict[str, float]]:
    """Take away every term that the others have made needless; gains of those that stay.

    `strict`, once all are in: also what does not hold on unseen rows or is only the error of another's form. What has
    no name cannot make a mechanism needless.
    """
    while fit.terms:
        plain = named_alone(problem, fit)

        def without(term: Term, fit: Fit = fit, plain: Fit = plain) -> Fit:
            more = plain if term.named else fit
            rest = tuple(t for t in more.terms if t is not term)
            return problem.fit(rest, more.values, held=more.sensitivities, to_end=strict)

        less = dict(zip((t.key for t in fit.terms), each(without, fit.terms), strict=True))
        gains = {}
        for term in fit.terms:
            more = plain if term.named else fit
            held = not strict or holds(less[term.key], more)
            gains[term.key] = less[term.key].cost - more.cost if held else 0.0
        rows = fit.residual.size
        weak = [
            t
            for t in fit.terms
            if evidence(t, gains[t.key], rows) <= ENOUGH
            or not wanted(t, beyond(t, fit))
            or (strict and not matters(t, gains[t.key], fit))
        ]
        if not weak:
            return problem, fit, gains
        weakest = min(weak, key=lambda t: gains[t.key])
        rest = tuple(t for t in fit.terms if t is not weakest)
        fit = problem.fit(rest, {**fit.values, **less[weakest.key].values}, held=fit.sensitivities, to_end=True)
    return problem, fit, {}


def is_form(rival: Rival, entered: Mapping[str, float]) -> bool:
    """Whether a mechanism explains so little beside another that it is the error of the other's form.

    Two laws of a spring (gap, bend, loop, dent) or of friction leave each other's errors of form behind. `entered`:
    what each term gained when it came in; later, with what stands for its errors beside it, taking it away says far
    too much.
    """
    if rival.term.mechanism in LEFT_OUT:
        return False
    return any(rival.gain < form_share(rival.term.mechanism, key.split("@")[0]) * gain for key, gain in entered.items())


def form_share(mechanism: str, other: str) -> float:
    """Share of the gain of `other` below which `mechanism` is the error of its form."""
    shares = [share for laws, share in LAWS if {mechanism, other} <= laws]
    if mechanism == "time_delay":
        shares.append(DELAY_SHARE)
    if other in HITS:
        shares.append(HITS_SHARE)
    return max(shares, default=FORM_SHARE)


def holds(less: Fit, more: Fit) -> bool:
    """Whether the larger model predicts better what it has not seen.

    By 1.5 standard errors and 2.6 to one in sum, both of signed roots, as in `paired`; or, where an effect acts in a
    few blocks only (low speed, large twist, a tooth that is passed once), by a third of what it gains on seen rows. A
    loss counts as three typical blocks at most: it may be the linear refit that fails without that block.
    """
    drop = advantage(less, more)
    root = np.sign(drop) * np.sqrt(np.abs(drop))
    even = paired(drop) > HOLDS_T and float(root.sum()) > 0.45 * float(np.abs(root).sum())
    kept = float(np.maximum(drop, -LARGEST_LOSS * np.median(np.abs(drop))).sum())
    few = kept > KEPT_SHARE * (less.cost - more.cost) > 0.0
    return even or few


def swap(
    problem: Problem, fit: Fit, rivals: Mapping[str, tuple[Rival, ...]], most: int = MOST_TERMS
) -> tuple[Fit, Mapping[str, tuple[Rival, ...]]]:
    """Put in place of a mechanism one that was close to it when it came in, where that is better now.

    What comes in first is chosen while other things are still missing. Of two that explain as much, the one that does
    better on unseen blocks. Rivals keep the numbers of their last fit.
    """
    for term in fit.terms:
        tried = {r.term.key: r for r in rivals.get(term.key, ())}
        own = tried.get(term.key)
        if own is None:
            continue
        present = {t.key for t in fit.terms}
        options = {r.term.key: [r] for r in elsewhere(problem, fit, own)}
        for key, known in options.items():
            known += [tried[key]] if key in tried else []
        absent = [r for r in tried.values() if r.term.key not in present | options.keys()]
        options |= {r.term.key: [r] for r in [r for r in absent if r.gain > SWAP_SHARE * own.gain][:SWAPS]}

        def instead(known: Sequence[Rival], term: Term = term) -> Fit | None:
            other = known[0].term
            return in_place(problem, fit, term, other, [own_of(term, other, r.values) for r in known])

        best = fit
        for (key, known), other in zip(options.items(), each(instead, options.values()), strict=True):
            if other is None or not wanted(known[0].term, beyond(known[0].term, other)):
                continue  # it would be taken away again
            tried[key] = replace(known[0], gain=own.gain - (other.cost - fit.cost), values=other.values)
            even = abs(other.cost - best.cost) < LEAST_SWAP and paired(advantage(best, other)) > 0.0
            if other.cost < best.cost - LEAST_SWAP or even:
                best = other
        rivals = {**rivals, term.key: tuple(sorted(tried.values(), key=lambda r: (-r.gain, r.term.key)))}
        if most and best is not fit:
            rivals = {**rivals, best.terms[-1].key: rivals[term.key]}
            return swap(problem, best, rivals, most - 1)
    return fit, rivals


def elsewhere(problem: Problem, fit: Fit, own: Rival) -> list[Rival]:
    """Play in every other gear pair, with the same lost motion at the load."""
    if own.term.mechanism != "backlash":
        return []
    stages = stages_of(problem.axis)
    gap = magnitude(own.term, fit.values) / ratio_after(problem.axis, stages.index(own.term.location or ""))
    present = {t.key for t in fit.terms}
    return [
        Rival(
            t, own.gain, {p.name: gap * ratio_after(problem.axis, stages.index(t.location or "")) for p in t.parameters}
        )
        for t in terms_of(problem.axis, problem.measurement, problem.chain(fit.terms, fit.values))
        if t.mechanism == own.term.mechanism and t.key not in present
    ]


def try_terms(problem: Problem, fit: Fit) -> list[Rival]:
    """Candidates by what they gain once refitted, best first; what has no name is linear, its promise is its gain."""
    present = {term.key for term in fit.terms}
    candidates = [
        t
        for t in (
            *terms_of(problem.axis, problem.measurement, problem.chain(fit.terms, fit.values)),
            *damage_terms(problem, fit),
            *nameless_terms(problem, fit),
        )
        if t.key not in present
    ]
    screened = screen(problem, fit, candidates)
    tries: dict[str, int] = {}
    straight = [Rival(t, gain, {**fit.values, **start}) for gain, t, start in screened if not t.named]
    jobs: list[tuple[Term, Mapping[str, float]]] = []
    for promised, term, start in screened:
        if not term.named:
            continue
        if promised < LEFT_OUT_SHARE * WORTH_TRYING or len(jobs) >= MOST_TRIES:
            break
        if promised < WORTH_TRYING and term.mechanism not in LEFT_OUT:
            continue
        if promised < (FAR_FROM_LINEAR if term.nonlinear else LINEAR) * screened[0][0]:
            continue
        if tries.get(term.key, 0) < (2 if term.nonlinear else 1):
            tries[term.key] = tries.get(term.key, 0) + 1
            jobs.append((term, start))
    refits = each(lambda job: _refitted(problem, fit, *job), jobs)
    tried = [(fit.cost - refit.cost, refit, job[0]) for refit, job in zip(refits, jobs, strict=True) if refit]
    tried.sort(key=lambda t: (-t[0], t[2].key))
    # sensitivities change where contact is lost and where the rest moves far: anew for those that may be first
    far = [
        place
        for place, (gain, _, term) in enumerate(tried[:CLOSE])
        if gain > 0.3 * tried[0][0] and (term.nonlinear or gain > FAR_MOVED)
    ]
    near = [tried[place][1] for place in far]
    finished = each(lambda f: settled(problem, f.terms, f.values, f.sensitivities), near)
    for place, anew in zip(far, finished, strict=True):
        tried[place] = (fit.cost - anew.cost, anew, tried[place][2])
    tried.sort(key=lambda t: (-t[0], t[2].key))
    best: dict[str, Rival] = {}
    for gain, refit, term in tried:
        done = refit if any(refit is one for one in finished) else None
        best.setdefault(term.key, Rival(term, gain, refit.values, beyond(term, refit), done))
    return sorted([*best.values(), *straight], key=lambda r: (-r.gain, r.term.key))


def settled(
    problem: Problem, terms: Sequence[Term], values: Mapping[str, float], held: Mapping[str, Raw] = MappingProxyType({})
) -> Fit:
    """A finished fit, or one that starts from what is described where that is better.

    Numbers that were bent to stand for a missing mechanism may keep a fit in a valley of their own; a dent that teeth
    leave before its bottom may be deeper and narrower as well.
    """
    fit = problem.fit(terms, values, held=held, to_end=True)
    own = {p.name: fit.values[p.name] for term in terms for p in term.parameters}
    starts: list[Start] = [(own, {})] if fit.strain > BENT else []
    for term in terms:
        depth, width = term.parameters[0], term.parameters[-1]
        if term.mechanism == "tooth_damage" and own[depth.name] > LEFT * depth.high:
            deeper = {**own, depth.name: 2.0 * own[depth.name], width.name: 0.5 * own[width.name]}
            starts.append((deeper, {}))
    anew = problem.best(terms, starts)
    return anew if anew and anew.cost < fit.cost else fit


def _refitted(problem: Problem, fit: Fit, term: Term, start: Mapping[str, float]) -> Fit | None:
    """The model with one more term, or None where it cannot be simulated; from what is described where `fit` bends it.

    What is bent stands for the term, and moves back too slowly.
    """
    terms = (*fit.terms, term)
    values = {**fit.values, **start}
    starts: list[Start] = [(values, fit.sensitivities)]
    if fit.strain > BENT:
        starts.append(({p.name: values[p.name] for t in terms for p in t.parameters if p.name in values}, {}))
    return problem.best(terms, starts, to_end=False)


def damage_terms(problem: Problem, fit: Fit) -> list[Term]:
    """Tooth damage where the scan along the wheels proposes it."""
    axis = problem.axis
    teeth = {k: s.driven_teeth for k, s in enumerate(axis.stages) if s.driven_teeth}
    if not teeth:
        return []
    places = sorted(scan(problem, fit, teeth), key=lambda p: -p.gain)
    if not places or places[0].gain < WORTH_TRYING:
        return []
    first = places[0]
    return [_damage_term(problem, fit, replace(first, flank=flank)) for flank in (first.flank, -first.flank)]


def _damage_term(problem: Problem, fit: Fit, place: Place) -> Term:
    """A dent at a place, to be tried on a grid around it: contact lost makes it far from linear."""
    stage = problem.axis.stages[place.link]
    pitch = 2.0 * math.pi / (stage.driven_teeth or 1)
    level = float(np.sqrt(np.mean(problem.measurement.torque**2)))
    ratio = problem.axis.ratio / problem.axis.ratio_from(stage.name)
    twist = level * ratio / link_stiffness(problem.axis, place.link)
    seen = 0.003 if problem.guided else 0.01  # of the twist, which is measured or not
    size = AS_NEW_FACTOR * max(stage.transmission_error_rad, seen * twist)

    starts = [(place.angle_rad + shift * pitch, share * twist) for share in DEPTHS for shift in SHIFTS]
    return tooth_damage(
        stage.name, place.link, stage.driven_teeth or 1, place.flank, place.angle_rad, starts, size, twist
    )
