"""What each of several recordings of an axis says of a name that any of them gave."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.investigation.acoustic.evidence import LARGEST, PRIOR_ODDS, SILENT
from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.assessment.intervals import INFLATION
from sim.investigation.assessment.posterior import CLOSE, log_odds
from sim.investigation.assessment.posterior import existence as exists_in
from sim.investigation.data.excitation import excitation_of, lacking, lacking_at
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import all_rows
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.hypotheses.identifiability import the_same
from sim.investigation.results import REPORTED, Finding, Investigation
from sim.investigation.search.comparison import ModelComparison
from sim.investigation.search.criterion import TEMPERATURE
from sim.mechanisms.catalogue import kind_or_any
from sim.mechanisms.mechanism import SIZE_SHARE

PRIOR = math.log(PRIOR_ODDS)  # log odds of a mechanism before anything is measured
LEAST = 0.01


@dataclass(frozen=True)
class Name:
    """A mechanism at a place; `order` tells ripples apart.

    >>> str(Name("torque_ripple", "motor", 6.0))
    'torque ripple at motor (6 per turn)'
    """

    mechanism: str
    location: str | None
    order: float | None = None

    def __str__(self) -> str:
        place = f" at {self.location}" if self.location else ""
        return f"{self.mechanism.replace('_', ' ')}{place}" + (f" ({self.order:g} per turn)" if self.order else "")


@dataclass(frozen=True)
class LogOdds:
    """What one recording says of a name.

    `exists`: log odds that it adds to the prior; 0 says nothing. `against`: log odds of the name against each rival.
    """

    exists: float
    against: Mapping[Name, float] = field(default_factory=dict)


def logit(probability: float) -> float:
    return math.log(probability) - math.log1p(-probability)


def logistic(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(min(log_odds, 60.0), -60.0)))


def silent(drop: float, temperature: float) -> float:
    """Log odds from a recording that does not name a mechanism, once it had to take it as the others found it.

    `drop`: by how much that lowers its cost in squares, the size held to what the others know of it by their interval.
    Half of it is the log likelihood ratio; `temperature` below 1 since residuals are not quite white. What it cannot
    see costs it nothing and says nothing.

    >>> silent(0.0, 0.3), silent(-20.0, 0.3), silent(1000.0, 0.3)
    (0.0, -3.0, 6.0)
    """
    return max(-LARGEST, min(LARGEST, 0.5 * temperature * drop))


def existence(sayings: Iterable[LogOdds]) -> float:
    """Log odds that the effect is there with one size in all recordings, whatever its name: the sum of what each says.

    >>> logistic(existence([LogOdds(9.0), LogOdds(9.0), *[LogOdds(-9.0)] * 3])) < 0.01
    True
    """
    return PRIOR + sum(max(-LARGEST, min(LARGEST, saying.exists)) for saying in sayings)


def against(sayings: Iterable[LogOdds]) -> dict[Name, float]:
    """Log odds of the name against each rival that any recording weighed."""
    out: dict[Name, float] = {}
    for saying in sayings:
        for rival, odds in saying.against.items():
            out[rival] = out.get(rival, 0.0) + odds
    return out


def probability(exists: float, rivals: Iterable[float], own: Sequence[float]) -> float:
    """Probability of a name; `exists`, `rivals`: log odds; `own`: what each recording that names it says by itself.

    No name is surer than names have turned out to be. Half-way between errors that all recordings of an axis share
    (form of the model) and errors that each has of its own (noise), what that leaves open is divided by their number.

    >>> round(probability(logit(0.9), [], [0.9]), 6), round(probability(30.0, [], [0.95, 0.95]), 6)
    (0.9, 0.975)
    """
    named = logistic(exists) / (1.0 + sum(math.exp(-max(min(r, 60.0), -60.0)) for r in rivals))
    cap = 1.0 - (1.0 - WEIGHTS.cap) / max(len(own), 1)
    return min(max(named, LEAST), max(cap, *own, LEAST))


@dataclass(frozen=True)
class Known:
    """A number and its standard deviation; `prior_sd`: of what was known before the recording, in the same units."""

    value: float
    sd: float
    prior_sd: float = math.inf


def pooled(known: Sequence[Known], turn: float = 0.0) -> Known:
    """One number of several; `turn`: its period, for an angle on the circle.

    Each `sd` contains what was known before, which counts once:
    1 / sd^2 = sum 1 / sd_k^2 - (1 - 1/n) sum 1 / prior_sd_k^2.
    The mean is that of the values as they are: where data say little, it stays as near to what was known as they do.

    >>> both = pooled([Known(1.0, 0.1), Known(1.1, 0.1)])
    >>> round(both.value, 3), round(both.sd, 4)
    (1.05, 0.0707)
    >>> round(abs(pooled([Known(3.1, 0.1), Known(-3.1, 0.1)], 2 * math.pi).value), 6)
    3.141593
    """
    told = [k for k in known if k.sd > 0.0]
    if not told:  # exact in each: a count or a side
        values = [k.value for k in known]
        return Known(max(values, key=values.count), 0.0)
    weight = np.array([k.sd**-2.0 for k in told])
    before = (1.0 - 1.0 / len(told)) * np.array([max(k.prior_sd, k.sd) ** -2.0 for k in told])
    value = np.array([k.value for k in told])
    if turn:
        centre = value[int(np.argmax(weight))]
        value = centre + (value - centre + 0.5 * turn) % turn - 0.5 * turn
    information = float(np.sum(weight - before))
    mean = float(weight @ value / weight.sum())
    birge = math.sqrt(float(weight @ (value - mean) ** 2) / max(len(told) - 1, 1))
    if turn:
        signed = any(k.value < 0.0 for k in told)
        mean -= turn * math.floor(mean / turn + (0.5 if signed else 0.0))
    return Known(mean, max(1.0, birge) / math.sqrt(information))


def name_of(mechanism: str, location: str | None, numbers: Mapping[str, float]) -> Name:
    told_by = kind_or_any(mechanism).traits.identified_by
    return Name(mechanism, location, numbers.get(told_by) if told_by else None)


def called(finding: Finding) -> Name:
    return name_of(finding.mechanism, finding.location, {e.name: e.value for e in finding.parameters})


def term_name(term: Term, values: Mapping[str, float]) -> Name:
    return name_of(term.mechanism, term.location, term.report(values))


def is_own(name: Name) -> bool:
    """Whether it is of a recording and not of the axis."""
    return kind_or_any(name.mechanism).traits.of_the_recording


def finding_named(result: Investigation, name: Name) -> Finding | None:
    return next((f for f in result.findings if called(f) == name), None)


def shows(result: Investigation, name: Name) -> bool:
    finding = finding_named(result, name)
    return finding is not None and finding.probability >= REPORTED


def _standings(result: Investigation) -> dict[Name, ModelComparison]:
    """Of the names that telemetry gave."""
    selection = result.weighed
    if selection is None:
        return {}
    return {term_name(t, selection.fit.values): selection.standings[t.key] for t in selection.found}


def found_at(results: Sequence[Investigation], name: Name) -> tuple[Term, Fit] | None:
    """Where the recording that gains most by it found it: the term and its fit."""
    best: tuple[float, Term, Fit] | None = None
    for selection in (result.weighed for result in results):
        for term in selection.found if selection else ():
            gain = selection.gains[term.key] if selection else 0.0
            if selection and term_name(term, selection.fit.values) == name and (best is None or gain > best[0]):
                best = (gain, term, selection.fit)
    return None if best is None else best[1:]


@dataclass(frozen=True)
class Weighed:
    """What all recordings say of a name; `sayings` in their order, `elsewhere`: places that explain them as well."""

    probability: float
    indistinguishable_from: tuple[str, ...]
    elsewhere: tuple[str, ...]
    sayings: tuple[LogOdds, ...]


def weighed(results: Sequence[Investigation], denied: Collection[tuple[Name, int]] = ()) -> dict[Name, Weighed]:
    """Every name that any recording gave; of names for one effect that nothing tells apart, the better founded.

    `denied`: names, and the places of recordings whose unseen rows are predicted worse with them.
    """
    names = list(dict.fromkeys(called(f) for result in results for f in result.findings))
    sayings = {
        name: [
            LogOdds(-LARGEST) if (name, place) in denied else _saying(result, name, results)
            for place, result in enumerate(results)
        ]
        for name in names
    }
    rivals = {name: against(sayings[name]) for name in names}
    out: dict[Name, Weighed] = {}
    for name in names:
        given = [finding for result in results if (finding := finding_named(result, name))]
        somewhere, everywhere = the_same_together(results, name)
        left_out = {r.mechanism for r in rivals[name]} | (somewhere - everywhere)
        alike = dict.fromkeys(m for f in given for m in f.indistinguishable_from if m not in left_out)
        near = [r for r, odds in rivals[name].items() if abs(odds) < CLOSE]
        told = tuple([*alike, *sorted({r.mechanism for r in near} - {name.mechanism})][:2])
        better = [r for r in names if rivals[name].get(r, 0.0) < 0.0]
        if any(r.mechanism in (name.mechanism, *told) for r in better):
            continue
        counted = [odds for r, odds in rivals[name].items() if r.mechanism not in (name.mechanism, *told)]
        places = tuple(r.location for r in near if r.mechanism == name.mechanism and r.location)
        p = probability(existence(sayings[name]), counted, [f.probability for f in given])
        out[name] = Weighed(p, told, places, tuple(sayings[name]))
    return out


def the_same_together(results: Sequence[Investigation], name: Name) -> tuple[set[str], set[str]]:
    """What looks the same as a mechanism in any of the recordings that name it, and what does in all of them together:
    what is told by the motion of others would not be of one size there."""
    ms = [r.data_check.measurement for r in results if r.data_check is not None and finding_named(r, name)]
    if not ms:
        return set(), set()
    each = {other for m in ms for other in the_same(name.mechanism, lacking(m))}
    return each, set(the_same(name.mechanism, lacking_at(np.concatenate([excitation_of(m).speed for m in ms]))))


def _saying(result: Investigation, name: Name, results: Sequence[Investigation]) -> LogOdds:
    """What a recording says of `name`: no more than the size that it has in all of them gains it."""
    finding, found = finding_named(result, name), found_at(results, name)
    if found is None:  # by sound
        if finding is not None:
            return LogOdds(logit(finding.probability) - PRIOR)
        return LogOdds(math.log(SILENT) if result.provenance["sound_sha256"] and not is_own(name) else 0.0)
    if is_own(name) and finding is None:  # another recording knows nothing of it
        return LogOdds(0.0)
    values = {} if result.weighed is None else result.weighed.fit.values
    asked = math.inf if is_own(name) or _is_of(result, found[1]) else _asked(result, *found)
    for other, standing in _standings(result).items():
        given, beaten = finding_named(result, other), _beaten(standing, values)
        if given is not None and given.evidence is not None and name in (other, *beaten):
            exists = min(exists_in(given.evidence) - PRIOR, asked)
            return LogOdds(exists, beaten if name == other else {other: -beaten[name]})
    return LogOdds(min(asked, 0.0))  # it had its reasons not to name it


def _is_of(result: Investigation, fit: Fit) -> bool:
    return result.weighed is not None and result.weighed.fit is fit


def instead(result: Investigation, wrong: Iterable[Name]) -> set[Name]:
    """What a recording tried in place of the names `wrong` that it gave."""
    standings = _standings(result)
    values = {} if result.weighed is None else result.weighed.fit.values
    return {rival for name in wrong if name in standings for rival in _beaten(standings[name], values)}


def _beaten(standing: ModelComparison, values: Mapping[str, float]) -> dict[Name, float]:
    """Log odds of a name against each of its rivals."""
    return {
        term_name(r, {p.name: p.start for p in r.parameters} | dict(values)): log_odds(t, WEIGHTS.overdispersion)
        for r, t in standing.rivals
    }


def _holding(problem: Problem, own: Fit, rest: Sequence[Term], term: Term, fit: Fit) -> Fit | None:
    """The model `rest` with `term`, its numbers held to what `fit`, that of another recording, knows of them.

    A wave has its size, but the phase that fits: angles count from anywhere.
    """
    spread, known = fit.deviations(), {p.name: fit.values[p.name] for p in term.parameters}
    wave = [name for name in known if name.endswith((".sine", ".cosine"))]
    start = [({**own.values, **known}, own.sensitivities)]
    if len(wave) == 2 and (free := problem.best((*rest, term), start)):
        times = math.hypot(*(known[n] for n in wave)) / max(math.hypot(*(free.values[n] for n in wave)), 1e-300)
        known |= {n: times * free.values[n] for n in wave}
    held = tuple(
        replace(p, start=v, centre=v, spread=max(INFLATION * spread[p.name], SIZE_SHARE * abs(v), 1e-300))
        for p in term.parameters
        for v in [known[p.name]]
    )
    return problem.best((*rest, replace(term, parameters=held)), [({**own.values, **known}, own.sensitivities)])


def _asked(result: Investigation, term: Term, fit: Fit) -> float:
    """Log odds for `term` from a recording that has to take it as it stands in `fit`, the fit of another."""
    selection = result.weighed
    if selection is None:
        return 0.0
    problem, own = selection.problem, selection.fit
    if term.contact and not problem.measurement.predictable.all():
        problem, own = all_rows(problem, own)
    name = term_name(term, fit.values)
    rest = tuple(t for t in own.terms if term_name(t, own.values) != name)
    without = own if len(rest) == len(own.terms) else problem.best(rest, [(own.values, own.sensitivities)])
    with_it = _holding(problem, own, rest, term, fit)
    return silent(without.cost - with_it.cost, TEMPERATURE) if without and with_it else 0.0
