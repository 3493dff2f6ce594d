"""What was left out of a recording or disturbs it: in words, and as stretches of its plots."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from app.report.formatting import WORDS, term
from app.report.svg import Stretch
from signals.recording_quality.disturbances import Survey, flags

SHORT_S = 1.0
"""What is shorter has a time, what is longer a beginning and an end [s]."""
RETURNING = ("handling", "wind", "foreign_sound", "second_machine")
"""What may come more than once between its beginning and its end."""
ONCE = frozenset(name.replace("_", " ") for name in ("knock", *RETURNING))
"""In words: what one cycle of the motion has and the others have not."""


@dataclass(frozen=True)
class Flag:
    """One quality flag: its name in words, when (empty: the whole recording), why, and what to do where it is poor."""

    name: str
    when: str
    severity: str
    reason: str
    remedy: str

    @property
    def only_left_out(self) -> bool:
        """Whether its name and time say all: a stretch was left out, and that changes nothing."""
        return bool(self.when) and self.severity == "note"


def flags_of(quality: Sequence[Mapping[str, Any]], duration_s: float) -> tuple[Flag, ...]:
    """Return the quality flags of a document, what weighs most first."""
    found = [
        Flag(
            term(flag["name"], "quality"),
            when(flag["start_s"], flag["end_s"], duration_s, flag["name"] in RETURNING),
            flag["severity"],
            flag["reason"],
            WORDS["remedies"].get(flag["name"], "") if flag["severity"] == "poor" else "",
        )
        for flag in quality
    ]
    return tuple(sorted(found, key=lambda flag: flag.severity == "note"))


def when(start_s: float | None, end_s: float | None, duration_s: float, returns: bool = False) -> str:
    """Return the time of something in words; empty where it is the whole recording.

    >>> when(12.0, 12.1, 20.0), when(0.0, 5.2, 20.0), when(0.0, 20.0, 20.0), when(5.7, 16.0, 20.0, True)
    ('at 12.0 s (0.1 s)', '0.0 to 5.2 s', '', 'between 5.7 and 16.0 s')
    """
    if start_s is None or end_s is None or (start_s <= 0 and end_s >= duration_s):
        return ""
    lasts_s = end_s - start_s
    if lasts_s < SHORT_S:
        return f"at {start_s:.1f} s ({lasts_s:.2g} s)"
    return f"between {start_s:.1f} and {end_s:.1f} s" if returns else f"{start_s:.1f} to {end_s:.1f} s"


def listed(found: Sequence[Flag]) -> str:
    """Return names and times in one line.

    >>> listed([Flag("knock", "at 12.0 s (0.1 s)", "note", "", ""), Flag("noise", "", "poor", "", "")])
    'knock at 12.0 s (0.1 s), noise'
    """
    return ", ".join(f"{flag.name} {flag.when}".rstrip() for flag in found)


def left_out_words(found: Sequence[Flag]) -> str:
    """Say what was left out, and of what came in some cycles only why; empty where nothing was.

    >>> left_out_words([Flag("knock", "at 12.0 s (0.1 s)", "note", "", "")])
    "Left out: knock at 12.0 s (0.1 s). What comes at no fixed time of the motion is not taken for the gear's."
    """
    left_out = [flag for flag in found if flag.only_left_out]
    if not left_out:
        return ""
    once = any(flag.name in ONCE for flag in left_out)
    why = " What comes at no fixed time of the motion is not taken for the gear's." if once else ""
    return f"Left out: {listed(left_out)}.{why}"


def stretches(surveyed: Survey) -> tuple[Stretch, ...]:
    """Return what is not the machine and what is not analysed, from the start of the recording, named where it begins.

    A disturbance that comes again and again has a name at its first time only.
    """
    segments, from_s = surveyed.segments, surveyed.start_s
    names: dict[float, list[str]] = {}
    for flag in flags(surveyed):
        if flag.start_s is not None and flag.name not in ("silence", "pause"):
            names.setdefault(round(flag.start_s, 3), []).append(term(flag.name, "quality"))
    events = () if surveyed.analysis.unrepeated is None else surveyed.analysis.unrepeated.events
    found = [
        Stretch(each.span.start_s + from_s, each.span.end_s + from_s, ", ".join(names.get(at, ())))
        for each in events
        for at in [round(each.span.start_s + from_s, 3)]
    ]
    found += [Stretch(each.start_s + from_s, each.end_s + from_s, "") for each in surveyed.lost]
    for word, spans in (
        ("silence", segments.silences),
        ("pause", segments.pauses),
        ("not analysed", segments.others),
    ):
        found += [Stretch(each.start_s, each.end_s, word) for each in spans]
    return tuple(sorted(found, key=lambda each: each.start_s))


def marked(surveyed: Survey) -> str:
    """Return in one line what `stretches` marks; empty where that is nothing."""
    found = [flag for flag in flags(surveyed) if flag.start_s is not None]
    rows = flags_of([flag.to_document() for flag in found], surveyed.recording.duration_s)
    words = listed([row for row in rows if row.when])
    lost_s = sum(span.duration_s for span in surveyed.lost)
    dropouts = f"dropouts {lost_s:.2g} s in all" if surveyed.lost else ""
    others = [f"not analysed {each.start_s:.1f} to {each.end_s:.1f} s" for each in surveyed.segments.others]
    return ", ".join(part for part in (words, dropouts, *others) if part)
