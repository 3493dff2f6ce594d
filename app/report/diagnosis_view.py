"""Everything the page and the report of one diagnosis show, gathered once."""

import base64
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from markupsafe import Markup
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.report import charts as draw
from app.report.charts import chart_of
from app.report.disturbed import flags_of, left_out_words, marked
from app.report.formatting import ENVIRONMENT, instant, name_of, percent, quantity, sentence, style_sheet
from app.report.recorded import (
    decoded,
    event_times,
    features_of,
    order_markers,
    read_together,
    spectrogram_png,
    strongest_events,
    surveyed,
)
from app.report.standing_words import earlier_words, steps_after
from app.report.words import (
    certainty,
    fault_words,
    judged,
    not_compared,
    not_excluded,
    remarks_beside,
    sides_of,
    size_of,
    unlikeness,
    value_of,
    verdict_of,
)
from app.service import Service
from casebase.axes import find_axis
from casebase.gearbox_state import NamedFault, fault_before
from casebase.gearboxes import History
from casebase.labels import BASELINES
from casebase.reasoning.trend import Trend, trend_of
from casebase.store.models import Case, StoredDiagnosis, StoredRecording
from signals.crest import root_mean_square
from signals.features import catalogue, feature_words
from signals.recording_quality.disturbances import Survey
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import LABELS
from sim.investigation.report.box import as_new_of, as_new_words
from sim.mechanisms import MECHANISMS

PEAKS = 1600
SHOWN_PARTS = 8

PLOTS = (
    ("crest_factor", "crest"),
    ("kurtosis_low", "crest"),
    ("rms", "level"),
    ("peak", "level"),
    ("band_level", "spectrum"),
    ("mesh", "spectrum"),
    ("modulation", "spectrogram"),
    ("spectral_kurtosis", "spectrogram"),
    ("motion_period", "waveform"),
    ("repetition", "waveform"),
    ("impulse_rate", "waveform"),
    ("strongest_impulse", "waveform"),
    ("", "fold"),
)
"""Where a quantity can be seen, by the beginning of its name; impacts and phases in the average stroke."""
TITLES = {
    "crest": "Crest factor",
    "level": "RMS and peak",
    "spectrum": "Spectrum",
    "spectrogram": "Spectrogram",
    "waveform": "Waveform",
    "fold": "Average stroke of the motion",
}


def view_of(session: Session, service: Service, row: StoredDiagnosis, *, orders: bool = False) -> dict[str, Any]:
    """Return what the page and the report of a diagnosis show; charts and sound are absent where it was erased."""
    document: Mapping[str, Any] = row.document
    sound = None if row.recording.erased_at is not None else decoded(service, row.recording)
    found = None if sound is None else surveyed(sound, row.recording)
    usable, at = document["verdict"] != "unusable", row.recording.recorded_at or row.recording.created_at
    drawn, polar, peaks = (SimpleNamespace(), None, ()) if found is None else _drawn(session, row, found, orders)
    history, trend = history_of(session, service, row.recording)
    flags = flags_of(document["quality"], row.recording.duration_s)
    as_new = as_new_of_label(session, row.recording.axis, row.label, document["severity"])
    stored_rms = features_of(session, row.recording.id).get("rms") or 0.0
    shown = {name for name, chart in vars(drawn).items() if chart is not None}
    fault, verdict = earlier_fault(row, history), judged(verdict_of(document), row)
    label = None if row.state == "rejected" else row.revised_label or row.label
    if fault is not None and verdict.label in BASELINES:
        headline = f"{verdict.headline} in this recording: it does not clear the gearbox"
        verdict = replace(verdict, headline=headline, label=None, checks=steps_after(fault))
    return {
        "diagnosis": row,
        "recording": row.recording,
        "verdict": verdict,
        "facts": [*facts_of(document, as_new), *([analysed(found)] if found and usable else ())],
        "quality": [flag for flag in flags if not flag.only_left_out],
        "left_out": left_out_words(flags),
        "marked": marked(found) if found else "",
        "usable": usable,
        "audible": sound is not None and usable,
        "neighbours": _neighbours(session, document["neighbours"]),
        "evidence": evidence_of(document, shown, strongest_events(session, row.recording)),
        "remarks": [sentence(remark) for remark in remarks_beside(document)],
        "charts": drawn,
        "marks": {
            "knock": event_times(session, row.recording, label) if label not in (None, *BASELINES) else (),
            "reversal": [] if found is None else [marker.x for marker in draw.reversals(found)],
        },
        "polar": polar,
        "phase": phase_of(document),
        "trend": chart_of(trend, history, row.label, (at, "this recording")) if trend and history else None,
        "earlier": "" if fault is None else earlier_words(fault, service.settings.time_zone),
        "rms": stored_rms if sound is None else root_mean_square(sound.samples),
        "peaks": "[" + ",".join(f"{v:.4g}" for v in peaks) + "]",
        "outside": None if not_compared(document) else unlikeness(document) or None,
        "provenance": [(k.replace("_", " "), v) for k, v in document["provenance"].items()],
    }


def _drawn(
    session: Session, row: StoredDiagnosis, found: Survey, orders: bool
) -> tuple[SimpleNamespace, Markup | None, Sequence[float]]:
    """Return the charts, the polar plot, and the outline of the waveform."""
    sound, analysis = found.recording, found.analysis
    speed = row.recording.speed_rad_s
    order_hz = speed / (2 * math.pi) if orders and speed else None
    folded = draw.fold_charts(analysis, phase_of(row.document))
    drawn = SimpleNamespace(
        waveform=draw.waveform(found, event_times(session, row.recording)),
        spectrum=draw.spectrum(sound, order_markers(analysis), order_hz),
        crest=draw.crest_trace(found),
        level=draw.level_trace(sound),
        fold=folded[0] if folded else None,
    )
    peaks = draw.envelope(sound.samples, sound.sample_rate_hz, PEAKS).y
    return drawn, folded[1] if folded else None, peaks.tolist()


def as_new_of_label(session: Session, axis: str | None, label: str | None, severity: Mapping[str, Any] | None) -> str:
    """Return the size that the fault of a label has at most as new; empty where it is not known, or of which gear.

    Args:
        severity: the size that was found, beside which it stands.
    """
    described, mechanism = find_axis(session, axis) if axis else None, LABELS.get(label or "")
    known = None if described is None else read_axis(described.document)
    if severity is None or known is None or mechanism is None or len(known.stages) != 1:
        return ""
    return as_new_of(known, mechanism, known.stages[0].name, MECHANISMS[mechanism].size, severity["value"])


def facts_of(document: Mapping[str, Any], as_new: str = "") -> list[tuple[str, object, str]]:
    """Return the few numbers beside the verdict: name, value, note.

    Args:
        as_new: the size that the fault has at most as new; empty where it is not known.
    """
    found: list[tuple[str, object, str]] = []
    fault, sure, left, size = fault_words(document), certainty(document), not_excluded(document), size_of(document)
    if fault:
        found.append(("A fault", *fault))
    if sure:
        of = f"of {name_of(document['label'])}, " if document["verdict"] == "ambiguous" else ""
        found.append(("How sure", sure[0], f"{of}{sure[1]}"))
    if left:
        found.append(("Cannot be excluded", left, "the right label is one of these nine times in ten"))
    if size:
        name, value, interval, cases = size
        allowed = f"; {as_new_words(as_new)}" if as_new else ""
        found.append((name, value, f"90 % interval {interval}, from {cases} cases of known size{allowed}"))
    phase_deg = phase_of(document)
    if phase_deg is not None:
        found.append(_in_the_cycle(phase_deg, value_of(document, "motion_period")))
    return found


def phase_of(document: Mapping[str, Any]) -> float | None:
    """Return when in the cycle of the motion the named fault comes, as a phase [°] from a reversal."""
    return value_of(document, f"{document['label']}_phase")


def _in_the_cycle(phase_deg: float, period_s: float | None) -> tuple[str, object, str]:
    r"""Return when in the motion's cycle something repeats: its time, and its phase, which is no angle of a gear.

    >>> name, value, note = _in_the_cycle(90.0, 2.0)
    >>> print(name, value, note)
    Time in the cycle 0.5\xa0s after the first reversal; phase 90° of a cycle of 2.00\xa0s
    """
    if period_s is None:
        return "Phase in the cycle", quantity(phase_deg, "°"), "of the motion, after the first reversal"
    note = Markup("after the first reversal; phase {} of a cycle of {}").format(
        quantity(phase_deg, "°"), f"{period_s:.2f}\N{NO-BREAK SPACE}s"
    )
    return "Time in the cycle", quantity(phase_deg / 360.0 * period_s, "s"), note


def analysed(found: Survey) -> tuple[str, object, str]:
    """Return which piece of a recording was analysed, and how many cycles of the motion are left of it."""
    machine, analysis = found.segments.machine, found.analysis
    period_s = analysis.motion.period_s
    left_s = analysis.duration_s - sum(span.duration_s for span in analysis.left_out)
    cycles = f"{left_s / period_s:.1f} cycles of the motion" if period_s else "no cycle of a motion is heard"
    return "Analysed", f"{machine.start_s:.1f} to {machine.end_s:.1f} s", cycles


def _neighbours(session: Session, entries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the nearest cases; contributions are (feature, part of the distance, share of it), largest first."""
    ids = [entry["case_id"] for entry in entries]
    cases = {case.id: case for case in session.scalars(select(Case).where(Case.id.in_(ids)))} if ids else {}
    read_together(session, [case.recording_id for case in cases.values()])
    found = []
    for entry in entries:
        case = cases.get(entry["case_id"])
        parts = sorted(entry["contributions"].items(), key=lambda item: -item[1])
        total = entry["distance"] or 1.0
        found.append(
            {
                **entry,
                "gearbox": case.recording.gearbox if case else None,
                "recording_id": case.recording_id if case else None,
                "rms": (features_of(session, case.recording_id).get("rms") if case else None) or 0.0,
                "contributions": [(name, part, part / total) for name, part in _largest(parts)],
            }
        )
    return found


def _largest(parts: Sequence[tuple[str, float]]) -> list[tuple[str, float]]:
    """Keep the largest parts and add up the others, so that all still make the distance."""
    rest = sum(part for _, part in parts[SHOWN_PARTS:])
    others = [(f"{len(parts) - SHOWN_PARTS} others together", rest)] if len(parts) > SHOWN_PARTS else []
    return [*parts[:SHOWN_PARTS], *others]


def history_of(session: Session, service: Service, recording: StoredRecording) -> tuple[History | None, Trend | None]:
    """Return the gearbox that a recording is of, with its trend; None where it does not say of which."""
    if recording.axis is None or recording.gearbox is None:
        return None, None
    known = service.fleet.place(session, recording.axis, recording.gearbox)
    found = known.histories if known else ()
    history = next((each for each in found if any(one.recording_id == recording.id for one in each.heard)), None)
    if history is None or known is None:
        return None, None
    return history, known.trend if history is known.in_service else trend_of(session, history)


def earlier_fault(row: StoredDiagnosis, history: History | None) -> NamedFault | None:
    """Return the fault that was named of the gearbox before; None where none stood, or this diagnosis names one."""
    if history is None or (row.verdict == "diagnosed" and row.label not in BASELINES):
        return None
    return fault_before(history, next(one for one in history.heard if one.recording_id == row.recording.id))


def evidence_of(
    document: Mapping[str, Any], drawn: Collection[str], strongest: Mapping[str, float]
) -> dict[str, list[dict[str, Any]]]:
    """Return the evidence of a diagnosis: features that were compared, and what was heard, each with its plot.

    Args:
        drawn: names of the plots on the page; only these (and the spectrogram) are led to.
        strongest: when the strongest event of each kind happens [s].
    """
    compared, seen = [], []
    for item in document["evidence"]:
        if item["kind"] == "feature" and percent(item["share"]) == percent(0):
            continue
        name, unit = item["quantity"], item["unit"]
        plot = next(plot for beginning, plot in PLOTS if name.startswith(beginning))
        led = plot in drawn or (plot == "spectrogram" and drawn)
        place = {"plot": plot if led else None, "title": TITLES[plot]}
        if item["kind"] == "feature":
            known = catalogue().get(name)
            compared.append(
                {
                    "name": feature_words(name),
                    "physics": known.physics if known else "",
                    "here": quantity(item["value"], unit),
                    "sides": list(sides_of(item)),
                    "share": percent(item["share"]),
                    **place,
                }
            )
        else:
            at_s = strongest.get(name.removesuffix("_phase"))
            seen.append({"sentence": sentence(item["statement"]), "at_s": at_s, **place})
    return {"compared": compared, "seen": seen}


def diagnosis_html(session: Session, service: Service, row: StoredDiagnosis) -> str:
    """Return the report as one HTML file: no script, no address, plots as SVG."""
    image = b"" if row.recording.erased_at is not None else spectrogram_png(service, row.recording)
    context = {
        **view_of(session, service, row),
        "style": style_sheet(),
        "at": lambda value: instant(value, service.settings.time_zone),
        "spectrogram": base64.b64encode(image).decode(),
    }
    return ENVIRONMENT.get_template("report.html").render(context)
