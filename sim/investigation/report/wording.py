# ruff: noqa: E501
"""What a finding means and what to measure next, in sentences that a technician can act on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from sim import mechanisms
from sim.description.axis import Axis
from sim.investigation.data.excitation import turns
from sim.investigation.hypotheses.identifiability import HALF
from sim.investigation.report.formatting import angle, likely, named, number, sure, words_of
from sim.investigation.report.maintenance_actions import SHOWN_RAD, measurement, of_the_measurement
from sim.investigation.results import REPORTED
from sim.investigation.unexplained import Unexplained
from sim.mechanisms.catalogue import is_in_every_axis, kind_of, kind_or_any
from sim.mechanisms.mechanism import Discriminating, Need

if TYPE_CHECKING:
    from sim.investigation.results import Finding, Investigation

REST = {
    "frequency": "Repeat the same motion at half the speed: what keeps its frequency is a structure or the supply; what follows the speed is a gear, a bearing or the motor.",
    "speed": "Move at five even speeds in both directions: friction at the motor or the load shows as a curve of torque over speed, something that swings does not.",
    "angle": "Turn the load slowly through more than one revolution in both directions: friction keeps its angle and changes its sign with the direction, weight and runout keep both.",
    "error_over_angle": "Turn the load slowly through more than one revolution in both directions, with a second encoder or a laser beside it: an error of the load's encoder shows between the two, one of the gear does not.",
    "time": "Repeat the motion twice in a row with the temperature logged: heat goes on from where it was, a single event does not come again.",
}
PLACED = {"angle_rad": SHOWN_RAD}  # to which a place is said
ALIKE = 0.25  # of what a mechanism explains, from which another looks like it
BOTTOMS = ((3.0, "round, like a worn hollow"), (6.0, "between a worn hollow and a piece broken out"))
BROKEN = "flat with steep edges, like a piece broken out"


def explain(
    mechanism: str,
    location: str | None,
    numbers: Mapping[str, float],
    elsewhere: Sequence[str] = (),
    instead: Mapping[str, float] = MappingProxyType({}),
) -> str:
    """Sentences with the fitted numbers; `elsewhere`: where it would explain the data as well.

    `instead`: what looks like it but predicts unseen rows worse, to the share that it explains in its place.
    """
    kind = kind_of(mechanism)
    angles = [p.name for p in kind.parameters if p.unit == "rad" and p.name in numbers]
    shown = {f"{name}_shown": angle(numbers[name], PLACED.get(name, 0.0)) for name in angles}
    sentence = kind.sentence
    said = [
        sentence.format(where=location or "", **numbers, **shown)
        if sentence
        else of_itself(mechanism, location, numbers)
    ]
    if "form" in numbers:
        bottom = next((text for below, text in BOTTOMS if numbers["form"] < below), BROKEN)
        said.append(f"Its bottom is {bottom} (form {numbers['form']:.1f}).")
    said += [f"Where it is is not certain: at {place} it explains the data as well." for place in elsewhere]
    said += [
        f"{named(other)[:1].upper()}{named(other)[1:]} is possible too, but less likely."
        for other, share in instead.items()
        if share > ALIKE
    ]
    return " ".join(said)


def of_itself(mechanism: str, location: str | None, numbers: Mapping[str, float]) -> str:
    """What a mechanism that has no sentence here says of itself, and its numbers.

    >>> of_itself("clipping", "motor", {"fraction": 0.25})
    'Clipping at motor: the motor torque and the sound stop at a level: the fraction says how much of their peak is cut off. Share 0.250.'
    """
    kind = kind_of(mechanism)
    does = " ".join((kind.__doc__ or "").split("\n")[0].split()).rstrip(".")
    units = {p.name: p.unit for p in kind.parameters}
    values = ", ".join(
        f"{words_of(name)} {number(value)} {units.get(name, '')}".removesuffix(" 1") for name, value in numbers.items()
    )
    name = named(mechanism, location)
    return f"{name[0].upper()}{name[1:]}: {does[:1].lower()}{does[1:]}. {values[:1].upper()}{values[1:]}."


def headline(result: Investigation) -> str:
    """The verdict in one line: what is missing, or what was examined where nothing is."""
    if result.verdict == "unnamed":
        return "Something is there that no known mechanism explains."
    said = [f for f in result.findings if f.probability >= REPORTED]
    machine = [f for f in said if not of_the_measurement(f.mechanism)]
    kinds = dict.fromkeys(kind_or_any(f.mechanism) for f in said if f not in machine)
    faults = ", ".join(named(kind.name) for kind in kinds if not kind.or_of_the_machine)
    either = ", ".join(f"{named(kind.name)} or {kind.or_of_the_machine}" for kind in kinds if kind.or_of_the_machine)
    if not said:
        return _silent(result)
    if not machine:
        beyond = (
            _silent(result) if result.acoustic is not None else "Nothing else found, as far as these data can show it."
        )
        first = f"Not described: {either}. " if either else ""
        return first + (f"The measurement has faults: {faults}. " if faults else "") + beyond
    beside = (f" Beside it: {either}." if either else "") + (
        f" The measurement also has faults: {faults}." if faults else ""
    )
    usual = ", ".join(named(f.mechanism, f.location) for f in machine if is_in_every_axis(f.mechanism))
    found = "; ".join(_with_certainty(f) for f in machine if not is_in_every_axis(f.mechanism))
    if usual:
        beside = f" Not faults, but missing from the description: {usual}.{beside}"
    verb = "Found" if result.acoustic is None else "Heard"
    return f"{verb}: {found}.{beside}" if found else f"{_silent(result)}{beside}"


def _silent(result: Investigation) -> str:
    if result.acoustic is None:
        return "No fault found, as far as these data can show one."
    if not result.examined:
        return "Nothing could be examined in this sound."
    examined = ", ".join(named(name) for name in result.examined)
    return f"No fault is heard. Listened for: {examined}; nothing else was examined."


def _with_certainty(f: Finding) -> str:
    how_sure = likely(f.probability, calibrated=True) if f.calibrated else sure(f.probability)
    return f"{named(f.mechanism, f.location)}, {how_sure}"


def not_examined(result: Investigation) -> list[str]:
    """What these data say nothing of, whatever the verdict, in sentences."""
    if result.selection is None:
        return list(result.remarks)  # the first says what was examined and what not, and why
    m, axis = result.selection.problem.measurement, result.axis
    out = list(result.remarks)
    travel = math.degrees(float(np.ptp(m.angle)) / axis.ratio)
    if axis.stages and travel < 359.0:
        out.append(
            f"The load moved through {travel:.0f}° of a turn: teeth outside that range were not in mesh and were not examined."
        )
    if axis.stages and turns(axis, float(np.ptp(m.angle)), None) <= HALF:
        kinds = mechanisms.MECHANISMS.items()
        unseen = " and ".join(named(name) for name, kind in kinds if Need.HALF_TURN in kind.shown_by)
        out.append(f"The load made less than half a turn: {unseen} at the load were not examined.")
    if axis.stages and m.load_angle is None:
        out.append(
            "There is no encoder at the load: small backlash, runout and tooth errors behind the motor cannot be seen."
        )
    if not result.sounds:
        out.append("No sound was given: rolling bearings were not examined.")
    return out


def next_measurement(axis: Axis, findings: Sequence[Finding], rest: Sequence[Unexplained], load_encoder: bool) -> str:
    """The one measurement that would settle most of what is open, with what each rival would show in it."""
    for finding in findings:
        if finding.indistinguishable_from:
            return measurement_between(finding.mechanism, finding.indistinguishable_from[0], load_encoder)
    if not findings and rest:
        return measurement_of_the_rest(rest[0])
    blind = not load_encoder and bool(axis.stages)
    if blind and all(kind_or_any(finding.mechanism).traits.behind_the_motor for finding in findings):
        return (
            "Add an encoder at the load and repeat the motion: backlash, runout and soft springs in the gear move the "
            "load against the motor, friction and weight do not."
        )
    for finding in sorted(findings, key=lambda f: (of_the_measurement(f.mechanism), f.probability)):
        return measurement(axis, finding.mechanism, finding.location, numbers_of(finding))
    return "Nothing is open. Repeat the same motion after maintenance or in half a year, and compare."


def measurement_of_the_rest(rest: Unexplained) -> str:
    """The measurement that would show what something without a name is."""
    return REST.get(rest.kind, REST["frequency"])


def numbers_of(finding: Finding) -> dict[str, float]:
    """Fitted numbers of a finding by name."""
    return {e.name: e.value for e in finding.parameters}


def measurement_between(first: str, second: str, load_encoder: bool) -> str:
    """The measurement in which two mechanisms differ."""
    one, other = kind_or_any(first).discriminated_by, kind_or_any(second).discriminated_by
    for way in Discriminating:
        if way in (one & other if way.of_both else one | other):
            return way.value
    if not load_encoder:
        return "Add an encoder at the load and repeat the motion: it separates what happens before and behind the gear."
    return "Repeat the motion at a third of the speed and at full speed, in both directions: friction laws differ in how they depend on speed."
