"""What a technician reads first of an investigation: what, where, how sure, and what to do first.

Made of the document alone, so that the page of a stored investigation, its report and its paper say the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sim.description.axis import Axis
from sim.investigation.report.formatting import (
    angle,
    angle_interval,
    interval,
    likely,
    named,
    number,
    percent,
    sure,
    unit_in_words,
    words_of,
)
from sim.investigation.report.maintenance_actions import action, of_the_measurement, place_of
from sim.investigation.results import REPORTED
from sim.investigation.unexplained import Unexplained, unexplained_of
from sim.mechanisms import MECHANISMS
from sim.mechanisms.catalogue import is_in_every_axis, kind_or_any
from sim.mechanisms.friction.friction_asymmetry import FrictionAsymmetry

Document = Mapping[str, Any]
FLANKS = {1.0: "the one that carries positive torque", -1.0: "the one that carries negative torque"}
KINDS = {
    "frequency": "A fixed frequency",
    "speed": "Friction that changes with the speed",
    "angle": "Torque that changes with the angle",
    "time": "Something that changes with time",
    "transmission error": "A difference between motor and load that repeats",
    "error_over_angle": "A difference of both encoders over the angle of the load, as an error of the gear or of an "
    "encoder makes,",
}
UNITS = {"_rad_s": "rad/s", "_hz": "Hz", "_s": "s"}  # by the ending of a number of what has no name
PAYLOAD, FLANGE = "payload", "the flange"
WHOLE, UNKNOWN, RECORDING = "the axis as a whole", "these data do not show where", "the recording, not the machine"


@dataclass(frozen=True)
class Size:
    """One number: its name in words, its value with unit (an angle also in degrees or minutes of arc), its interval.

    `as_new`: what a new axis has at most, by its description; empty where nothing is known of that.
    """

    name: str
    value: str
    interval: str
    as_new: str = ""

    @property
    def words(self) -> str:
        """In one line, with its interval and what is allowed as new.

        >>> Size("gap", "0.0012 rad", "0.0011 to 0.0013 rad", "0.0003 rad").words
        'Gap 0.0012 rad, 90 % interval 0.0011 to 0.0013 rad (as new at most 0.0003 rad)'
        """
        between = f", 90 % interval {self.interval}" if self.interval else ""
        new = f" ({as_new_words(self.as_new)})" if self.as_new else ""
        return f"{self.name[:1].upper()}{self.name[1:]} {self.value}{between}{new}"


@dataclass(frozen=True)
class Entry:
    """One thing that was found, or that nothing was: sentences for whoever stands at the machine."""

    title: str
    what: str
    where: str
    how_sure: str
    do_first: str
    sizes: tuple[Size, ...] = ()
    finding: int | None = None  # place in the document

    @property
    def steps(self) -> list[str]:
        """What to do first, a sentence each.

        >>> Entry("", "", "", "", "Measure first: Hold it (at rest). Then: Look at the brake.").steps
        ['Measure first: Hold it (at rest).', 'Look at the brake.']
        """
        return re.split(r"(?<=[.!?]) (?=[A-Z])", self.do_first.replace(" Then: ", " "))

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """The four answers under their headings."""
        sizes = "".join(f" {size.words}." for size in self.sizes)
        return (
            ("What", f"{self.title}. {self.what}{sizes}"),
            ("Where", self.where),
            ("How sure", self.how_sure),
            ("Do first", self.do_first),
        )


def box_of(document: Document, axis: Axis | None) -> list[Entry]:
    """What was found, the machine's faults before faults of the measurement before friction that every axis has.

    `axis`: the description; None for a robot.
    """
    findings: Sequence[Document] = document["findings"]
    order = sorted(range(len(findings)), key=lambda k: _rank(findings[k]))
    entries = [replace(_found(findings[k], axis, document["next_measurement"]), finding=k) for k in order]
    if document["verdict"] == "unnamed":
        return [_unnamed(document), *entries]
    if document["verdict"] == "nothing_missing":
        return [_nothing(document), *entries]
    return entries


def _rank(finding: Document) -> tuple[bool, bool, bool]:
    """What is only suspected comes last, and what every axis has is no fault."""
    kind = kind_or_any(finding["mechanism"])
    return finding["probability"] < REPORTED, kind.traits.in_every_axis, of_the_measurement(finding["mechanism"])


def _found(finding: Document, axis: Axis | None, next_measurement: str) -> Entry:
    mechanism, location, probability = finding["mechanism"], finding["location"], float(finding["probability"])
    numbers = {one["name"]: float(one["value"]) for one in finding["parameters"] if is_number(one["value"])}
    first = finding.get("action") or (action(axis, mechanism, location, numbers, probability) if axis else "")
    name = named(mechanism) if probability >= REPORTED else f"suspected: {named(mechanism)}"
    return Entry(
        title=f"{name[:1].upper()}{name[1:]}",
        what=f"{finding['explanation'].removesuffix(first).strip()} {_harder(finding)}{_kind(mechanism)}".strip(),
        where=_where(finding, axis, numbers),
        how_sure=_how_sure(finding),
        do_first=first or next_measurement,
        sizes=tuple(
            replace(size_of(mechanism, one), as_new=as_new_of(axis, mechanism, location, one["name"], one["value"]))
            for one in finding["parameters"]
            if is_shown(mechanism, one["name"], one.get("low"), one.get("high"))
        ),
    )


def _harder(finding: Document) -> str:
    """In which direction the axis runs harder, where all numbers that are not zero for certain agree."""
    known = [one for one in finding["parameters"] if is_number(one.get("low")) and one["low"] * one["high"] > 0.0]
    ways = {"positive" if one["low"] > 0.0 else "negative" for one in known}
    if finding["mechanism"] != FrictionAsymmetry.name or len(ways) != 1:
        return ""
    return f"The axis runs harder in the {ways.pop()} direction. "


def as_new_words(as_new: str) -> str:
    """Say what is allowed as new; nothing where that is not known."""
    return f"as new at most {as_new}" if as_new else ""


def as_new_of(
    axis: Axis | None, mechanism: str, location: str | None, parameter: str, beside: float | None = None
) -> str:
    """Return what a new axis has at most of this number of a mechanism, with its unit; empty where it is not known.

    `beside`: the number that was found; an angle is then said in the same unit.
    """
    kind = MECHANISMS.get(mechanism)
    if axis is None or kind is None or parameter != kind.size:
        return ""
    allowed = kind.as_new(axis, location)
    unit = next(one.unit for one in kind.parameters if one.name == parameter)
    if allowed <= 0:
        return ""
    if unit == "rad" and beside:
        return angle(allowed, unit_of=beside)
    return size_of(mechanism, {"name": parameter, "value": allowed, "unit": unit}).value


def _kind(mechanism: str) -> str:
    kind = kind_or_any(mechanism)
    if kind.or_of_the_machine is not None:
        return f"It is a fault of the measurement, or {kind.or_of_the_machine}."
    if of_the_measurement(mechanism):
        return "It is a fault of the measurement, not of the machine."
    if kind.traits.in_every_axis:
        return "Every axis has friction: it is a fault only if it is more than it was as new."
    return ""


def _where(finding: Document, axis: Axis | None, numbers: Mapping[str, float]) -> str:
    location, mechanism = finding["location"], finding["mechanism"]
    at = place_of(axis, location, numbers) if axis else ""
    place = _part(axis, mechanism, location)
    others = finding.get("elsewhere", ())
    beside = f"; or {' or '.join(map(str, others))}, where it explains the data as well" if others else ""
    return f"{', '.join(part for part in (place, at) if part)}{beside}"


def _part(axis: Axis | None, mechanism: str, location: str | None) -> str:
    """Which part of the machine a location is, counted from the motor."""
    if location is None:
        if of_the_measurement(mechanism):
            return RECORDING
        kind = kind_or_any(mechanism)
        return WHOLE if axis is not None and None in kind.locations(axis) else UNKNOWN
    stages = axis.stages if axis else ()
    for place, stage in enumerate(stages, start=1):
        if stage.name == location:
            teeth = (
                f"{stage.driver_teeth} : {stage.driven_teeth} teeth" if stage.driven_teeth else f"ratio {stage.ratio:g}"
            )
            return f"gear “{location}”, stage {place} of {len(stages)} from the motor ({teeth})"
    return location


def _how_sure(finding: Document) -> str:
    probability = float(finding["probability"])
    said = likely(probability, calibrated=True) if finding.get("calibrated", True) else sure(probability)
    alike = " or ".join(named(str(name)) for name in finding["indistinguishable_from"])
    beside = f". In these data it looks the same as {alike}" if alike else ""
    return f"{said}{beside}"


def _unnamed(document: Document) -> Entry:
    rest = document["unexplained"]
    return Entry(
        title="Something of unknown cause",
        what=unexplained_words(unexplained_of(rest))
        if rest
        else "The measurement has something that no known mechanism explains.",
        where=str((rest or {}).get("joint", UNKNOWN)),
        how_sure="It is more than noise. What it is stays open: none of the known mechanisms explains it.",
        do_first=f"Change no parts because of this alone. Measure first: {document['next_measurement']}".strip(),
    )


def _nothing(document: Document) -> Entry:
    suspected = any(finding["probability"] < REPORTED for finding in document["findings"])
    return Entry(
        title="Nothing found",
        what="Nothing that was examined differs from the description by more than these data leave open.",
        where="the whole axis, as far as it was moved and measured",
        how_sure="This holds for what these data can show, and for nothing else: see what was not examined.",
        do_first=(
            f"Change no parts. {'What is only suspected stands below: measure first. ' if suspected else ''}"
            "Keep this record, and measure the same motion again at the next inspection."
        ),
    )


def box_of_robot(document: Mapping[str, Any]) -> list[Entry]:
    """What a technician reads first; a mechanism of several joints is one entry, and so is friction."""
    found = document["findings"]
    places = [k for k, one in enumerate(found) if not is_in_every_axis(one["mechanism"])]
    beyond = [found[k] for k in places]
    usual = [one for one in found if is_in_every_axis(one["mechanism"]) and one["probability"] >= REPORTED]
    only_friction = usual and not beyond and document["verdict"] != "unnamed"
    entries = [] if only_friction else _together(box_of({**document, "findings": beyond}, None), beyond)
    entries = [one if one.finding is None else replace(one, finding=places[one.finding]) for one in entries]
    return [*entries, *([_friction(usual)] if usual else [])]


def _together(entries: Sequence[Entry], findings: Sequence[Document]) -> list[Entry]:
    """Put what is the same at several joints into one entry, with the size that it has at each."""
    groups: dict[tuple[str, str, str], list[Entry]] = {}
    for entry in entries:
        groups.setdefault((entry.title, entry.how_sure, entry.do_first), []).append(_at_the_joint(entry))
    return [same[0] if len(same) == 1 else _one_of(same, findings) for same in groups.values()]


def _at_the_joint(entry: Entry) -> Entry:
    """In the words of the finding: of a joint whose drive is not described no turn of a motor is known."""
    where = FLANGE if entry.where == PAYLOAD else entry.where
    if "of the joint" not in entry.what:
        return replace(entry, where=where)
    sizes = (replace(one, name=one.name.replace("of the motor", "of the joint")) for one in entry.sizes)
    return replace(entry, where=where, sizes=tuple(sizes))


def _one_of(same: Sequence[Entry], findings: Sequence[Document]) -> Entry:
    sizes = []
    for entry in same:
        given = findings[entry.finding or 0]
        size = kind_or_any(given["mechanism"]).size
        main = next((one for one in given["parameters"] if one["name"] == size), None)
        if main is not None:
            sizes.append(replace(size_of(given["mechanism"], main), name=f"at {given['location']}"))
    told = f"The same at {len(same)} joints; each stands below with all its numbers."
    return replace(same[0], what=told, where=", ".join(entry.where for entry in same), sizes=tuple(sizes))


def _friction(usual: Sequence[Document]) -> Entry:
    return Entry(
        title="Friction",
        what="The joints have friction that the description does not have. Every axis has friction: it is a fault "
        "only if it is more than it was as new.",
        where=", ".join(dict.fromkeys(str(one["location"]) for one in usual)),
        how_sure="See each joint below.",
        do_first="Nothing to repair: enter it in the description, and compare it with the joints as new or with "
        "another such robot.",
    )


def rests_of_robot(document: Document) -> str:
    """Say at which joints something is left without a name, and what, beside what the box says already."""
    told = document.get("unexplained") if document["verdict"] == "unnamed" else None
    return " ".join(
        f"{joint['name']}: {unexplained_words(unexplained_of(joint['unexplained']))}"
        for joint in document.get("joints", ())
        if joint.get("unexplained") and not (told and told.get("joint") == joint["name"])
    )


def is_urgent(document: Document) -> bool:
    """Whether damage that grows was found, so that there is a day by which to act."""
    return any(
        kind_or_any(one["mechanism"]).traits.urgent and one["probability"] >= REPORTED for one in document["findings"]
    )


def unexplained_words(rest: Unexplained) -> str:
    """Where something is left that no mechanism explains, and how much of what the mechanisms leave.

    >>> print(unexplained_words(Unexplained("frequency", "motor_torque_nm", 0.2, 9.0, {"frequency_hz": 37.0})))
    A fixed frequency in the motor torque: 37.0 Hz. It makes up 20\xa0% of the residual (squared, in units of noise).
    """
    place = ", ".join(_places(rest))
    way = {1.0: ", while turning forward", -1.0: ", while turning backward"}.get(rest.numbers.get("direction", 0.0), "")
    return (
        f"{KINDS.get(rest.kind, rest.kind)} in the {words_of(rest.channel)}: {place}{way}. It makes up "
        f"{percent(min(max(rest.share, 0.0), 1.0))} of the residual (squared, in units of noise)."
    )


def _places(rest: Unexplained) -> list[str]:
    out = []
    for name, value in rest.numbers.items():
        if name == "order":
            out.append(f"{value:g} times per turn of the load")
        elif name.startswith("angle_"):
            out.append(f"{angle(value)} of {words_of(name).removeprefix('angle ')}")
        elif name.endswith("_rad"):
            out.append(f"{words_of(name)} of {angle(value)}")
        elif name != "direction":
            unit = next((unit for ending, unit in UNITS.items() if name.endswith(ending)), "")
            out.append(f"{number(value)} {unit}".strip())
    return out


def is_shown(mechanism: str, name: str, low: object, high: object) -> bool:
    """Whether a number of a finding says something to a reader: an angle known no closer than a turn does not.

    >>> is_shown("torque_ripple", "phase_rad", 0.1, 0.4), is_shown("torque_ripple", "phase_rad", -30.0, 30.0)
    (True, False)
    """
    kind = next((p for p in kind_or_any(mechanism).parameters if p.name == name), None)
    if kind is None:
        return True
    known = not (isinstance(low, int | float) and isinstance(high, int | float) and high - low >= math.tau)
    return kind.shown and (known or not kind.periodic)


def size_of(mechanism: str, given: Document) -> Size:
    """A number of a finding in words."""
    name, value, unit = str(given["name"]), given["value"], str(given.get("unit") or "")
    if not is_number(value):
        return Size(words_of(name), str(value), "")
    if name == "flank":
        return Size(words_of(name), FLANKS.get(float(value), "not known"), "")
    low, high = given.get("low"), given.get("high")
    if not (isinstance(low, int | float) and isinstance(high, int | float) and high > low):
        low = high = value
    known = high > low
    half = 0.5 * (high - low) if known else 0.0
    beside = f" ({angle(value, half)})" if unit == "rad" else ""
    shown = f"{number(value, half)} {unit_in_words(unit)}".strip()
    between = f"{interval(low, high)} {unit_in_words(unit)}".strip() if known else ""
    in_angles = f" ({angle_interval(low, high)})" if known and unit == "rad" else ""
    return Size(words_of(name), f"{shown}{beside}", f"{between}{in_angles}")


def is_number(value: object) -> bool:
    """Whether it is a number, and no word or yes or no."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def refused(error: str) -> Entry:
    """Data that could not be investigated; `error` says what would be right."""
    return Entry(
        title="Nothing was examined",
        what="The data do not fit together, or do not fit the description, so no result would be right.",
        where="in the data or in the description, as far as is known; nothing is said of the machine",
        how_sure="The data were refused before anything was looked for.",
        do_first=f"Change no parts. Mend the data or the description, and ask again: {error}",
    )
