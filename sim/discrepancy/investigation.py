"""The whole way from measured channels to what the model misses; the document of it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version

import numpy as np

from casebase.signals.recording import Recording
from casebase.signals.telemetry import Telemetry
from sim import mechanisms
from sim.axis import Axis
from sim.discrepancy.actions import action
from sim.discrepancy.advice import in_words, simulated_advice
from sim.discrepancy.condition import Fault, Gate, InvestigationError, examine
from sim.discrepancy.explanation import explain, next_measurement, numbers_of
from sim.discrepancy.extension import extended_axis
from sim.discrepancy.fit import Fit, Noise, Problem
from sim.discrepancy.gain import Gain, gains
from sim.discrepancy.pairs import NOT_COMPARED, check_as_new
from sim.discrepancy.refits import calibrate, polish
from sim.discrepancy.selection import Selection, select
from sim.discrepancy.size import deviations
from sim.discrepancy.sound import Listening, beside, listen, listen_alone
from sim.discrepancy.sound_evidence import Heard
from sim.discrepancy.sound_match import mismatch
from sim.discrepancy.telling import Told
from sim.discrepancy.terms import Term
from sim.discrepancy.unexplained import Unexplained, look, nameless, stands_out
from sim.discrepancy.weighing import Evidence, is_close, probability

VERSION = "1"
NINETY = 1.645
INFLATION = 3.0  # of deviations, so that intervals hold on the calibration seeds
FORM_SHARE = 0.08  # of a size, which the form of its law leaves open
DENT_SHARE = 0.3  # the same of a dent: the same torques come from a hollow and from a shallower piece broken out
NO_SIZE = ("angle_rad", "phase_rad", "second_phase_rad", "flank", "form", "order", "frequency_hz", "exponent")
SAID = 0.5  # probability from which a name is said
UNREACHED = 0.5  # of the torque: a model that leaves more says nothing of the axis
SOLID = ("inertia_kg_m2", "stiffness_n_m_per_rad")  # what no data sheet is far wrong in
FAR = 4.0  # mean square of the whitened residual: 1 is noise
NOT_NOISE = 2.0  # the same, where something is left whatever its place: without a cause 1.3 in 117 recordings at most
MOST_STRAIN = 120.0  # squared deviations of what is described: a model that needs more is not adequate
NO_REFERENCE = (
    "Without reference_position_rad noise of the torque channel cannot be told from torque, and weaker effects may "
    "hide in it: log it as well."
)
Progress = Callable[[str, float], None]
UNITS = {
    "_rad": "rad", "_n_m": "N m", "_rad_s": "rad/s", "_per_s": "1/s", "_per_rad2": "1/rad2",
    "_n_m_s_per_rad": "N m s/rad", "_hz": "Hz", "_s": "s", "_kg_m2": "kg m2", "_n_m_per_rad": "N m/rad",
}  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """One number with its 90 % interval."""

    name: str
    value: float
    unit: str
    low: float
    high: float
    nominal: float | None = None


@dataclass(frozen=True)
class Finding:
    """A mechanism that the description lacks and the data ask for."""

    mechanism: str
    location: str | None
    probability: float
    parameters: tuple[Estimate, ...]
    indistinguishable_from: tuple[str, ...]
    explanation: str
    evidence: Evidence | None = None
    elsewhere: tuple[str, ...] = ()  # places at which the data would be the same
    action: str = ""

    @property
    def calibrated(self) -> bool:
        """Whether its probability was calibrated: that of one telemetry's selection, of nothing else."""
        return self.evidence is not None


@dataclass(frozen=True)
class Investigation:
    """What the simulation gets wrong, why, and what the extension gained; `document()` is the contract's JSON."""

    axis: Axis
    verdict: str
    findings: tuple[Finding, ...]
    unexplained: Unexplained | None
    parameters: tuple[Estimate, ...]
    gain: tuple[Gain, ...]
    next_measurement: str
    extended: Axis
    provenance: Mapping[str, object]
    rejected: tuple[tuple[str, float], ...] = ()
    remarks: tuple[str, ...] = ()
    next_measurements: tuple[Told, ...] = ()
    selection: Selection | None = field(default=None, repr=False, compare=False)
    listening: Listening | None = field(default=None, repr=False, compare=False)
    gate: Gate | None = field(default=None, repr=False, compare=False)
    sounds: tuple[Recording, ...] = field(default=(), repr=False, compare=False)
    sound_offset_s: float = 0.0
    weighed: Selection | None = field(default=None, repr=False, compare=False)
    """As it was weighed, before the last fit of `polish`: what another recording found is held against this."""

    @property
    def examined(self) -> tuple[str, ...]:
        """Mechanisms that sound alone let be looked for; empty with telemetry, by which `rejected` tells."""
        return () if self.listening is None else self.listening.examined

    @property
    def not_examined(self) -> Mapping[str, str]:
        """Mechanisms that sound alone did not let be looked for, to the reason; empty with telemetry."""
        return {} if self.listening is None else self.listening.not_examined

    def document(self) -> dict[str, object]:
        """JSON of the contract: finite numbers only, the same for the same bytes."""
        return {
            "verdict": self.verdict,
            "findings": [_finding_json(f) for f in self.findings],
            "unexplained": None if self.unexplained is None else _unexplained_json(self.unexplained),
            "parameters": [
                {"name": e.name, "nominal": _round(e.nominal or 0.0), "estimate": _round(e.value), "low": _round(e.low),
                 "high": _round(e.high), "unit": e.unit}
                for e in self.parameters
            ],
            "gain": [
                {"channel": g.channel, "unit": g.unit, "rms_before": _round(g.rms_before),
                 "rms_after": _round(g.rms_after),
                 "held_out": True, "distinguishable_from_zero": g.significant, "rms_measured": _round(g.rms_measured)}
                for g in self.gain
            ],
            "next_measurement": self.next_measurement,
            "next_measurements": [told.document() for told in self.next_measurements],
            "extended_axis": self.extended.to_mapping(),
            "rejected": [{"mechanism": name, "gain": _round(gain)} for name, gain in self.rejected],
            "remarks": list(self.remarks),
            "provenance": dict(self.provenance),
            **({} if self.listening is None else
               {"examined": list(self.examined), "not_examined": dict(self.not_examined)}),
        }  # fmt: skip


def investigate(
    axis: Axis,
    telemetry: Telemetry | None,
    sound: Recording | Sequence[Recording] | None = None,
    progress: Progress = lambda stage, share: None,
    sound_offset_s: float = 0.0,
    as_new: Sequence[Recording] = (),
) -> Investigation:
    """Hold measured data of an axis against its description.

    Several recordings of the same axis can be given without telemetry; their evidence is taken together. `as_new` are
    recordings of the same motion from when the axis was in good order: sound without telemetry is compared with them.

    Raises
    ------
    InvestigationError
        for data that cannot be what they claim; the text says what would be right.
    """
    sounds = (sound,) if isinstance(sound, Recording) else tuple(sound or ())
    if telemetry is None and not sounds:
        raise InvestigationError("nothing to investigate: give telemetry, sound or both")
    if telemetry is None:
        return _sound_alone(axis, sounds, as_new, progress)
    if as_new:
        raise InvestigationError(NOT_COMPARED)
    if len(sounds) > 1:
        raise InvestigationError(
            f"sound: {len(sounds)} recordings beside one telemetry; give the one that starts with it"
        )
    progress("condition of the channels", 0.02)
    gate = examine(axis, telemetry)
    progress("calibration of what the description has", 0.08)
    problem = Problem(axis, gate.measurement, _first_noise(gate))
    problem, base = calibrate(problem)
    weighed = selection = told_apart(select(problem, base, progress, gate.law))
    problem, fit = selection.problem, selection.fit
    progress("sound", 0.78)
    heard = listen(axis, sounds[0], gate.measurement, sound_offset_s) if sounds else ()
    strange = mismatch(sounds[0], gate.measurement, sound_offset_s) if sounds else ()
    named = [term.mechanism for term in selection.found] + [fault.mechanism for fault in gate.faults]
    progress("gain on rows not used", 0.85)
    base = problem.fit((), base.values, held=base.sensitivities) if fit.terms else fit
    places = look(problem, fit)
    rest = [nameless(selection, term) for term in selection.nameless] + left(places, fit)
    _, base = polish(problem, base)
    problem, fit = polish(problem, fit)
    selection = replace(selection, problem=problem, base=base, fit=fit)
    progress("what is left", 0.92)
    struck, loud = _struck(axis, [*selection.found, *heard]), _loud(axis, selection.found)
    findings = (
        *(_finding(selection, term) for term in selection.found),
        *(_fault_finding(fault) for fault in gate.faults),
        *(_heard_finding(h) for h in beside(named, heard, problem.guided, struck, loud)),
    )
    findings = tuple(advised(axis, f) for f in findings)
    named_well = any(f.probability >= SAID for f in findings)
    if findings and not named_well:
        rest = rest or places[:1]  # something is there, but no name is more likely than not
    said = _said(fit, findings)
    gained = gains(problem, base, fit, said)
    doubts = _doubts(fit, gained)
    if doubts and not named_well:
        rest = rest or places[:1]  # a model that does not hold is not complete
    verdict = "named" if named_well else "unnamed" if rest else "nothing_missing"
    progress("next measurement", 0.96)
    told = simulated_advice(weighed, findings)
    advice = in_words(told) or next_measurement(axis, findings, rest, problem.guided)
    quieted = _quieted(problem, gate) if "reference_position_rad" in telemetry or named_well else (NO_REFERENCE,)
    progress("done", 1.0)
    return Investigation(
        axis, verdict, findings, rest[0] if rest else None, estimates(problem, fit), gained,
        advice, extended_axis(axis, fit, said),
        _provenance(axis, telemetry, sounds, problem),
        tuple((r.term.key, r.gain) for r in selection.rejected[:6]),
        (*gate.remarks, *doubts, *strange, *quieted, *_wrong(problem, fit), *_rested(problem), *_rattled(problem)),
        told, selection,
        weighed=weighed, gate=gate, sounds=sounds, sound_offset_s=sound_offset_s,
    )  # fmt: skip


def _said(fit: Fit, findings: Sequence[Finding]) -> tuple[Term, ...]:
    """Terms that are said to be there."""
    said = {(f.mechanism, f.location) for f in findings if f.probability >= SAID}
    return tuple(t for t in fit.terms if t.named and (t.mechanism, t.location) in said)


def _struck(axis: Axis, found: Sequence[Term | Heard]) -> list[float]:
    """Turns per turn of the motor of gears with a damaged tooth."""
    return [axis.ratio_from(t.location) / axis.ratio for t in found if t.mechanism == "tooth_damage" and t.location]


def _loud(axis: Axis, found: Sequence[Term]) -> list[float]:
    """Teeth per turn of the motor of gears whose teeth err."""
    teeth = {stage.name: stage.driven_teeth or 0 for stage in axis.stages}
    erring = [t.location for t in found if t.mechanism == "mesh_error" and t.location in teeth]
    return [teeth[place] * axis.ratio_from(place) / axis.ratio for place in erring]


def left(places: Sequence[Unexplained], fit: Fit) -> list[Unexplained]:
    """What stands out of the residual; where all of it is above its noise, its strongest place."""
    far = fit.misfit > NOT_NOISE * fit.residual.size
    return [u for u in places if stands_out(u)] or (list(places[:1]) if far else [])


def _first_noise(gate: Gate) -> Noise:
    """Weights before anything is known: what of the torque is too fast for the motion, and the load's share of it."""
    m = gate.measurement
    fast = float(np.std(np.diff(m.torque))) / math.sqrt(2.0) + 1e-3 * float(np.std(m.torque))
    return Noise.flat(3.0 * fast, 50.0 * fast)


def _sound_alone(
    axis: Axis, sounds: Sequence[Recording], as_new: Sequence[Recording], progress: Progress
) -> Investigation:
    progress("sound", 0.2)
    check_as_new((sound.sha256 for sound in sounds), (sound.sha256 for sound in as_new))
    listened = listen_alone(axis, sounds, as_new)
    findings = tuple(advised(axis, _heard_finding(h)) for h in listened.heard)
    progress("done", 1.0)
    return Investigation(
        axis, "named" if findings else "nothing_missing", findings, None, (), (), listened.next_measurement, axis,
        {**_provenance(axis, None, sounds, None), **_compared(as_new)}, remarks=listened.remarks, listening=listened,
        sounds=tuple(sounds),
    )  # fmt: skip


def _compared(as_new: Sequence[Recording]) -> dict[str, object]:
    return {"as_new_sha256": "+".join(one.sha256 for one in as_new)} if as_new else {}


def lacking(fit: Fit) -> float:
    """Squares by which the best model is not adequate: far above the noise, or only with a description bent far."""
    return max(0.0, fit.misfit - FAR * fit.residual.size) + max(0.0, fit.strain - MOST_STRAIN)


def _finding(selection: Selection, term: Term) -> Finding:
    """The probability is that of the name or one of those that it cannot be told from, wherever it acts."""
    fit, standing = selection.fit, selection.standings[term.key]
    duration = float(selection.problem.measurement.time_s[-1])
    alike = looks_like(selection.problem, term)
    near = {r.mechanism for r, t in standing.rivals if is_close(t)} - {term.mechanism, *alike}
    close = [*alike, *sorted(near)][:2]
    others = tuple(t for r, t in standing.rivals if r.mechanism not in (term.mechanism, *close))
    places = [r.location for r, t in standing.rivals if r.mechanism == term.mechanism and is_close(t)]
    elsewhere = tuple(place for place in places if place)
    brought = {r.term.key: r.gain for r in selection.rivals.get(term.key, ())}
    instead = {
        r.mechanism: brought[r.key] / brought[term.key]
        for r, t in standing.rivals
        if t > 0.0 and r.mechanism not in (term.mechanism, *close) and r.key in brought and term.key in brought
    }
    seen = Evidence(standing.share, others, (standing.shared + lacking(fit)) / standing.gain)
    return Finding(
        term.mechanism, term.location, probability(seen), term_estimates(fit, term, duration), tuple(close),
        explain(term.mechanism, term.location, term.report(fit.values), elsewhere, instead), seen, elsewhere,
    )  # fmt: skip


def _doubts(fit: Fit, gained: Sequence[Gain]) -> tuple[str, ...]:
    """Why the numbers of the last fit are not to be trusted, if anything says so."""
    out = []
    torque = gained[0]
    if torque.rms_after > UNREACHED * torque.rms_measured:
        out.append(
            f"The model does not reach the measurement: of {torque.rms_measured:.3g} {torque.unit} effective torque it "
            f"leaves {torque.rms_after:.3g}. Check the description, the channels' units and signs, and what happened "
            "during the record before any of these numbers is used."
        )
    bent = [
        f"{p.name} {p.expected:.3g} -> {fit.values[p.name]:.3g}"
        for p, limit in zip(fit.parameters, fit.at_limit, strict=True)
        if limit and p.name.endswith(SOLID)
    ]
    if bent:
        out.append(
            f"To explain the data the description would have to be wrong by a factor of 2.5: {', '.join(bent)}. "
            "Either the description is of another axis, or something is missing that no mechanism explains."
        )
    return tuple(out)


def _wrong(problem: Problem, fit: Fit) -> tuple[str, ...]:
    """Numbers of the description that were taken for wrong."""
    wrong = [
        f"{p.name} {p.expected:.3g} -> {fit.values[p.name]:.3g}" for p in fit.parameters if p.name in problem.doubts
    ]
    if not wrong:
        return ()
    return (
        f"The data do not bear out what the description says: {', '.join(wrong)}. Either it has these numbers wrong, "
        "or they stand for something too weak to be named. Check them before a cause is looked for.",
    )


def advised(axis: Axis, finding: Finding) -> Finding:
    """With what to do now about it."""
    f = finding
    return replace(f, action=action(axis, f.mechanism, f.location, numbers_of(f), f.probability))


def _quieted(problem: Problem, gate: Gate) -> tuple[str, ...]:
    """That the torque channel's own noise was taken away, if it was."""
    if gate.law is None or not problem.measurement.unsure.size:
        return ()
    taken = float(np.std(gate.measurement.torque - problem.measurement.torque))
    return (
        "The drive's law, found in reference and encoder, tells noise of the torque channel; what was found is found "
        f"without {taken:.2g} N m (effective) of it.",
    )


def _rested(problem: Problem) -> tuple[str, ...]:
    """Which rows did not count, if any."""
    m = problem.measurement
    if m.rests and not problem.guided:
        return ()
    slowest = m.standstill * float(np.abs(m.speed).max())
    where = " at the load" if m.rests else ""
    told = f"Rows in which the motor turns slower than {slowest:.2g} rad/s did not count{where}"
    return (f"{told}: at rest dry friction holds whatever it likes.",)


def _rattled(problem: Problem) -> tuple[str, ...]:
    """In how many rows teeth rattle, if in any."""
    lost = 1.0 - float(problem.measurement.told.mean())
    if lost == 0.0:
        return ()
    return (
        f"In {100.0 * lost:.2g} % of the rows nothing presses the teeth together, and they rattle within the play that "
        "is as new: what torque that takes cannot be told, and these rows did not count. A load that always pulls one "
        "way presses them together.",
    )


def told_apart(selection: Selection) -> Selection:
    """Of two that no measurement tells apart, only the one that takes away more is found: only their sum is known."""
    alike = {t.key: looks_like(selection.problem, t) for t in selection.found}
    gains = selection.gains
    found = tuple(
        t
        for t in selection.found
        if not any(t.mechanism in alike[o.key] and o.mechanism in alike[t.key] and gains[o.key] > gains[t.key]
                   for o in selection.found)
    )  # fmt: skip
    return replace(selection, found=found)


def looks_like(problem: Problem, term: Term) -> tuple[str, ...]:
    """What no measurement of motor and load tells from `term`.

    Runout of the last gear and an error of the load encoder differ by the torque of the load's inertia along the
    error: by the square of once per turn over the natural frequency, 0.2 % on a robot's joint. Errors of teeth whose
    number is not known are looked for nowhere, and a loop of the spring bends to them.
    """
    stages = problem.axis.stages
    if term.mechanism == "hysteresis" and any(s.name == term.location and s.driven_teeth is None for s in stages):
        return ("mesh_error",)
    last = stages[-1].name if stages else None
    if not problem.guided or last is None:
        return ()
    if term.mechanism == "encoder_error":
        return ("eccentricity",)
    return ("encoder_error",) if (term.mechanism, term.location) == ("eccentricity", last) else ()


def term_estimates(fit: Fit, term: Term, duration_s: float) -> tuple[Estimate, ...]:
    """Reported parameters with intervals, no wider than a parameter may be; a frequency is not known better than the
    record is long."""
    spread = deviations(fit, term, term.report)
    limits = {p.name: (p.low, p.high) for p in term.parameters}
    units = {p.name: p.unit for p in mechanisms.MECHANISMS[term.mechanism].parameters}
    out = []
    for name, value in term.report(fit.values).items():
        half = NINETY * inflation(fit) * spread[name]
        if name not in NO_SIZE:
            half = max(half, (DENT_SHARE if term.mechanism == "tooth_damage" else FORM_SHARE) * abs(value))
        if name == "frequency_hz":
            half = max(half, 1.0 / duration_s)
        low, high = limits.get(f"{term.key}.{name}", (-math.inf, math.inf))
        ends = float(max(value - half, low)), float(min(value + half, high))
        out.append(Estimate(name, float(value), units[name], *ends))
    return tuple(out)


def inflation(fit: Fit) -> float:
    """Widen intervals by what the residual has beyond white noise (form of the model, slow noise)."""
    return INFLATION * math.sqrt(max(1.0, fit.misfit / fit.residual.size))


def estimates(problem: Problem, fit: Fit) -> tuple[Estimate, ...]:
    deviations = fit.deviations()
    scale = inflation(fit)
    out = []
    for p in fit.parameters:
        if not p.name.startswith(("motor.", "load.", "stages.")) or "backlash" in p.name:
            continue
        half = NINETY * deviations[p.name] * scale
        out.append(
            Estimate(
                p.name,
                fit.values[p.name],
                unit_of(p.name),
                fit.values[p.name] - half,
                fit.values[p.name] + half,
                p.expected,
            )
        )
    return tuple(out)


def unit_of(name: str) -> str:
    """Unit by the ending of a name; `1` where it has none."""
    for ending in sorted(UNITS, key=len, reverse=True):
        if name.endswith(ending):
            return UNITS[ending]
    return "1"


def _fault_finding(fault: Fault) -> Finding:
    estimates = tuple(Estimate(k, v, unit_of(k), v, v) for k, v in fault.parameters.items())
    return Finding(fault.mechanism, fault.location, 0.97, estimates, (), fault.explanation)


def _heard_finding(h: Heard) -> Finding:
    estimates = tuple(Estimate(k, v, unit_of(k), low, high) for k, (v, low, high) in h.parameters.items())
    return Finding(
        h.mechanism, h.location, h.probability, estimates, h.indistinguishable_from, h.explanation,
        elsewhere=h.elsewhere,
    )  # fmt: skip


def _provenance(
    axis: Axis, telemetry: Telemetry | None, sounds: Sequence[Recording], problem: Problem | None
) -> dict[str, object]:
    digest = hashlib.sha256()
    if telemetry is not None:
        for name in sorted(telemetry.channels):
            digest.update(name.encode() + telemetry.channels[name].tobytes())
    return {
        "gearcase": version("gearcase"),
        "method": f"guided chain {VERSION}",
        "axis": axis.name,
        "telemetry_sha256": digest.hexdigest() if telemetry is not None else None,
        "sound_sha256": "+".join(sound.sha256 for sound in sounds) or None,
        "rows": 0 if problem is None else problem.measurement.samples,
        "rate_hz": 0.0 if problem is None else _round(problem.measurement.rate_hz),
    }


def _round(value: float) -> float:
    """Seven digits: what two runs of the same bytes agree on whatever the order of a sum."""
    return float(f"{value:.7g}") if math.isfinite(value) else 0.0


def _finding_json(f: Finding) -> dict[str, object]:
    return {
        "mechanism": f.mechanism,
        "location": f.location,
        "probability": round(f.probability, 4),
        "calibrated": f.calibrated,
        "parameters": [
            {"name": e.name, "value": _round(e.value), "unit": e.unit, "low": _round(e.low), "high": _round(e.high)}
            for e in f.parameters
        ],
        "indistinguishable_from": list(f.indistinguishable_from),
        "explanation": f"{f.explanation} {f.action}".strip(),
        **({"elsewhere": list(f.elsewhere)} if f.elsewhere else {}),
    }


def _unexplained_json(u: Unexplained) -> dict[str, object]:
    return {
        "kind": u.kind,
        "channel": u.channel,
        "share": _round(u.share),
        "score": _round(u.score),
        **{name: _round(value) for name, value in u.numbers.items()},
    }
