"""What an investigation leaves open, and the next measurement in words, as the simulation of both sides tells it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.assessment.posterior import against_rivals, existence, is_close
from sim.investigation.hypotheses.catalogue import all_terms_of
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.next_measurement.discrimination import SEPARATES, separation_of_rivals
from sim.investigation.next_measurement.plans import REPEAT
from sim.investigation.report.formatting import named, number, words_of
from sim.investigation.report.maintenance_actions import SURE
from sim.investigation.results import MeasurementUtility
from sim.investigation.search.comparison import Model

if TYPE_CHECKING:
    from sim.investigation.results import Finding
    from sim.investigation.search.search import Selection

NOTHING = "nothing"
MOST_RIVALS = 2  # at once: the closest
LARGEST = 100.0  # times as clear: beyond, nobody counts


def simulated_advice(selection: Selection, findings: Sequence[Finding]) -> tuple[MeasurementUtility, ...]:
    """What each measurement would tell of what is least sure, the best first; empty where nothing is open."""
    said = {(f.mechanism, f.location): f for f in findings}
    told = {t.key: f for t in selection.found if (f := said.get((t.mechanism, t.location)))}
    for term in sorted((t for t in selection.found if t.key in told), key=lambda t: told[t.key].probability):
        rivals = {} if term.load_torque else _rivals(selection, term, told[term.key])
        if rivals:
            name, model = named(term.mechanism, term.location), selection.standings[term.key].model
            return separation_of_rivals(selection.problem, selection.fit, model, rivals, name)
    return ()


def _rivals(selection: Selection, term: Term, finding: Finding) -> dict[str, Model]:
    """What `term` is to be told from, by name; empty where it is sure, or where that was not fitted."""
    standing = selection.standings[term.key]
    tried = sorted(
        (
            (t, named(other.mechanism, other.location), other, model)
            for (other, t), model in zip(standing.rivals, standing.instead, strict=True)
            if other.load_torque is None
        ),
        key=lambda one: one[:2],
    )
    alike = {
        name: model
        for t, name, other, model in tried
        if is_close(t) or other.mechanism in finding.indistinguishable_from
    }
    if finding.lacks:
        alike |= _the_same(selection, term, finding)
    if alike or finding.indistinguishable_from or finding.probability >= SURE or finding.evidence is None:
        return dict(list(alike.items())[:MOST_RIVALS])
    exists = 1.0 / (1.0 + math.exp(-existence(finding.evidence)))
    if tried and against_rivals(finding.evidence.rivals, WEIGHTS.overdispersion) < exists:
        return {tried[0][1]: tried[0][3]}
    rest = tuple(t for t in standing.model.terms if t.key != term.key)
    without = selection.problem.best(rest, [(standing.model.values, {})], to_end=False)
    return {NOTHING: Model.of(without)} if without else {}


def _the_same(selection: Selection, term: Term, finding: Finding) -> dict[str, Model]:
    """Models with what this record cannot tell from `term` in its place: nobody looked for it, since it is the same."""
    problem, standing = selection.problem, selection.standings[term.key]
    rest = tuple(t for t in standing.model.terms if t.key != term.key)
    present = problem.chain(standing.model.terms, standing.model.values)
    out: dict[str, Model] = {}
    for other in all_terms_of(problem.axis, problem.measurement, present):
        name = named(other.mechanism, other.location)
        if other.mechanism in finding.indistinguishable_from and name not in out:
            fit = problem.best((*rest, other), [(standing.model.values, {})], to_end=False)
            out |= {name: Model.of(fit)} if fit else {}
    return out


def in_words(told: Sequence[MeasurementUtility]) -> str:
    """The best measurement and what it would show; empty where none tells the two causes apart."""
    if not told or told[0].separation < SEPARATES:
        return ""
    best, difference = told[0], told[0].difference
    first, second = best.between if difference.more >= 0 else best.between[::-1]
    size = f"{number(difference.torque_n_m)} N m"
    above = f"from {number(difference.low)} to" if difference.low else "below"
    where = f"{above} {number(difference.high)} rad/s of the load"
    if difference.more:
        shows = f"{_with(first)} still needs {size} more motor torque than one {_with(second)}, most {where}"
    else:
        apart = f"still differ by {size} in the {words_of(difference.channel)}"
        shows = f"{_with(first)} and one {_with(second)} {apart}, most {where}"
    doing = f"{best.text}, with all channels logged."
    return f"{doing} By simulation, with all numbers fitted, an axis {shows}. {_clearer(best)}"


def _with(name: str) -> str:
    return "without it" if name == NOTHING else f"with {name}"


def _clearer(best: MeasurementUtility) -> str:
    """How much more it tells than a repeat."""
    if best.text.startswith(f"{REPEAT.text}, for"):
        return "The same motion is enough: more of it tells them apart."
    times = best.separation / max(best.repeat, 1.0)
    said = f"over {LARGEST:.0f}" if times > LARGEST else f"{times:.2g}"
    return f"That tells them apart {said} times as clearly as a repeat of the present motion."
