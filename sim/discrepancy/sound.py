"""What sound says of an axis: alone, beside telemetry, or as several recordings of the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casebase.signals.recording import Recording
from sim.axis import Axis
from sim.discrepancy.measurement import Measurement
from sim.discrepancy.sound_course import LEAST_CRUISES, Course, course_of
from sim.discrepancy.sound_evidence import Heard
from sim.discrepancy.sound_gears import bearing_defect, play, tooth_damage
from sim.discrepancy.sound_lines import mesh_orders
from sim.discrepancy.sound_path import bearing_along_path
from sim.discrepancy.sound_recording import recording_faults

SAID = 0.5
SURE = 0.9  # of what telemetry does not show, though it could
LEAST_S = 4.0
GEAR = frozenset({"tooth_damage", "backlash"})
OF_TEETH = GEAR | {"mesh_error", "eccentricity"}  # what leaves families of lines of its own
UNEVEN, SMALL = 0.005, 5  # of a speed while cruising; small numbers


@dataclass(frozen=True, eq=False)
class Listening:
    """Findings, candidates that were rejected with their probability, what is out of reach, what to measure next."""

    heard: tuple[Heard, ...]
    rejected: tuple[tuple[str, float], ...]
    remarks: tuple[str, ...]
    next_measurement: str
    courses: tuple[Course, ...]


def listen(axis: Axis, sound: Recording, measurement: Measurement | None, offset_s: float) -> tuple[Heard, ...]:
    """Findings of one recording; with telemetry, angles are those of its encoders."""
    if measurement is None:
        return listen_alone(axis, [sound]).heard
    values = np.asarray(sound.samples, dtype=np.float64)
    course = course_of(axis, sound, measurement, offset_s)
    out = recording_faults(values, sound.sample_rate_hz, course.moving)
    if sound.duration_s > LEAST_S:
        out += bearing_along_path(axis, values, sound.sample_rate_hz, measurement, offset_s)
        out += [h for h in (*tooth_damage(axis, [course]), *play(axis, [course])) if h.probability >= SURE]
    return tuple(out)


def listen_alone(axis: Axis, sounds: Sequence[Recording]) -> Listening:
    """Findings of one or more recordings of the same axis, made without telemetry."""
    courses = tuple(course_of(axis, sound, None, 0.0) for sound in sounds)
    faults: dict[str, Heard] = {}
    for sound, course in zip(sounds, courses, strict=True):
        for fault in recording_faults(np.asarray(sound.samples, np.float64), sound.sample_rate_hz, course.moving):
            faults.setdefault(fault.mechanism, fault)
    machine = [*tooth_damage(axis, courses), *play(axis, courses), *bearing_defect(axis, courses)]
    heard = tuple(h for h in (*machine, *faults.values()) if h.probability >= SAID)
    rejected = tuple((h.mechanism, h.probability) for h in machine if h.probability < SAID)
    return Listening(heard, rejected, _remarks(axis, courses), _next(axis, heard, courses), courses)


def beside(
    named: Sequence[str],
    heard: Sequence[Heard],
    load_encoder: bool,
    struck: Sequence[float] = (),
    loud: Sequence[float] = (),
) -> tuple[Heard, ...]:
    """What sound adds to mechanisms that telemetry has named: no name twice, and no gear fault against an encoder.

    With a load encoder telemetry shows damaged teeth and play below what can be heard; without one, sound may name
    them where telemetry found nothing else that it could have taken for them. `struck`: turns per turn of the motor
    of the gears with a damaged tooth; impacts at their multiples are that tooth and no bearing. `loud`: teeth per turn
    of the motor of the gears whose teeth err; a family at a ratio of small numbers to them is what these leave beside
    their lines while the speed is not quite even. A weak family beside any fault of teeth is theirs.
    """
    blind = not load_encoder and not set(named)
    return tuple(
        h
        for h in heard
        if h.mechanism not in named
        and (h.mechanism not in GEAR or blind)
        and not (h.mechanism == "bearing_defect" and _is_of_gears(h, struck, loud))
        and not (h.mechanism == "bearing_defect" and h.probability < SURE and OF_TEETH & set(named))
    )


def _is_of_gears(h: Heard, struck: Sequence[float], loud: Sequence[float]) -> bool:
    return any(_is_multiple(h, order) for order in struck) or any(_is_ratio(h, order) for order in loud)


def _is_multiple(h: Heard, order: float) -> bool:
    value, low, high = h.parameters["order"]
    return low <= round(value / order) * order <= high


def _is_ratio(h: Heard, order: float) -> bool:
    value, low, high = h.parameters["order"]
    half = 0.5 * (high - low) + UNEVEN * value
    return any(abs(value - order * j / k) <= half for j in range(1, SMALL + 1) for k in range(1, SMALL + 1))


def _remarks(axis: Axis, courses: Sequence[Course]) -> tuple[str, ...]:
    out = [
        "Sound alone: friction, stiffness, loads, offsets and delays cannot be heard, nor how deep a notch or how wide "
        "play is; record telemetry for them.",
        "Whine of the teeth and the housing's own tones are in every recording; whether they are louder than as new "
        "(mesh_error, eccentricity, structural_resonance) needs telemetry, or a recording from when the axis was new.",
    ]
    if not any(course.analysis.motion.reversal_times_s for course in courses):
        out.append("No standstill is heard, so neither damaged teeth nor play can be told from other impacts.")
    elif not any(course.repeats for course in courses):
        out.append("The motion does not repeat, so a damaged tooth cannot be told from other impacts.")
    if not mesh_orders(axis):
        out.append("The description gives no tooth numbers, so that bearings cannot be told from teeth.")
    elif not any(course.speed for course in courses):
        out.append(
            "No tooth of this axis is heard as a line, so the speed is unknown and bearings were not looked for."
        )
    return tuple(out)


def _next(axis: Axis, heard: Sequence[Heard], courses: Sequence[Course]) -> str:
    named = {h.mechanism for h in heard}
    if named & {"clipping", "lost_samples"}:
        return "Record again with the gain lowered and without gaps: what is missing of the sound could be a fault's."
    if "tooth_damage" in named:
        return (
            "Record motor torque and angle of motor and load of the same motion, slowly through a whole turn in both "
            "directions: they give the tooth, its depth and its flank."
        )
    if "backlash" in named:
        return (
            "Add an encoder at the load and repeat the motion: the way between the flanks is the gap, and the stage "
            "with the play shows in how fast it is crossed."
        )
    if "bearing_defect" in named:
        return (
            "Repeat the motion at two thirds of the speed: what keeps its order is the bearing, what keeps its pitch "
            "is not."
        )
    if not any(course.repeats and len(course.cruises) >= LEAST_CRUISES for course in courses):
        return (
            "Move back and forth between the same two positions at constant speed, five times or more, and record that."
        )
    if "electrical_hum" in named:
        return (
            "Mend the earthing of the recorder, then repeat; friction, stiffness and play need telemetry with a load "
            "encoder."
        )
    return (
        "Record motor torque and angle with the sound, best with an encoder at the load: most causes cannot be heard."
    )
