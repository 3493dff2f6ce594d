"""What sound says of an axis: alone, beside telemetry, or as several recordings of the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casebase.signals.recording import Recording
from sim.description.axis import Axis
from sim.discrepancy.acoustic.angular_resampling import LOWEST_WEAK, WEAK, bearing_along_path
from sim.discrepancy.acoustic.baseline_comparison import Grown, grown, strangers_as_new
from sim.discrepancy.acoustic.coverage import WORDS, reach
from sim.discrepancy.acoustic.evidence import AcousticFinding, Listening, probability
from sim.discrepancy.acoustic.faults import SHOWN, bearing_defect, not_as_new, play, sign_of_tooth, tooth_damage
from sim.discrepancy.acoustic.operating_states import LEAST_CRUISES, Course, course_of
from sim.discrepancy.acoustic.recording_quality import recording_faults
from sim.discrepancy.acoustic.residual import left_in
from sim.discrepancy.acoustic.several_recordings import (
    contradictions,
    names_of,
    strangers,
    with_recordings,
    without_copies,
)
from sim.discrepancy.data.preprocessing import Measurement
from sim.discrepancy.unexplained import Unexplained
from sim.mechanisms import (
    Backlash,
    BearingDefect,
    Clipping,
    ElectricalHum,
    LostSamples,
    MeshError,
    StructuralResonance,
    ToothDamage,
)
from sim.mechanisms.catalogue import kind_or_any

SAID = 0.5
SURE = 0.9  # of what telemetry does not show, though it could
LEAST_S = 4.0
FIRST_TO_MEND = (Clipping, LostSamples, ToothDamage, Backlash, StructuralResonance, MeshError, BearingDefect)
ADVICE = (
    "How deep tooth damage (notch) or how wide backlash (play) is cannot be heard. "
    "Telemetry shows that, and what was not examined."
)
COMPARE = (
    "Give a recording of the same motion from when the axis was new as well, if there is one: it shows whether teeth "
    "are louder than as new and whether something rings."
)
SAME_PITCH = 0.03  # relative
UNEVEN, SMALL = 0.005, 5  # of a speed while cruising; small numbers


def listen(
    axis: Axis, sound: Recording, measurement: Measurement | None, offset_s: float
) -> tuple[tuple[AcousticFinding, ...], Unexplained | None]:
    """Findings of one recording, and what is left of it; with telemetry, angles are those of its encoders."""
    if measurement is None:
        alone = listen_alone(axis, [sound])
        return alone.heard, alone.left
    values = np.asarray(sound.samples, dtype=np.float64)
    course = course_of(axis, sound, measurement, offset_s)
    out = recording_faults(values, sound.sample_rate_hz, course.moving)
    if sound.duration_s > LEAST_S:
        out += bearing_along_path(axis, values, sound.sample_rate_hz, measurement, offset_s)
        teeth = [sign_of_tooth(axis, course)]
        machine = (*tooth_damage(axis, [course], teeth), *play(axis, [course], teeth))
        out += [replace(h, indistinguishable_from=()) for h in machine if h.probability >= SURE]  # telemetry tells
    left = _left([(sound, course)], [], named=bool(out))
    return tuple(beside_rest(h, left) for h in out), left


def listen_alone(axis: Axis, sounds: Sequence[Recording], as_new: Sequence[Recording] = ()) -> Listening:
    """Findings of one or more recordings of the same axis, made without telemetry.

    `as_new`: recordings of the same motion from when the axis was in good order, to compare with.
    """
    sounds, copied = without_copies(sounds)
    names = names_of(sounds)
    courses = tuple(course_of(axis, sound, None, 0.0) for sound in sounds)
    before = tuple(course_of(axis, sound, None, 0.0) for sound in as_new)
    teeth, teeth_before = ([sign_of_tooth(axis, one) for one in group] for group in (courses, before))
    teeth = not_as_new(axis, list(zip(courses, teeth, strict=True)), list(zip(before, teeth_before, strict=True)))
    machine = [hear for look in (tooth_damage, play, bearing_defect) for hear in look(axis, courses, teeth)]
    for was in play(axis, before, teeth_before):
        if any(p is not None and p < SHOWN for p in was.p_values):
            machine = [_as_new(h) if h.mechanism == was.mechanism else h for h in machine]
    machine, told = _told_by_growth(machine, grown(axis, courses, before))
    found = [h for h in (*machine, *_faults(sounds, courses)) if h.probability >= SAID]
    heard = tuple(with_recordings(h, names) for h in found)
    rejected = tuple((h.mechanism, h.probability) for h in machine if h.probability < SAID)
    within = reach(axis, sounds, courses, before)
    remarks = (
        within.sentence(),
        *_contradicted(courses, names),
        *contradictions(machine, names),
        *strangers([*sounds, *as_new], [*names, *(f"{name} as new" for name in names_of(as_new))]),
        *strangers_as_new(courses, before, names),
        *copied,
        *told,
        ADVICE,
        *(_of_as_new(as_new, before) if as_new else (COMPARE,)),
    )
    following = _next(axis, heard, courses)
    left = _left(list(zip(sounds, courses, strict=True)), list(zip(as_new, before, strict=True)), named=bool(heard))
    heard = tuple(beside_rest(h, left) for h in heard)
    return Listening(
        heard, rejected, remarks, following, courses, within.examined, within.not_examined, names, before, left
    )


def _left(
    sounds: Sequence[tuple[Recording, Course]], as_new: Sequence[tuple[Recording, Course]], *, named: bool
) -> Unexplained | None:
    """What is left most in any recording and was not as new; what comes and goes is that of a cause if `named`."""
    before = [one.numbers["frequency_hz"] for one in (left_in(*each) for each in as_new) if one is not None]
    rest = [
        one for one in (left_in(*each) for each in sounds) if one is not None and not (named and one.kind == "time")
    ]
    new = [u for u in rest if all(abs(u.numbers["frequency_hz"] / was - 1.0) > SAME_PITCH for was in before)]
    return max(new, key=lambda u: u.score, default=None)


def beside_rest(heard: AcousticFinding, left: Unexplained | None) -> AcousticFinding:
    """A finding of the axis: no surer than a weak one, where something without a name is left."""
    if left is None or kind_or_any(heard.mechanism).of_the_recording:
        return heard
    return replace(heard, probability=min(heard.probability, WEAK))


def _as_new(h: AcousticFinding) -> AcousticFinding:
    """What the axis sounded of as new as well, and so is no fault."""
    p_values = tuple(None if p is None else 1.0 for p in h.p_values)
    return replace(h, p_values=p_values, probability=probability(p_values))


def _told_by_growth(machine: Sequence[AcousticFinding], growth: Grown) -> tuple[list[AcousticFinding], tuple[str, ...]]:
    """Teeth that have all grown louder make impacts of their own; where none have, impacts are none of theirs.

    What was heard of impacts is then said with the teeth that err: sound does not tell one from the other.
    """
    if growth.teeth_as_new:
        machine = [replace(h, indistinguishable_from=()) for h in machine]
    erring = next((h for h in growth.heard if h.mechanism == MeshError.name and h.probability >= SAID), None)
    struck = [h.mechanism for h in machine if _loses_contact(h) and h.probability >= SAID]
    if erring is None or not struck:
        return [*machine, *growth.heard], ()
    alike = replace(erring, indistinguishable_from=tuple(struck))
    remarks = tuple(
        f"Impacts as of {WORDS[name]} are heard as well; teeth of a gear that have all grown louder make such, too. "
        "Until an inspection or telemetry decides, treat it as both."
        for name in struck
    )
    rest = [h for h in machine if h.mechanism not in struck]
    return [*rest, *(alike if h is erring else h for h in growth.heard)], remarks


def _of_as_new(as_new: Sequence[Recording], courses: Sequence[Course]) -> tuple[str, ...]:
    """Remarks on faults of what was compared with."""
    return tuple(
        f"Sound as new, {name}: {fault.explanation}"
        for name, sound, course in zip(names_of(as_new), as_new, courses, strict=True)
        for fault in recording_faults(np.asarray(sound.samples, np.float64), sound.sample_rate_hz, course.moving)
    )


def _faults(sounds: Sequence[Recording], courses: Sequence[Course]) -> list[AcousticFinding]:
    """Faults of the recordings, each as it is in the first that has it."""
    each = [
        {f.mechanism: f for f in recording_faults(np.asarray(s.samples, np.float64), s.sample_rate_hz, c.moving)}
        for s, c in zip(sounds, courses, strict=True)
    ]
    first: dict[str, AcousticFinding] = {}
    for faults in each:
        first |= {name: fault for name, fault in faults.items() if name not in first}
    return [
        replace(fault, p_values=tuple(0.0 if name in faults else 1.0 for faults in each))
        for name, fault in first.items()
    ]


def _contradicted(courses: Sequence[Course], names: Sequence[str]) -> tuple[str, ...]:
    """Where recordings do not have the described period."""
    told = [(name, course.contradiction) for name, course in zip(names, courses, strict=True) if course.contradiction]
    return tuple(f"{text}" if len(names) == 1 else f"Recording {name}: {text}" for name, text in told)


def beside(
    named: Sequence[str],
    heard: Sequence[AcousticFinding],
    load_encoder: bool,
    struck: Sequence[float] = (),
    loud: Sequence[float] = (),
) -> tuple[AcousticFinding, ...]:
    """What sound adds to mechanisms that telemetry has named: no name twice, and no gear fault against an encoder.

    With a load encoder telemetry shows damaged teeth and play below what can be heard; without one, sound may name
    them where telemetry found nothing else that it could have taken for them. `struck`: turns per turn of the motor
    of the gears with a damaged tooth; impacts at their multiples are that tooth and no bearing. `loud`: teeth per turn
    of the motor of the gears whose teeth err; a family at a ratio of small numbers to them is what these leave beside
    their lines while the speed is not quite even. A weak family beside any fault of teeth is theirs, and so is one of
    so low an order that their own turns make as many lines.
    """
    blind = not load_encoder and not set(named)
    of_teeth = any(t.loses_contact or t.erring_teeth for t in (kind_or_any(name).traits for name in named))
    return tuple(
        h
        for h in heard
        if h.mechanism not in named
        and (blind or not _loses_contact(h))
        and not (h.mechanism == BearingDefect.name and _is_of_gears(h, struck, loud))
        and not (h.mechanism == BearingDefect.name and _is_faint(h) and of_teeth)
    )


def _loses_contact(h: AcousticFinding) -> bool:
    return kind_or_any(h.mechanism).traits.loses_contact


def _is_faint(h: AcousticFinding) -> bool:
    return h.probability < SURE or h.parameters["order"][0] < LOWEST_WEAK


def _is_of_gears(h: AcousticFinding, struck: Sequence[float], loud: Sequence[float]) -> bool:
    return any(_is_multiple(h, order) for order in struck) or any(_is_ratio(h, order) for order in loud)


def _is_multiple(h: AcousticFinding, order: float) -> bool:
    value, low, high = h.parameters["order"]
    return low <= round(value / order) * order <= high


def _is_ratio(h: AcousticFinding, order: float) -> bool:
    value, low, high = h.parameters["order"]
    half = 0.5 * (high - low) + UNEVEN * value
    return any(abs(value - order * j / k) <= half for j in range(1, SMALL + 1) for k in range(1, SMALL + 1))


def _next(axis: Axis, heard: Sequence[AcousticFinding], courses: Sequence[Course]) -> str:
    named = {h.mechanism for h in heard}
    for kind in FIRST_TO_MEND:
        if kind.heard and kind.name in named:
            return kind.heard.then
    if not any(course.repeats and len(course.cruises) >= LEAST_CRUISES for course in courses):
        return (
            "Move back and forth between the same two positions at constant speed, five times or more, and record that."
        )
    if ElectricalHum.heard and ElectricalHum.name in named:
        return ElectricalHum.heard.then
    return (
        "Record motor torque and angle with the sound, best with an encoder at the load: most causes cannot be heard."
    )
