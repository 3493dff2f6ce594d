"""The state of a gearbox in the words of whoever runs the shift."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Literal
from zoneinfo import ZoneInfo

from markupsafe import Markup

from app.report.formatting import in_series, name_of, person, shape, term
from app.report.words import (
    ALIKE,
    CHECKS,
    GO_ON,
    REPAIR,
    SOON,
    checks_of,
    in_short,
    is_compared,
    one_of,
    sure_words,
    verdict_of,
)
from casebase.gearbox_state import NamedFault, Reason, Standing, State
from casebase.gearboxes import GearboxRecording
from casebase.reasoning.trend import CREST_FACTOR, RECORDINGS_PER_FALSE_ALARM, Trend

SHAPES = {"fault confirmed": "notch", State.FAULT_LIKELY: "notch", State.WATCH: "play", State.GOOD: "normal"}
"""The label whose shape and colour a state shares; the others have those of what is unknown."""
RISEN = {
    "notch_bump": ("impacts in one direction of the motion have", "notch"),
    "play_bump": ("impacts at the reversal of the motion have", "play"),
    "strongest_impulse": ("the strongest impact of a cycle has", None),
    CREST_FACTOR: ("the crest factor below 200 Hz has", None),
}
"""What is said to have grown, by the beginning of a feature's name, and the fault that it would be a sign of."""
RECORD = "Record it, in its usual motion and with its usual payload, and diagnose the recording."
REJECT = "Reject that diagnosis if nothing is found, or note the repair or the exchange."
NEITHER = "If it was neither, record it again soon, and have it inspected if it sounds the same."
ONE_STEP = {
    Reason.NOT_DIAGNOSED: "Diagnose its newest recording.",
    Reason.LABELLED: RECORD,
    Reason.SILENT: f"Record it today, {ALIKE}.",
}
SAME_WORDS = {
    Reason.UNDECIDED: "The newest recording fits more than one kind, so nothing is sure enough.",
    Reason.UNLIKE: "The newest recording sounds like no known case, good or faulty: a fault that the library does not "
    "know, or a disturbance.",
    Reason.UNUSABLE: "Its recordings are too poor to be compared.",
    Reason.NOT_DIAGNOSED: "It was recorded, and no recording was diagnosed yet.",
}
"""Why a gearbox is in its state, where that needs no more than its reason."""
Counted = State | Literal["fault confirmed"]
Document = Mapping[str, Any]


def state_of(standing: Standing | None) -> Counted:
    """Return the state as gearboxes are counted by it: a fault that was confirmed by itself."""
    if standing and standing.state is State.FAULT_LIKELY and standing.reason is Reason.FOUND:
        return "fault confirmed"
    return standing.state if standing else State.CANNOT_SAY


def state_badge(standing: Standing | None, now: datetime) -> Markup:
    """Write a state with its shape, so that colour never speaks alone."""
    state = state_of(standing)
    name, words = SHAPES.get(state, "other"), term(state, "gearboxes")
    if standing and state is State.NOT_HEARD and standing.since is not None:
        words += f" for {(now - standing.since).days} days"
    return Markup('<span class="label {}">{}{}</span>').format(name, shape(name), words)


def risen(trend: Trend) -> tuple[str, str | None]:
    """Return what has risen most clearly, and the fault that it would be a sign of."""
    name = trend.leading.name
    return next(told for beginning, told in RISEN.items() if name.startswith(beginning))


def why(standing: Standing | None, zone: str, document: Document | None = None) -> str:
    """Say shortly why a gearbox is in its state.

    Args:
        document: the diagnosis of the recording that shows it.
    """
    if standing is None or standing.last is None:
        put_in = None if standing is None else standing.since
        return f"New since {day(put_in, zone)}, and not recorded yet." if put_in else "Nothing was recorded yet."
    name = name_of(standing.recording.label if standing.recording else None)
    on, others = day(standing.since, zone), _others(standing, zone)
    match standing.reason:
        case Reason.NAMED | Reason.UNDECIDED | Reason.UNLIKE if document and _is_open(document):
            return f"{in_short(document)} {others}".strip()
        case Reason.NAMED:
            return f"The newest recording sounds like {name}. {sure_words(document)}{others}".strip()
        case Reason.FOUND if standing.recording is not None:
            one = standing.recording
            known = f"{name[:1].upper()}{name[1:]}"
            return f"{known}: confirmed by {person(one.by)} on {day(one.judged_at, zone)}. {others}".strip()
        case Reason.LABELLED:
            unknown = "" if standing.since else ", and it is not known when they were made"
            said = f"Its recordings are labelled {in_series(map(name_of, standing.labels))}{unknown}"
            return f"{said}: they do not tell its state of today."
        case Reason.CHANGED if standing.trend is not None:
            grown, fault = risen(standing.trend)
            sign = f", as with {name_of(fault)}" if fault else ""
            return f"Its sound has changed: {grown} grown since about {on}{sign}. No fault is certain yet."
        case Reason.AT_ONCE:
            return f"Its sound changed at once about {on}. Was the gearbox exchanged, or the microphone moved?"
        case Reason.NAMED_BEFORE:
            also = " Its sound has changed, too." if standing.state is State.FAULT_LIKELY else ""
            return f"{named_words(standing.fault, zone)} A worn gear does not heal.{also}" if standing.fault else ""
        case Reason.SILENT:
            return f"Its last recording is of {on}: nothing is known of it since."
        case reason if reason in SAME_WORDS:
            return SAME_WORDS[reason]
        case _:
            outweighed = named_words(standing.fault, zone) if standing.fault else ""
            trend = ", and its trend shows no change" if standing.trend else ""
            good = f"The newest recording sounds like a good gearbox{trend}."
            return f"{good} {sure_words(document)}{outweighed}".strip()


def _others(standing: Standing, zone: str) -> str:
    """Say which other faults were named before the one that the newest recording shows."""
    fault, newest = standing.fault, standing.recording
    others = [one for one in fault.named if newest and one.label != newest.label] if fault else []
    return f"{_named(others, zone)}, too." if others else ""


def _is_open(document: Document) -> bool:
    """Whether a diagnosis that names nothing has more to say than that its sound is like no known one."""
    return document["verdict"] == "ambiguous" or not (document["verdict"] == "diagnosed" or is_compared(document))


def named_words(fault: NamedFault, zone: str) -> str:
    """Say which fault was named when, and how many recordings have sounded good since."""
    good = f"{fault.good or 'no'} recording{'s' if fault.good > 1 else ''}"
    have = "have" if fault.good > 1 else "has"
    return f"{_named(fault.named, zone)}; {good} since then {have} sounded good."


def _named(recordings: Sequence[GearboxRecording], zone: str) -> str:
    """Say when each fault was named, and by how many recordings."""
    by_name: dict[str, list[GearboxRecording]] = {}
    for one in recordings:
        by_name.setdefault(one_of(one.left) if one.left else name_of(one.label), []).append(one)
    told = []
    for name, those in by_name.items():
        on = day(those[0].at if those[0].timed else None, zone)
        told.append(f"{name} was named {f'in {len(those)} recordings since' if len(those) > 1 else 'on'} {on}")
    words = in_series(told)
    return f"{words[:1].upper()}{words[1:]}"


def earlier_words(fault: NamedFault, zone: str) -> str:
    """Say beside an answer that names no fault that one was named of this gearbox before."""
    return (
        f"Before this recording: {named_words(fault, zone)} A worn gear does not heal, and no repair was noted: one "
        "recording does not clear the gearbox."
    )


def steps_after(fault: NamedFault) -> tuple[str, ...]:
    """Say what to do where a fault was named before, and the newest recording names none."""
    wanted = 0 if fault.found else max(fault.still_asked_for, 0)
    good = f"Record it again: after {wanted} more that sound{'s' if wanted == 1 else ''} good it counts as good."
    faults = dict.fromkeys(checks_of(None, one.label or "")[0] for one in reversed(fault.named))
    return (*faults, *((good,) if wanted else ()), REJECT, REPAIR if fault.found else GO_ON)


def next_steps(standing: Standing | None, document: Document | None = None) -> tuple[str, ...]:
    """Say what is to be done now, in order, with its time and place as far as the diagnosis that shows it has them."""
    if standing is None or standing.last is None:
        return (RECORD,)
    label = (standing.recording.label if standing.recording else None) or ""
    match standing.reason:
        case Reason.NAMED | Reason.UNDECIDED | Reason.UNLIKE | Reason.UNUSABLE if (
            document and document["verdict"] != "diagnosed"
        ):
            return verdict_of(document).checks
        case Reason.NAMED:
            return checks_of(document, label)
        case Reason.FOUND:
            return (REPAIR, *checks_of(document, label)[:-1])
        case Reason.CHANGED if standing.trend is not None:
            sign = risen(standing.trend)[1] or ""
            return (SOON, checks_of(document, sign)[0] if sign else "Have it inspected if it keeps on rising.")
        case Reason.AT_ONCE:
            return ("Say on its page what happened: an exchange, or a moved microphone.", NEITHER)
        case Reason.NAMED_BEFORE if standing.fault is not None:
            return (*checks_of(document, label)[:1], *steps_after(standing.fault)[1:])
        case Reason.SOUNDS_GOOD:
            return CHECKS["normal"]
        case reason:
            return (ONE_STEP.get(reason, SOON),)


def trend_words(trend: Trend | None, zone: str) -> str:
    """Say whether its sound has changed, and since when."""
    if trend is None:
        return "A trend needs two recordings of known time that name the gearbox and can be compared."
    if trend.at_once is not None:
        return (
            f"Its sound changed at once about {day(trend.at_once.at, zone)}: part grew louder, part quieter, as "
            "with another gearbox or with the microphone at another place. A fault changes it bit by bit."
        )
    if trend.changed:
        began = f"Its sound began to change about {day(trend.began.at, zone)}: {risen(trend)[0]} grown."
        return (
            f"{began} In good gearboxes this is seen once in {RECORDINGS_PER_FALSE_ALARM:,} recordings, or less often."
        )
    return f"No change is certain over its {len(trend.recordings)} recordings."


def evidence_words(trend: Trend) -> str:
    """Say how far the evidence for a change is, and what that means."""
    of = f"Evidence for a change: {trend.evidence:,.0f}. From {RECORDINGS_PER_FALSE_ALARM:,} on it counts as one"
    promise = f"a good gearbox gets there once in {RECORDINGS_PER_FALSE_ALARM:,} recordings, or less often."
    at_once = f"For a change of all its sound at once it is {trend.colour_evidence:,.0f}, with the same promise."
    return (
        f"{of}: {promise} With no change it is {len(trend.recordings)} on average, the number of recordings. {at_once}"
    )


def day(at: datetime | None, zone: str) -> str:
    """Write a day at the site.

    >>> from datetime import UTC
    >>> day(datetime(2026, 11, 9, 23, 30, tzinfo=UTC), "Europe/Stockholm")
    '2026-11-10'
    """
    return "an unknown day" if at is None else f"{at.astimezone(ZoneInfo(zone)):%Y-%m-%d}"
