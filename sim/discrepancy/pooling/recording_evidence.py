"""What each of several recordings of an axis says of a name that any of them gave."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from sim.discrepancy.acoustic.evidence import SILENT
from sim.discrepancy.assessment.calibration import WEIGHTS
from sim.discrepancy.assessment.intervals import INFLATION
from sim.discrepancy.assessment.posterior import CLOSE, is_close, log_odds
from sim.discrepancy.assessment.posterior import existence as exists_in
from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.estimation.problem import Problem
from sim.discrepancy.estimation.refit import all_rows
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.pooling.log_odds import PRIOR, LogOdds, Name, against, existence, logit, probability, silent
from sim.discrepancy.results import SAID, Finding, Investigation
from sim.discrepancy.search.blocked_cross_validation import advantage, paired
from sim.discrepancy.search.comparison import Model, ModelComparison, in_place, named_alone, own_of
from sim.discrepancy.search.criterion import TEMPERATURE
from sim.mechanisms.catalogue import kind_or_any
from sim.mechanisms.traits import SIZE_SHARE


def name_of(mechanism: str, location: str | None, numbers: Mapping[str, float]) -> Name:
    told_by = kind_or_any(mechanism).told_by
    return Name(mechanism, location, numbers.get(told_by) if told_by else None)


def called(finding: Finding) -> Name:
    return name_of(finding.mechanism, finding.location, {e.name: e.value for e in finding.parameters})


def term_name(term: Term, values: Mapping[str, float]) -> Name:
    return name_of(term.mechanism, term.location, term.report(values))


def is_own(name: Name) -> bool:
    """Whether it is of a recording and not of the axis."""
    return kind_or_any(name.mechanism).of_the_recording


def said_by(result: Investigation, name: Name) -> Finding | None:
    return next((f for f in result.findings if called(f) == name), None)


def shows(result: Investigation, name: Name) -> bool:
    finding = said_by(result, name)
    return finding is not None and finding.probability >= SAID


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


def weighed(results: Sequence[Investigation]) -> dict[Name, Weighed]:
    """Every name that any recording gave; of names for one effect that nothing tells apart, the better founded."""
    named = list(dict.fromkeys(called(f) for result in results for f in result.findings))
    names = [name for name in named if not (is_own(name) and _gives_way(name, named, results))]
    sayings = {name: [_saying(result, name, results) for result in results] for name in names}
    gone = set(named) - set(names)
    rivals = {name: {r: odds for r, odds in against(sayings[name]).items() if r not in gone} for name in names}
    out: dict[Name, Weighed] = {}
    for name in names:
        given = [finding for result in results if (finding := said_by(result, name))]
        weighed_too = {r.mechanism for r in rivals[name]}
        left_out = weighed_too | {r.mechanism for r in gone}
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


def _saying(result: Investigation, name: Name, results: Sequence[Investigation]) -> LogOdds:
    """What a recording says of `name`."""
    finding = said_by(result, name)
    standings = _standings(result)
    values = {} if result.weighed is None else result.weighed.fit.values
    if finding is not None:
        if finding.evidence is None or name not in standings:  # by sound
            return LogOdds(logit(finding.probability) - PRIOR)
        beaten = _beaten(standings[name], values)
        return LogOdds(exists_in(finding.evidence) - PRIOR, beaten | _not_tried(result, name, results, beaten))
    for other, standing in standings.items():
        beaten = _beaten(standing, values)
        given = said_by(result, other)
        if name in beaten and given is not None and given.evidence is not None:
            return LogOdds(exists_in(given.evidence) - PRIOR, {other: -beaten[name]})
    if is_own(name):  # another recording knows nothing of it
        return LogOdds(0.0)
    found = found_at(results, name)
    if found is None:  # heard only
        return LogOdds(math.log(SILENT) if result.provenance["sound_sha256"] else 0.0)
    return LogOdds(_asked(result, *found))


def _not_tried(
    result: Investigation, name: Name, results: Sequence[Investigation], tried: Collection[Name]
) -> dict[Name, float]:
    """Log odds of a name that a recording gave against what was close in another, but was not among the `tried` here.

    Each is fitted in the place of the name, once, from the numbers that it has there.
    """
    own = _standings(result)[name].model
    present = {term_name(t, own.values) for t in own.terms}
    close: dict[Name, tuple[Term, Model]] = {}
    for standing in (of[name] for of in map(_standings, results) if name in of):
        for (rival, t), model in zip(standing.rivals, standing.instead, strict=True):
            other = term_name(rival, model.values)
            if is_close(t) and other not in tried and other not in present:
                close[other] = rival, model
    if result.weighed is None or not close:
        return {}
    problem = result.weighed.problem
    plain = named_alone(problem, result.weighed.fit)
    term = next(t for t in plain.terms if term_name(t, plain.values) == name)
    out: dict[Name, float] = {}
    for other, (rival, model) in close.items():
        fit = in_place(problem, plain, term, rival, (own_of(term, rival, model.values),))
        if fit is not None:
            out[other] = log_odds(paired(advantage(fit, plain)), WEIGHTS.overdispersion)
    return out


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


def _gives_way(own: Name, named: Iterable[Name], results: Sequence[Investigation]) -> bool:
    """Whether what recordings have for their own is, in each of them, a mechanism of the axis that others name.

    It must explain that recording as well, of the size that the others found, and be what it cannot be told from.
    """
    for name in named:
        if is_own(name):
            continue
        giving = [(r, f) for r in results if (f := said_by(r, own))]
        others = [r for r in results if said_by(r, own) is None and shows(r, name)]
        found = found_at(others, name)
        alike = all(name.mechanism in f.indistinguishable_from for _, f in giving)
        if found and alike and all(_instead_of(r, own, *found) for r, _ in giving):
            return True
    return False


def _instead_of(result: Investigation, own: Name, term: Term, fit: Fit) -> bool:
    """Whether `term` as it stands in `fit`, that of another recording, explains a recording as well as what it has."""
    selection = result.weighed
    if selection is None:
        return False
    has = selection.fit
    rest = tuple(t for t in has.terms if term_name(t, has.values) not in (own, term_name(term, fit.values)))
    other = _holding(selection.problem, has, rest, term, fit)
    return other is not None and 0.5 * TEMPERATURE * (other.cost - has.cost) < CLOSE


def _holding(problem: Problem, own: Fit, rest: Sequence[Term], term: Term, fit: Fit) -> Fit | None:
    """The model `rest` with `term`, its numbers held to what `fit`, that of another recording, knows of them."""
    spread = fit.deviations()
    held = tuple(
        replace(p, start=v, centre=v, spread=max(INFLATION * spread[p.name], SIZE_SHARE * abs(v), 1e-300))
        for p in term.parameters
        for v in [fit.values[p.name]]
    )
    start = {**own.values, **{p.name: p.start for p in held}}
    return problem.best((*rest, replace(term, parameters=held)), [(start, own.sensitivities)])


def _asked(result: Investigation, term: Term, fit: Fit) -> float:
    """Log odds for `term` from a recording that has to take it as it stands in `fit`, the fit of another."""
    selection = result.weighed
    if selection is None:
        return 0.0
    problem, own = selection.problem, selection.fit
    if term.contact and not problem.measurement.told.all():
        problem, own = all_rows(problem, own)
    name = term_name(term, fit.values)
    rest = tuple(t for t in own.terms if term_name(t, own.values) != name)
    without = own if len(rest) == len(own.terms) else problem.best(rest, [(own.values, own.sensitivities)])
    with_it = _holding(problem, own, rest, term, fit)
    return silent(without.cost - with_it.cost, TEMPERATURE) if without and with_it else 0.0
