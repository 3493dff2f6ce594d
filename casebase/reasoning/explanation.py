"""Why: the features that speak for a verdict, each with its unit, beside the nearest cases of this and that class."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from casebase.reasoning.detection_limit import WORTH_SAYING_DB
from casebase.reasoning.novelty import Likeness
from casebase.search.case_table import CaseTable
from casebase.search.retrieval import Match
from signals.features import EventKind, Extraction, MotionSource, catalogue, feature_words

MOST = 5
SOURCES = {
    MotionSource.GIVEN: "as given with the recording",
    MotionSource.SOUND: "as found in the sound",
    MotionSource.NONE: "from nowhere",
}


@dataclass(frozen=True)
class Evidence:
    """One observation and what it is held against.

    Args:
        kind: feature, event, motion or library.
        statement: the whole in one sentence.
        quantity: name of the feature, or what was measured.
        value: as measured [unit]; None where the statement has no number.
        same, other: case id and value of the nearest case of the class said and of the nearest of another class.
        share: how much of the distance to the other class this explains, from 0 to 1.
    """

    kind: str
    statement: str
    quantity: str
    value: float | None = None
    unit: str = "1"
    same: Mapping[str, object] | None = None
    other: Mapping[str, object] | None = None
    share: float | None = None

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        return {
            "kind": self.kind,
            "statement": self.statement,
            "quantity": self.quantity,
            "value": self.value,
            "unit": self.unit,
            "same": None if self.same is None else dict(self.same),
            "other": None if self.other is None else dict(self.other),
            "share": self.share,
        }


def feature_evidence(
    table: CaseTable, values: NDArray[np.floating], same: Match | None, other: Match | None
) -> tuple[Evidence, ...]:
    """Return the features in which the recording is nearer to one case than to another, strongest first.

    Args:
        values: features of the recording, shape (n,).
    """
    if other is None:
        return ()
    near = np.zeros(len(table.names)) if same is None else np.array(list(same.contributions.values()))
    far = np.array(list(other.contributions.values()))
    gain = far - near
    order = [index for index in np.argsort(-gain, kind="stable")[:MOST] if gain[index] > 0]
    return tuple(
        _feature(table, values, int(index), same, other, float(gain[index] / other.distance)) for index in order
    )


def _feature(
    table: CaseTable,
    values: NDArray[np.floating],
    index: int,
    same: Match | None,
    other: Match,
    share: float,
) -> Evidence:
    name = table.names[index]
    known = catalogue().get(name)
    unit = known.unit if known else "1"
    parts = [f"{feature_words(name)}: {_number(values[index], unit)}"]
    for match in (same, other):
        if match is not None:
            value = table.values[match.row, index]
            parts.append(f"{_number(value, unit)} in the nearest {match.label} case ({match.origin})")
    sentence = ", ".join(parts[:1]) + "; " + " and ".join(parts[1:])
    if known:
        sentence += f". {known.physics}"
    return Evidence(
        kind="feature",
        statement=sentence,
        quantity=name,
        value=_finite(values[index]),
        unit=unit,
        same=None if same is None else _side(table, same, index),
        other=_side(table, other, index),
        share=min(max(share, 0.0), 1.0),
    )


def _side(table: CaseTable, match: Match, index: int) -> dict[str, object]:
    return {
        "case_id": match.case_id,
        "label": match.label,
        "origin": match.origin,
        "value": _finite(table.values[match.row, index]),
    }


def novelty_evidence(
    names: tuple[str, ...], values: NDArray[np.floating], label: str, likeness: Likeness
) -> tuple[Evidence, ...]:
    """Return the features in which a recording departs most from the cases of its nearest label, strongest first."""
    departures = likeness.departures(values)
    size = np.nan_to_num(np.abs(departures))
    order = [int(index) for index in np.argsort(-size, kind="stable")[:MOST] if size[index] > 1]
    return tuple(
        _outside(
            names[index],
            float(values[index]),
            likeness.usual(index),
            label,
            size[index] ** 2 / float(size @ size),
        )
        for index in order
    )


def _outside(name: str, value: float, span: tuple[float, float], nearest: str, share: float) -> Evidence:
    known = catalogue().get(name)
    unit = known.unit if known else "1"
    sentence = (
        f"{feature_words(name)}: {_number(value, unit)}; cases of {nearest}, the nearest label, have "
        f"{_number(span[0], unit)} to {_number(span[1], unit)}"
    )
    if known:
        sentence += f". {known.physics}"
    range_document = {"label": nearest, "low": _finite(span[0]), "high": _finite(span[1])}
    return Evidence("feature", sentence, name, _finite(value), unit, other=range_document, share=float(share))


def motion_evidence(extraction: Extraction) -> tuple[Evidence, ...]:
    """Return what the motion is and where in it the marked events lie, in seconds, hertz and degrees."""
    motion = extraction.motion
    if motion.period_s is None:
        return ()
    frequency = 1 / motion.period_s
    found = [
        Evidence(
            "motion",
            f"the motion repeats every {motion.period_s:.3f} s ({frequency:.3f} Hz), {SOURCES[motion.source]}",
            "motion_period",
            motion.period_s,
            "s",
        )
    ]
    for kind in (EventKind.NOTCH, EventKind.PLAY):
        found += _cyclic(extraction, kind, motion.period_s)
    return tuple(found)


def _cyclic(extraction: Extraction, kind: EventKind, period_s: float) -> list[Evidence]:
    """Return where in the cycle the strongest events of a kind lie."""
    events = [event for event in extraction.events if event.kind is kind and event.strength_db >= WORTH_SAYING_DB]
    if not events:
        return []
    strongest = max(events, key=lambda event: event.strength_db)
    start = next(iter(extraction.motion.reversal_times_s), 0.0)
    phase_deg = (strongest.time_s - start) / period_s * 360.0 % 360.0
    what = "an impact in each recorded cycle" if kind is EventKind.NOTCH else "an impact where the torque reverses"
    statement = (
        f"{what}, {strongest.strength_db:.1f} dB above its surroundings, at {strongest.time_s:.2f} s, "
        f"which is {phase_deg / 360.0 * period_s:.2f} s into the motion's cycle after the first reversal, a phase of "
        f"{phase_deg:.0f} degrees ({len(events)} times in all)"
    )
    return [Evidence("event", statement, f"{kind.value}_phase", phase_deg, "deg")]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _number(value: float, unit: str) -> str:
    if not np.isfinite(value):
        return "not to be had"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"
