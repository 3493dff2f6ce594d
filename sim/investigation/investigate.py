"""The whole way from measured channels to what the model misses; the document of it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from signals.recording import Recording
from signals.telemetry import Telemetry
from sim.description.axis import Axis
from sim.investigation.acoustic.evidence import AcousticFinding
from sim.investigation.acoustic.fusion import not_named_yet, sound_alone, sound_with_telemetry
from sim.investigation.acoustic.recording_quality import mismatch
from sim.investigation.assessment.intervals import estimates
from sim.investigation.assessment.misfit import adequacy, excess, widened
from sim.investigation.assessment.remarks import (
    contact_loss_remarks,
    description_remarks,
    excitation_remarks,
    misfit_remarks,
    shown_remark,
    standstill_remarks,
)
from sim.investigation.assessment.residual_structure import nameless, structure_of
from sim.investigation.assessment.verdict import (
    NAMES,
    discount_if_residual,
    drop_unidentifiable,
    drop_within_tolerance,
    finding_of,
    finding_of_fault,
    finding_of_sound,
    left,
    predicting,
    refit_reported,
    reported_terms,
    under_misfit,
)
from sim.investigation.data.excitation import excitation_of
from sim.investigation.data.pairing import NOT_COMPARED, check_as_new
from sim.investigation.data.preprocessing import Array, Measurement
from sim.investigation.data.validation import DataCheck, InvestigationError, examine
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import calibrate, final_fit
from sim.investigation.estimation.whitening import Noise
from sim.investigation.extended_axis import extended_axis
from sim.investigation.kinematics.encoders_alone import NEXT, encoders_alone
from sim.investigation.model.one_body import (
    BY_THE_RATIO,
    as_described,
    at_the_motor,
    has_ratios_alone,
    is_one_body,
    with_motor_motion,
)
from sim.investigation.next_measurement.advice import in_words, simulated_advice
from sim.investigation.report.maintenance_actions import action
from sim.investigation.report.wording import next_measurement, numbers_of
from sim.investigation.results import REPORTED, Finding, Investigation
from sim.investigation.search.search import Selection, select
from sim.investigation.unexplained import Unexplained, rounded

VERSION = "1"
Progress = Callable[[str, float], None]


def investigate(
    axis: Axis,
    telemetry: Telemetry | None,
    sound: Recording | Sequence[Recording] | None = None,
    progress: Progress = lambda stage, share: None,
    sound_offset_s: float = 0.0,
    as_new: Sequence[Recording] = (),
    known_doubts: Array | None = None,
    gear: float = 1.0,
) -> Investigation:
    """Hold measured data of an axis against its description.

    Several recordings of the same axis can be given without telemetry; their evidence is taken together. `as_new` are
    recordings of the same motion from when the axis was in good order: sound without telemetry is compared with them.
    `known_doubts`: ways in which `known_torque_nm` may be wrong as a whole, each by a standard deviation [N m], shape
    (rows, p). `gear`: of an axis that is described as one body at its motor, turns of it per turn of the load. Gears of
    which nothing but the ratio is described, and whose output is not seen, are rigid.

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
    if "motor_torque_nm" not in telemetry:
        return _encoders_alone(axis, telemetry, sounds, sound_offset_s, progress)
    moved = with_motor_motion(axis, telemetry)
    if moved is not telemetry:
        one = investigate(axis, moved, sounds, progress, sound_offset_s, as_new, known_doubts, gear)
        return replace(one, remarks=(BY_THE_RATIO, *one.remarks))
    if is_one_body(axis, telemetry) and has_ratios_alone(axis):
        one = _of_torque(axis, _at_motor(axis, telemetry), telemetry, sounds, sound_offset_s, progress)
        return replace(one, extended=as_described(axis, one.extended))
    data_check = examine(axis, telemetry, known_doubts, gear)
    return _of_torque(axis, data_check, telemetry, sounds, sound_offset_s, progress)


def _at_motor(axis: Axis, telemetry: Telemetry) -> DataCheck:
    """The channels of rigid gears, and the axis as one body."""
    channels = dict(telemetry.channels)
    if "known_torque_nm" in channels:
        channels["known_torque_nm"] = channels["known_torque_nm"] / axis.ratio
    return examine(at_the_motor(axis, axis.load.inertia_kg_m2), replace(telemetry, channels=channels), gear=axis.ratio)


def _of_torque(
    described: Axis,
    data_check: DataCheck,
    telemetry: Telemetry,
    sounds: tuple[Recording, ...],
    sound_offset_s: float,
    progress: Progress,
) -> Investigation:
    """Hold what was checked against the model of its description."""
    axis, recorded = data_check.axis, excitation_of(data_check.measurement)
    progress("calibration of the description", 0.08)
    problem, base = calibrate(
        Problem(axis, data_check.measurement, _first_noise(data_check), unknown=data_check.unknown)
    )
    weighed = drop_unidentifiable(select(problem, base, progress))
    progress("sound", 0.78)
    heard, left_of_sound = (
        sound_with_telemetry(described, sounds[0], data_check.measurement, sound_offset_s) if sounds else ((), None)
    )
    strange = mismatch(sounds[0], data_check.measurement, sound_offset_s) if sounds else ()
    progress("gain on data not used for the fit", 0.85)
    selection, places, rest = _finally_fitted(weighed)
    rest += [left_of_sound] if left_of_sound else []
    progress("residual", 0.92)
    problem, fit = selection.problem, selection.fit
    findings = discount_if_residual(
        _found(data_check, selection, heard), rest, doubted=bool(data_check.measurement.doubts.size)
    )
    findings, fit = refit_reported(selection, findings)
    findings, fit, gained = predicting(selection, fit, findings)
    misfit = excess(problem, fit, gained)
    findings = under_misfit(findings, adequacy(misfit, gained, whole=False))
    findings = tuple(with_action(axis, f) for f in findings)
    doubts = misfit_remarks(fit, gained, problem.unknown)
    telling = drop_within_tolerance(findings, doubted=bool(data_check.measurement.doubts.size))
    verdict, rest = _verdict(telling, rest, places, doubted=bool(doubts) or any(misfit))
    findings = tuple(f for f in findings if f.probability > 1.0 / (1.0 + NAMES))  # as likely as before any data
    progress("next measurement", 0.96)
    told = simulated_advice(weighed, findings)
    advice = in_words(told) or next_measurement(axis, findings, rest, problem.guided)
    progress("done", 1.0)
    return Investigation(
        axis, verdict, findings, rest[0] if rest else None,
        widened(estimates(problem, fit), adequacy(misfit, gained, whole=True)), gained,
        advice, extended_axis(axis, fit, reported_terms(fit, findings)),
        _provenance(axis, telemetry, sounds, problem.measurement),
        tuple((str(r.term.key), r.gain) for r in selection.rejected[:6]),
        (
            shown_remark(axis, recorded), *data_check.remarks, *doubts, *strange,
            *description_remarks(problem, fit), *excitation_remarks(excitation_of(problem.measurement)),
            *standstill_remarks(problem), *contact_loss_remarks(problem),
        ),
        told, selection,
        weighed=weighed, data_check=data_check, sounds=sounds, sound_offset_s=sound_offset_s,
    )  # fmt: skip


def _finally_fitted(weighed: Selection) -> tuple[Selection, list[Unexplained], list[Unexplained]]:
    """The selection with both fits at their ends; where the residual has structure, and what of it is left."""
    problem, fit, base = weighed.problem, weighed.fit, weighed.base
    base = problem.fit((), base.values, held=base.sensitivities) if fit.terms else fit
    places = structure_of(problem, fit)
    rest = [nameless(weighed, term) for term in weighed.nameless] + left(places, fit)
    _, base = final_fit(problem, base)
    problem, fit = final_fit(problem, fit)
    return replace(weighed, problem=problem, base=base, fit=fit), places, rest


def _found(data_check: DataCheck, selection: Selection, heard: Sequence[AcousticFinding]) -> tuple[Finding, ...]:
    """Of the motion, of the channels and of the sound; what is heard of the same cause is no finding of its own."""
    found = selection.found
    named = [term.mechanism for term in found] + [fault.mechanism for fault in data_check.faults]
    return (
        *(finding_of(selection, term) for term in found),
        *(finding_of_fault(fault) for fault in data_check.faults),
        *(finding_of_sound(h) for h in not_named_yet(named, heard, selection.problem.guided)),
    )


def _verdict(
    findings: Sequence[Finding], rest: list[Unexplained], places: list[Unexplained], *, doubted: bool
) -> tuple[str, list[Unexplained]]:
    """The verdict, and what is left: where no name is more likely than not something is there all the same, and a model
    that does not hold is not complete."""
    if any(f.probability >= REPORTED for f in findings):
        return "named", rest
    if findings or doubted:
        rest = rest or places[:1]
    return "unnamed" if rest else "nothing_missing", rest


def _first_noise(data_check: DataCheck) -> Noise:
    """Weights before anything is known: what of the torque is too fast for the motion, and the load's share of it."""
    m = data_check.measurement
    fast = float(np.std(np.diff(m.torque))) / math.sqrt(2.0) + 1e-3 * float(np.std(m.torque))
    return Noise.flat(3.0 * fast, 50.0 * fast)


def _sound_alone(
    axis: Axis, sounds: Sequence[Recording], as_new: Sequence[Recording], progress: Progress
) -> Investigation:
    progress("sound", 0.2)
    check_as_new((sound.sha256 for sound in sounds), (sound.sha256 for sound in as_new))
    listened = sound_alone(axis, sounds, as_new)
    findings = tuple(with_action(axis, finding_of_sound(h)) for h in listened.heard)
    progress("done", 1.0)
    return Investigation(
        axis, "named" if findings else "unnamed" if listened.left else "nothing_missing", findings, listened.left,
        (), (), listened.next_measurement, axis,
        {**_provenance(axis, None, sounds, None), **_compared(as_new)}, remarks=listened.remarks, acoustic=listened,
        sounds=tuple(sounds),
    )  # fmt: skip


def _encoders_alone(
    axis: Axis, telemetry: Telemetry, sounds: Sequence[Recording], sound_offset_s: float, progress: Progress
) -> Investigation:
    """Without torque no model is fitted: what motor and load differ by is looked at, and what is heard."""
    seen = encoders_alone(axis, telemetry)
    progress("sound", 0.78)
    heard, left_of_sound = (
        sound_with_telemetry(axis, sounds[0], seen.measurement, sound_offset_s) if sounds else ((), None)
    )
    strange = mismatch(sounds[0], seen.measurement, sound_offset_s) if sounds else ()
    named = {f.mechanism for f in seen.findings}
    findings = (*seen.findings, *(finding_of_sound(h) for h in heard if h.mechanism not in named))
    rest = seen.unexplained or left_of_sound
    verdict = "nothing_missing" if rest is None else "unnamed"
    verdict = "named" if any(f.probability >= REPORTED for f in findings) else verdict
    progress("done", 1.0)
    return Investigation(
        axis, verdict, tuple(with_action(axis, f) for f in findings), rest, (), seen.gain, NEXT, seen.extended,
        _provenance(axis, telemetry, sounds, seen.measurement), remarks=(*seen.remarks, *strange),
        encoders=seen.panels, sounds=tuple(sounds), sound_offset_s=sound_offset_s,
    )  # fmt: skip


def _compared(as_new: Sequence[Recording]) -> dict[str, object]:
    return {"as_new_sha256": "+".join(one.sha256 for one in as_new)} if as_new else {}


def with_action(axis: Axis, finding: Finding) -> Finding:
    """With what to do now about it."""
    f = finding
    return replace(f, action=action(axis, f.mechanism, f.location, numbers_of(f), f.probability))


def telemetry_sha256(telemetries: Iterable[Telemetry]) -> str:
    """Of all channels, by name."""
    digest = hashlib.sha256()
    for telemetry in telemetries:
        for name in sorted(telemetry.channels):
            digest.update(name.encode() + telemetry.channels[name].tobytes())
    return digest.hexdigest()


def _provenance(
    axis: Axis, telemetry: Telemetry | None, sounds: Sequence[Recording], measurement: Measurement | None
) -> dict[str, object]:
    return {
        "gearcase": version("gearcase"),
        "method": f"guided chain {VERSION}",
        "axis": axis.name,
        "telemetry_sha256": None if telemetry is None else telemetry_sha256([telemetry]),
        "sound_sha256": "+".join(sound.sha256 for sound in sounds) or None,
        "rows": 0 if measurement is None else measurement.samples,
        "rate_hz": 0.0 if measurement is None else rounded(measurement.rate_hz),
    }
