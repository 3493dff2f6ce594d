"""From a selection to findings: what cannot be told apart, what the fit lacks, how sure a name is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim.description.axis import Axis
from sim.investigation.acoustic.evidence import AcousticFinding
from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.assessment.held_out_gain import gains
from sim.investigation.assessment.intervals import NINETY, term_estimates, unit_of
from sim.investigation.assessment.misfit import widened
from sim.investigation.assessment.posterior import Evidence, is_close, probability
from sim.investigation.assessment.residual_structure import stands_out
from sim.investigation.data.excitation import lacking
from sim.investigation.data.validation import Fault
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.friction import friction_felt
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.hypotheses.identifiability import ALONE, needs_of, same_over_the_turn, the_same
from sim.investigation.model.parameters import Values
from sim.investigation.report.wording import explain
from sim.investigation.results import REPORTED, Estimate, Finding, Gain
from sim.investigation.search.effect_size import effect_size
from sim.investigation.search.search import Selection
from sim.investigation.unexplained import Unexplained
from sim.mechanisms.catalogue import kind_of, kind_or_any
from sim.mechanisms.mechanism import Law

UNLIKELY = 0.4  # less likely than not
NAMES = 40.0  # mechanisms and places among which one is looked for
JOINTS = 6.0  # of an arm: each is another place at which a name is looked for
SHOWN = 3.0  # standard deviations of friction, of which every axis has some
AT_LOAD = 1.02  # times as much left on unseen rows
FAR = 4.0  # mean square of the whitened residual: 1 is noise
NOT_NOISE = 2.0  # the same, where something is left whatever its place: without a cause 1.3 in 117 recordings at most
MOST_STRAIN = 120.0  # squared deviations of what is described: a model that needs more is not adequate


def reported_terms(fit: Fit, findings: Sequence[Finding]) -> tuple[Term, ...]:
    """Terms that are said to be there."""
    said = {(f.mechanism, f.location) for f in findings if f.probability >= REPORTED}
    return tuple(t for t in fit.terms if t.named and (t.mechanism, t.location) in said)


def refit_reported(selection: Selection, findings: Sequence[Finding]) -> tuple[tuple[Finding, ...], Fit]:
    """Findings, and the fit without those that are not said, by which the numbers of the others are.

    Two of a fit may stand against each other, as an offset and friction unlike in both directions do. Where one of them
    is not said, the other is as large as the data need it without; how sure its size is it tells beside all that may be
    there.
    """
    found, fit = tuple(findings), selection.fit
    for _ in findings:
        anew = _without(selection.problem, fit, [f for f in found if f.probability < REPORTED])
        if anew is fit:
            break
        fit = anew
        found = tuple(_again(selection, f, fit) for f in found)
    return found, fit


def _without(problem: Problem, fit: Fit, gone: Sequence[Finding]) -> Fit:
    """The fit without the terms of these findings."""
    names = {(f.mechanism, f.location) for f in gone}
    kept = tuple(t for t in fit.terms if (t.mechanism, t.location) not in names)
    if len(kept) == len(fit.terms):
        return fit
    return problem.fit(kept, fit.values, held=fit.sensitivities, to_end=True)


def _again(selection: Selection, finding: Finding, fit: Fit) -> Finding:
    """The finding by the numbers of `fit`, if it has it; no more likely than it was."""
    name = (finding.mechanism, finding.location)
    term = next((t for t in selection.found if (t.mechanism, t.location) == name and t in fit.terms), None)
    if term is None:
        return finding
    anew = finding_of(selection, term, fit.values)
    return replace(anew, probability=min(anew.probability, finding.probability))


def predicting(
    selection: Selection, fit: Fit, findings: Sequence[Finding]
) -> tuple[tuple[Finding, ...], Fit, tuple[Gain, ...]]:
    """Findings with which unseen rows are predicted no worse than without any, their fit, and what they gain.

    Where a channel is predicted worse, the one goes first whose lack betters the prediction of all channels most: what
    it explains of the rows it was fitted to it does not explain of others. What another channel needs stays.
    """
    problem, base = selection.problem, selection.base
    kept = tuple(findings)
    gained = gains(problem, base, fit, reported_terms(fit, kept))
    while (said := reported_terms(fit, kept)) and any(is_worse(g) for g in gained):
        names = [(t.mechanism, t.location) for t in said]
        without = [tuple(f for f in kept if (f.mechanism, f.location) != name) for name in names]
        fits = [_without(problem, fit, [f for f in kept if (f.mechanism, f.location) == name]) for name in names]
        tried = [gains(problem, base, f, reported_terms(f, rest)) for f, rest in zip(fits, without, strict=True)]
        best = min(range(len(said)), key=lambda k: left_over(tried[k]))
        if left_over(tried[best]) >= left_over(gained):
            break
        fit, gained = fits[best], tried[best]
        kept = tuple(_again(selection, f, fit) for f in without[best])
    return kept, fit, gained


def under_misfit(findings: Sequence[Finding], adequate: float) -> tuple[Finding, ...]:
    """Findings of a model as less likely and their sizes as less known as it is not `adequate`.

    What no model explains may have the shape of anything that was found: of a name's probability remains the share of
    the squares that is explained.
    """
    return tuple(
        replace(f, probability=adequate * f.probability, parameters=widened(f.parameters, adequate))
        if f.evidence is not None
        else f
        for f in findings
    )


def left_over(gained: Sequence[Gain]) -> float:
    """Logarithm of what is left on unseen rows over what was left before, of all channels."""
    return sum(math.log(max(g.rms_after, 1e-300) / max(g.rms_before, 1e-300)) for g in gained)


def is_worse(gain: Gain) -> bool:
    """Whether a channel is predicted worse; at the load, of which the motor tells little, by more than chance."""
    return gain.rms_after > (1.0 if gain.channel == "motor_torque_nm" else AT_LOAD) * gain.rms_before


def left(places: Sequence[Unexplained], fit: Fit) -> list[Unexplained]:
    """What stands out of the residual; where all of it is above its noise, its strongest place."""
    far = fit.misfit > NOT_NOISE * fit.residual.size
    return [u for u in places if stands_out(u)] or (list(places[:1]) if far else [])


def inadequacy(fit: Fit) -> float:
    """Squares by which the best model is not adequate: far above the noise, or only with a description bent far."""
    return max(0.0, fit.misfit - FAR * fit.residual.size) + max(0.0, fit.prior_penalty - MOST_STRAIN)


def finding_of(selection: Selection, term: Term, values: Values | None = None) -> Finding:
    """The probability is that of the name or one of those that it cannot be told from, wherever it acts.

    `values`: numbers of a fit with fewer terms than the selection's, which are said then.
    """
    fit, standing = selection.fit, selection.standings[term.key]
    axis, m = selection.problem.axis, selection.problem.measurement
    missing, numbers = lacking(m), term.report(fit.values if values is None else values)
    same = (*the_same(term.mechanism, missing), *same_over_the_turn(axis, m, term.mechanism, numbers.get("order")))
    alike = (*looks_like(selection.problem, term), *same)
    near = {r.mechanism for r, t in standing.rivals if is_close(t)} - {term.mechanism, *alike}
    close = [*alike, *sorted(near)][:2]
    estimated = term_estimates(fit, term, m, numbers)
    others = tuple(t for r, t in standing.rivals if r.mechanism not in (term.mechanism, *close))
    places = [r.location for r, t in standing.rivals if r.mechanism == term.mechanism and is_close(t)]
    elsewhere = tuple(place for place in places if place)
    brought = {r.term.key: r.gain for r in selection.rivals.get(term.key, ())}
    instead = {
        r.mechanism: brought[r.key] / brought[term.key]
        for r, t in standing.rivals
        if t > 0.0 and r.mechanism not in (term.mechanism, *close) and r.key in brought and brought.get(term.key)
    }
    seen = Evidence(standing.share, others, (standing.shared + inadequacy(fit)) / standing.gain)
    sure = min(probability(seen), WEIGHTS.cap)
    new = not is_beyond_new(axis, term.mechanism, term.location, estimated)
    if m.doubts.size and not term.traits.in_every_axis:
        as_shaped = term_estimates(fit, term, m, numbers, term.shape)
        gain, usual = selection.gains.get(term.key, math.inf), usual_at_joint(selection.problem, term, fit)
        there = likelier_than_new(axis, term, as_shaped, gain, usual)
        sure, new = min(sure, there), there < REPORTED
    if new and term.traits.in_every_axis and effect_size(term, fit) < SHOWN:
        sure = min(sure, 1.0 / (1.0 + NAMES))  # every axis has some, and this record shows none
    if same or new:
        sure = min(sure, ALONE)
    return Finding(
        term.mechanism, term.location, sure, estimated, tuple(close),
        explain(term.mechanism, term.location, numbers, elsewhere, instead), seen, elsewhere,
        as_new_too=new and not term.traits.in_every_axis,
        lacks=tuple(need.value for need in needs_of(term.mechanism) & missing),
    )  # fmt: skip


def discount_if_residual(
    findings: Sequence[Finding], rest: Sequence[Unexplained], *, doubted: bool = False
) -> tuple[Finding, ...]:
    """Findings where something without a name is left: of a size that a new axis may have too, that is the likelier.

    So is, where the known torque is `doubted`, that it is wrong in one of its ways.
    """
    if not rest and not doubted:
        return tuple(findings)
    return tuple(replace(f, probability=min(f.probability, UNLIKELY)) if f.as_new_too else f for f in findings)


def drop_within_tolerance(findings: Sequence[Finding], *, doubted: bool) -> tuple[Finding, ...]:
    """Findings that say that something is missing: where the known torque is `doubted`, none of a size as new.

    That the known torque is wrong in one of its ways is likelier then, and by that nothing is missing.
    """
    return tuple(f for f in findings if not (doubted and f.as_new_too))


def is_beyond_new(axis: Axis, mechanism: str, location: str | None, estimated: Sequence[Estimate]) -> bool:
    """Whether the interval of a size leaves out what a new axis has: else the data are also those of a new one."""
    kind = kind_of(mechanism)
    new = kind.as_new(axis, location)
    sizes = [e for e in estimated if e.name in kind.sizes()]
    return any(e.low > new or e.high < -new for e in sizes)


def usual_at_joint(problem: Problem, term: Term, fit: Fit) -> dict[str, float]:
    """Numbers that a joint of a robot in good order may have: its friction is a little unlike in both directions, which
    in motion is an offset as well, and a little less once it has warmed up within a log."""
    m, chain = problem.measurement, problem.chain(fit.terms, fit.values)
    top = float(np.abs(m.speed).max())
    dry = friction_felt(chain, 0.0)
    viscous = (friction_felt(chain, top) - dry) / top
    all_of_it = {
        "torque_n_m": dry, "coefficient_n_m_s_per_rad": viscous, "rate_per_s": 1.0 / float(m.time_s[-1]),
    }  # fmt: skip
    return {name: term.traits.in_good_order * number for name, number in all_of_it.items()}


def likelier_than_new(
    axis: Axis, term: Term, estimated: Sequence[Estimate], gain: float, usual: Mapping[str, float]
) -> float:
    """Probability that a size of a joint is more than as new, one in 40 names at each of an arm's joints beforehand.

    By the ratio of the densities there (Dickey 1971), where it is expected to be about as large as it was found. No
    further from nothing than the `gain` of whitened squares says, in which slow noise is counted. `estimated`: of the
    shape as it was found; what a size trades with its shape does not make it nothing. `usual`: numbers that a joint in
    good order may have.
    """
    kind = kind_of(term.mechanism)
    new = kind.as_new(axis, term.location)
    far = max(
        (abs(e.value) - max(new, usual.get(e.name, 0.0))) / max(e.high - e.value, e.value - e.low, 1e-300)
        for e in estimated
        if e.name in kind.sizes()
    )
    z = min(max(far * NINETY, 0.0), math.sqrt(max(gain, 0.0)))
    return 1.0 / (1.0 + JOINTS * NAMES * max(z, 1.0) * math.exp(-0.5 * z * z))


def drop_unidentifiable(selection: Selection) -> Selection:
    """Of two that no measurement tells apart, only the one that takes away more is found, and fitted: only their sum is
    known."""
    alike = {t.key: looks_like(selection.problem, t) for t in selection.found}
    gains = selection.gains
    doubted = selection.problem.measurement.doubts.size > 0
    same = {frozenset((t.key, o.key)) for t in selection.found for o in selection.found
            if (t.mechanism in alike[o.key] and o.mechanism in alike[t.key])
            or (doubted and Law.OFFSET in t.traits.laws & o.traits.laws and t is not o)}  # fmt: skip
    found = tuple(
        t
        for t in selection.found
        if not any(frozenset((t.key, o.key)) in same and gains[o.key] > gains[t.key] for o in selection.found)
    )
    if len(found) == len(selection.found):
        return selection
    gone = [t for t in selection.found if t not in found]
    kept = [t for t in selection.fit.terms if t not in gone]
    fit = selection.problem.fit(kept, selection.fit.values, held=selection.fit.sensitivities, to_end=True)
    return replace(selection, fit=fit, found=found)


def looks_like(problem: Problem, term: Term) -> tuple[str, ...]:
    """What no measurement of motor and load tells from `term`."""
    return kind_or_any(term.mechanism).looks_like(problem.axis, term.location, problem.guided)


def finding_of_fault(fault: Fault) -> Finding:
    """A fault of the measurement as a finding."""
    estimates = tuple(Estimate(k, v, unit_of(fault.mechanism, k), v, v) for k, v in fault.parameters.items())
    return Finding(fault.mechanism, fault.location, 0.97, estimates, (), fault.explanation)


def finding_of_sound(h: AcousticFinding) -> Finding:
    """What was heard as a finding."""
    estimates = tuple(Estimate(k, v, unit_of(h.mechanism, k), low, high) for k, (v, low, high) in h.parameters.items())
    return Finding(
        h.mechanism, h.location, h.probability, estimates, h.indistinguishable_from, h.explanation,
        elsewhere=h.elsewhere,
    )  # fmt: skip
