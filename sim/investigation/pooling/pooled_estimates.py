"""Numbers of several recordings of an axis, by models that have the same mechanisms in all of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from signals.recording import Recording
from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.investigation.assessment.held_out_gain import gains
from sim.investigation.assessment.intervals import (
    NINETY,
    NO_SIZE,
    estimates,
    inflation,
    term_estimates,
)
from sim.investigation.assessment.residual_structure import structure_of
from sim.investigation.assessment.verdict import AT_LOAD, left
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import all_rows, final_fit
from sim.investigation.extended_axis import extended_by
from sim.investigation.hypotheses.hypothesis import AS_NEW, Term, traits_of
from sim.investigation.pooling.recording_evidence import (
    Known,
    LogOdds,
    Name,
    finding_named,
    found_at,
    instead,
    is_own,
    pooled,
    term_name,
)
from sim.investigation.results import Estimate, Finding, Gain, Investigation
from sim.investigation.unexplained import Unexplained

ANGLES = ("angle_rad", "phase_rad", "second_phase_rad")


@dataclass(frozen=True)
class NamedRecording:
    """One recording of the axis, and what it is called; `sound` starts with the telemetry."""

    name: str
    telemetry: Telemetry
    sound: Recording | None = None
    sound_name: str | None = None


@dataclass(frozen=True)
class Part:
    """A recording and what it says by itself; `problem` and `fit` under the mechanisms that all of them share."""

    recording: NamedRecording
    result: Investigation
    problem: Problem
    fit: Fit
    unexplained: Unexplained | None
    gain: tuple[Gain, ...]


def under_one_model(
    recording: NamedRecording, result: Investigation, results: Sequence[Investigation], said: Sequence[Name]
) -> Part:
    """A recording under the mechanisms `said` and what it has of its own; refitted where it had others,
    as it was where unseen rows are predicted worse by that.

    What has no name takes a share of friction's torque: it stays where all recordings have it, else in none.
    """
    selection, weighed = result.selection, result.weighed
    assert selection is not None  # of telemetry
    assert weighed is not None
    values = weighed.fit.values
    present = {term_name(t, values): t for t in weighed.fit.terms if t.named}
    wrong = {n for n, t in present.items() if t in weighed.found and n not in said}
    tried = instead(result, wrong)
    wanted = [name for name in said if name not in present and (not is_own(name) or name in tried)]
    lacking = [found for name in wanted if (found := found_at(results, name))]
    common = set.intersection(*({_curve(t) for t in r.weighed.fit.terms} for r in results if r.weighed))
    kept = [
        t
        for t in weighed.fit.terms
        if (t.named or t.mechanism == AS_NEW or _curve(t) in common) and term_name(t, values) not in wrong
    ]
    if not lacking and len(kept) == len(weighed.fit.terms):
        return Part(recording, result, selection.problem, selection.fit, result.unexplained, result.gain)
    start = {**values, **{p.name: fit.values[p.name] for term, fit in lacking for p in term.parameters}}
    problem, fit = weighed.problem, weighed.fit
    if any(term.contact for term, _ in lacking) and not problem.measurement.predictable.all():
        problem, fit = all_rows(problem, fit)
    anew = problem.best((*kept, *(term for term, _ in lacking)), [(start, fit.sensitivities)])
    if anew is None:
        return Part(recording, result, selection.problem, selection.fit, result.unexplained, result.gain)
    base = problem.fit((), weighed.base.values, held=weighed.base.sensitivities if problem is weighed.problem else {})
    rest = left(structure_of(problem, anew), anew) if lacking else [result.unexplained] if result.unexplained else []
    _, base = final_fit(problem, base)
    problem, fit = final_fit(problem, anew)
    terms = tuple(t for t in fit.terms if t.named and term_name(t, fit.values) in said)
    gained = gains(problem, base, fit, terms)
    if any(g.rms_after > AT_LOAD * g.rms_before for g in gained):  # by more than chance
        return Part(recording, result, selection.problem, selection.fit, result.unexplained, result.gain)
    return Part(recording, result, problem, fit, rest[0] if rest else None, gained)


def denied(parts: Sequence[Part], said: Sequence[Name]) -> set[tuple[Name, int]]:
    """Names of the axis that a model of a recording does not have: with them it predicts unseen rows worse."""
    present = [{term_name(t, part.fit.values) for t in part.fit.terms if t.named} for part in parts]
    return {(n, place) for n in said if not is_own(n) for place, terms in enumerate(present) if n not in terms}


def _curve(term: Term) -> tuple[str, ...]:
    """What a term without a name is told by: its place, and its numbers, as curves of several orders lie in one."""
    return str(term.key), *(p.name for p in term.parameters)


def sizes(parts: Sequence[Part], name: Name, sayings: Sequence[LogOdds]) -> dict[str, tuple[Estimate, ...]]:
    """Numbers of a mechanism by recording, of those that show it or take it gladly."""
    out = {}
    for part, saying in zip(parts, sayings, strict=True):
        terms = [t for t in part.fit.terms if t.named and term_name(t, part.fit.values) == name]
        finding = finding_named(part.result, name)
        if terms and (finding is not None or saying.exists > 0.0):
            out[part.recording.name] = term_estimates(
                part.fit, terms[0], part.problem.measurement, terms[0].report(part.fit.values)
            )
        elif finding is not None:
            out[part.recording.name] = finding.parameters
    return out


def pooled_sizes(name: Name, by_recording: Mapping[str, Sequence[Estimate]]) -> tuple[Estimate, ...]:
    """Of each number one; what the form of a law leaves open, all recordings share, and it does not average out."""
    if len(by_recording) == 1:
        return tuple(next(iter(by_recording.values())))
    names = dict.fromkeys(e.name for numbers in by_recording.values() for e in numbers)
    share = traits_of(name.mechanism).size_open
    return tuple(
        pooled_estimate([e for numbers in by_recording.values() for e in numbers if e.name == one],
                        share=0.0 if one in NO_SIZE else share)
        for one in names
    )  # fmt: skip


def pooled_estimate(same: Sequence[Estimate], priors: Sequence[float] = (), share: float = 0.0) -> Estimate:
    """One number of the same in several recordings; `priors`: its deviation as known before each of them.

    `share` of the value is the least half-width of the interval. One alone stays as it is.
    """
    first = same[0]
    if len(same) == 1:
        return first
    before = priors or [math.inf] * len(same)
    known = [Known(e.value, (e.high - e.low) / (2.0 * NINETY), b) for e, b in zip(same, before, strict=True)]
    one = pooled(known, 2.0 * math.pi if first.name in ANGLES else 0.0)
    half = max(NINETY * one.sd, share * abs(one.value))
    return replace(first, value=one.value, low=one.value - half, high=one.value + half)


def calibrated(parts: Sequence[Part]) -> tuple[Estimate, ...]:
    """What the description has, by all recordings; the data sheet counts once."""
    by_name: dict[str, list[tuple[Estimate, float]]] = {}
    for part in parts:
        before = {p.name: inflation(part.fit, part.problem.measurement) * p.spread for p in part.fit.parameters}
        for e in estimates(part.problem, part.fit):
            by_name.setdefault(e.name, []).append((e, before[e.name]))
    return tuple(pooled_estimate([e for e, _ in same], [sd for _, sd in same]) for same in by_name.values())


def extension(
    axis: Axis,
    parts: Sequence[Part],
    said: Sequence[Name],
    sizes: Mapping[Name, Mapping[str, Sequence[Estimate]]],
    numbers: Mapping[Name, Sequence[Estimate]],
    calibration: Sequence[Estimate],
    own: Mapping[Name, Finding],
) -> Axis:
    """The axis with the combined numbers; of what belongs to recordings only what all of them have."""
    values = {e.name: e.value for e in calibration}
    for name in said:
        if traits_of(name.mechanism).in_every_axis:
            values |= _split(parts, name.mechanism, sizes[name])
    found = {(n.mechanism, n.location): {e.name: e.value for e in numbers[n]} for n in said}
    found |= {(n.mechanism, n.location): {e.name: e.value for e in f.parameters} for n, f in own.items()}
    return extended_by(axis, values, found)


def _split(parts: Sequence[Part], mechanism: str, sizes: Mapping[str, Sequence[Estimate]]) -> dict[str, float]:
    """Friction of motor and load whose sum is the pooled one: means with the same weights."""
    out: dict[str, float] = {}
    weight = {name: (max(e[0].high - e[0].low, 1e-300)) ** -2.0 for name, e in sizes.items()}
    for part in parts:
        share = weight.get(part.recording.name, 0.0) / sum(weight.values())
        for name in (p.name for t in part.fit.terms if t.mechanism == mechanism for p in t.parameters):
            if share:
                out[name] = out.get(name, 0.0) + share * part.fit.values[name]
    return out
