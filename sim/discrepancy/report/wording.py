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
from sim.discrepancy.data.excitation import turns
from sim.discrepancy.hypotheses.identifiability import HALF
from sim.discrepancy.report.formatting import angle, named, number, percent, words_of
from sim.discrepancy.report.maintenance_actions import (
    BEHIND_THE_MOTOR,
    MEASUREMENTS,
    OF_THE_MEASUREMENT,
    SHOWN_RAD,
    measurement,
)
from sim.discrepancy.results import Unexplained
from sim.mechanisms.mechanism import Need

if TYPE_CHECKING:
    from sim.discrepancy.results import Finding, Investigation

SENTENCES: Mapping[str, str] = {
    "backlash": "The {where} gear pair has play of {gap_rad:.3g} rad ({gap_rad_shown}): around every reversal of torque the load moves freely until the other flank meets.",
    "tooth_damage": "A flank of the {where} gear lacks material near {angle_rad:.3f} rad ({angle_rad_shown}), {depth_rad:.2g} rad ({depth_rad_shown}) deep: torque breaks down there once per revolution, in one direction of torque.",
    "eccentricity": "The {where} gear runs out of true by {amplitude_rad:.3g} rad ({amplitude_rad_shown}) once per revolution.",
    "mesh_error": "The teeth of the {where} gear pair err by {amplitude_rad:.3g} rad ({amplitude_rad_shown}) at tooth frequency, more than as new.",
    "kinematic_error": "The output of the {where} gear swings by {amplitude_rad:.3g} rad ({amplitude_rad_shown}) {order:g} times per turn of its input shaft, as that of a strain wave gear does twice.",
    "coulomb_friction": "Dry friction of {torque_n_m:.3g} N m as felt at the motor is missing from the description.",
    "viscous_friction": "Viscous friction of {coefficient_n_m_s_per_rad:.3g} N m s/rad as felt at the motor is missing from the description.",
    "stribeck_friction": "At low speed friction rises by {torque_n_m:.3g} N m, below about {speed_rad_s:.3g} rad/s of the motor: the lubricant film breaks down.",
    "friction_asymmetry": "Friction differs between the two directions of motion.",
    "load_dependent_loss": "The {where} gear pair loses {fraction:.1%} of the torque it transmits.",
    "friction_drift": "Friction changes by {rate_per_s:.2%} per second during the record, as when the gear warms up.",
    "gravity_imbalance": "A torque of {torque_n_m:.3g} N m pulls at the load and turns with it: weight off the axis of rotation.",
    "torque_ripple": "The motor torque ripples by {torque_n_m:.3g} N m {order:g} times per revolution of the motor.",
    "stiffness_hardening": "The {where} gear pair is stiffer at large twist than at small.",
    "hysteresis": "The {where} gear pair holds back {torque_n_m:.3g} N m when the twist turns: its spring has a loop.",
    "torque_offset": "The torque channel reads {torque_n_m:.3g} N m too much, whatever the motion.",
    "encoder_error": "The load encoder errs by {amplitude_rad:.3g} rad ({amplitude_rad_shown}) once per revolution, more than its data sheet says.",
    "time_delay": "A channel is late by {delay_s:.3g} s against the others.",
    "structural_resonance": "Part of the load, {share:.0%} of its inertia, swings by itself at {frequency_hz:.3g} Hz: an arm, a tool or the stand is soft or loose.",
    "electrical_hum": "A hum of {frequency_hz:g} Hz from the mains is on the torque channel.",
}  # fmt: skip
KINDS = {
    "frequency": "A fixed frequency",
    "speed": "Friction that changes with the speed",
    "angle": "Torque that changes with the angle",
    "time": "Something that changes with time",
    "transmission error": "A difference of motor and load that comes back",
    "error_over_angle": "A difference of both encoders that hangs on the angle of the load, as an error of the gear or of an encoder does,",
}
REST = {
    "frequency": "Repeat the same motion at half the speed: what stays at its frequency is a structure or the supply, what moves with the speed is a gear, a bearing or the motor.",
    "speed": "Move at five even speeds in both directions: friction at the motor or the load shows as a curve of torque over speed, something that swings does not.",
    "angle": "Turn the load slowly through more than one revolution in both directions: friction keeps its angle and turns its sign with the direction, weight and runout keep theirs.",
    "error_over_angle": "Turn the load slowly through more than one revolution in both directions, with a second encoder or a laser beside it: an error of the load's encoder shows between the two, one of the gear does not.",
    "time": "Repeat the motion twice in a row with the temperature logged: heat goes on from where it was, what happened once does not come again.",
}
PLACED = {"angle_rad": SHOWN_RAD}  # to which a place is said
ALIKE = 0.25  # of what a mechanism explains, from which another looks like it
SAID = 0.5  # probability from which a name is said
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
    shown = {f"{name}_shown": angle(value, PLACED.get(name, 0.0)) for name, value in numbers.items() if "_rad" in name}
    sentence = SENTENCES.get(mechanism)
    said = [
        sentence.format(where=location or "", **numbers, **shown)
        if sentence
        else of_itself(mechanism, location, numbers)
    ]
    if "form" in numbers:
        bottom = next((text for below, text in BOTTOMS if numbers["form"] < below), BROKEN)
        said.append(f"Its bottom is {bottom} (form {numbers['form']:.1f}).")
    said += [f"Its place is not certain: at {place} it explains the data as well." for place in elsewhere]
    said += [
        f"It looks like {named(other)}, which in its place explains {percent(share)} of that but predicts rows that "
        "the fit has not seen worse."
        for other, share in instead.items()
        if share > ALIKE
    ]
    return " ".join(said)


def of_itself(mechanism: str, location: str | None, numbers: Mapping[str, float]) -> str:
    """What a mechanism that has no sentence here says of itself, and its numbers.

    >>> of_itself("clipping", "motor", {"fraction": 0.25})
    'Clipping at motor: the motor torque and the sound stop at a level: the fraction says how much of their peak is cut off. Fraction 0.250.'
    """
    kind = mechanisms.MECHANISMS[mechanism]
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
        return "Something is missing in the model that no catalogued mechanism explains."
    said = [f for f in result.findings if f.probability >= SAID]
    machine = [f for f in said if f.mechanism not in OF_THE_MEASUREMENT]
    faults = ", ".join(dict.fromkeys(named(f.mechanism) for f in said if f not in machine))
    if not said:
        return _silent(result)
    if not machine:
        beyond = _silent(result) if result.listening is not None else "Beyond them nothing stands out of the data."
        return f"The measurement has faults: {faults}. {beyond}"
    beside = f" The measurement has faults besides: {faults}." if faults else ""
    if result.listening is not None:
        return f"Heard: {_names(machine)}.{beside}"
    return f"Missing in the model: {_names(machine)}.{beside}"


def _silent(result: Investigation) -> str:
    if result.listening is None:
        return "Nothing is missing in the model that these data could show."
    if not result.examined:
        return "Nothing could be examined in this sound."
    examined = ", ".join(named(name) for name in result.examined)
    return f"Nothing stands out of the sound. Listened for: {examined}; nothing else was examined."


def _names(findings: Sequence[Finding]) -> str:
    return ", ".join(named(f.mechanism, f.location) for f in findings)


def not_examined(result: Investigation) -> list[str]:
    """What these data say nothing of, whatever the verdict, in sentences."""
    if result.selection is None:
        return list(result.remarks)  # the first says what was examined and what not, and why
    m, axis = result.selection.problem.measurement, result.axis
    out = list(result.remarks)
    travel = math.degrees(float(np.ptp(m.angle)) / axis.ratio)
    if axis.stages and travel < 359.0:
        out.append(f"The load moved through {travel:.0f}° of a turn: teeth beyond were not in mesh and not examined.")
    if axis.stages and turns(axis, m, None) <= HALF:
        kinds = mechanisms.MECHANISMS.items()
        unseen = " and ".join(named(name) for name, kind in kinds if Need.HALF_TURN in kind.shown_by)
        out.append(f"The load made less than half a turn: {unseen} at the load were not examined.")
    if axis.stages and m.load_angle is None:
        out.append(
            "No encoder at the load: small play, runout and errors of teeth behind the motor stay below what shows."
        )
    if not result.sounds:
        out.append("No sound was given: rolling bearings were not examined.")
    return out


def next_measurement(axis: Axis, findings: Sequence[Finding], rest: Sequence[Unexplained], load_encoder: bool) -> str:
    """The one measurement that would settle most of what is open, with what each rival would show in it."""
    for finding in findings:
        if finding.indistinguishable_from:
            return telling_apart(finding.mechanism, finding.indistinguishable_from[0], load_encoder)
    if not findings and rest:
        return REST.get(rest[0].kind, REST["frequency"])
    blind = not load_encoder and bool(axis.stages)
    if blind and all(finding.mechanism in BEHIND_THE_MOTOR for finding in findings):
        return (
            "Add an encoder at the load and repeat the motion: play, runout and soft springs inside the gear move the "
            "load against the motor, friction and weight do not."
        )
    for finding in sorted(findings, key=lambda f: (f.mechanism in OF_THE_MEASUREMENT, f.probability)):
        return measurement(axis, finding.mechanism, finding.location, numbers_of(finding))
    return "Nothing is open; repeat the same motion after maintenance or in half a year, and compare."


def numbers_of(finding: Finding) -> dict[str, float]:
    """Fitted numbers of a finding by name."""
    return {e.name: e.value for e in finding.parameters}


def unexplained_words(rest: Unexplained) -> str:
    """Where something is left that no mechanism explains, and how much of what the mechanisms leave."""
    place = ", ".join(_places(rest))
    way = {1.0: ", while turning forward", -1.0: ", while turning backward"}.get(rest.numbers.get("direction", 0.0), "")
    return (
        f"{KINDS.get(rest.kind, rest.kind)} in the {words_of(rest.channel)}: {place}{way}. It makes up "
        f"{percent(min(max(rest.share, 0.0), 1.0))} of what the named mechanisms leave (squared, in units of noise)."
    )


def _places(rest: Unexplained) -> list[str]:
    units = {"_hz": "Hz", "_rad_s": "rad/s", "_rad": "rad", "_s": "s"}
    out = []
    for name, value in rest.numbers.items():
        unit = next((unit for ending, unit in units.items() if name.endswith(ending)), "")
        if name == "order":
            out.append(f"{value:g} times per turn of the load")
        elif name.startswith("angle_"):
            out.append(f"{angle(value)} of {words_of(name).removeprefix('angle ')}")
        elif name != "direction":
            out.append(f"{number(value)} {unit}")
    return out


def telling_apart(first: str, second: str, load_encoder: bool) -> str:
    """The measurement in which two mechanisms differ."""
    pair = {first, second}
    if "torque_offset" in pair:
        return MEASUREMENTS["torque_offset"]
    if pair == {"eccentricity", "encoder_error"}:
        return "Put a dial gauge, a second encoder or a laser at the load and turn it slowly once: runout of the gear moves the load, an error of the encoder does not."
    if pair == {"tooth_damage", "mesh_error"}:
        return "Look by endoscope at all teeth of the gear, or turn it slowly through a whole turn under load and log the torque: one damaged tooth breaks it down at one angle, teeth that all err do so everywhere."
    if pair & {"backlash", "stiffness_hardening", "hysteresis"}:
        return "Block the load, let the motor push slowly to and fro up to its torque limit and log torque against angle: play shows a flat middle, hardening a bend, hysteresis a loop."
    if pair & {"eccentricity", "encoder_error", "gravity_imbalance", "mesh_error"}:
        return "Turn the load slowly through more than one revolution in both directions: an encoder's error needs no torque, eccentricity grows with speed squared, weight does not."
    if not load_encoder:
        return "Add an encoder at the load and repeat the motion: it separates what happens before and behind the gear."
    return "Repeat the motion at a third of the speed and at full speed, in both directions: friction laws differ in how they depend on speed."
