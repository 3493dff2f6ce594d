"""What sound says of an axis: alone, beside telemetry, or as several recordings of the same axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from signals.recording import Recording
from sim.description.axis import Axis
from sim.investigation.acoustic.baseline_comparison import Grown, grown, unlike_recordings_as_new
from sim.investigation.acoustic.coverage import WORDS, reach
from sim.investigation.acoustic.evidence import AcousticFinding, AcousticResult
from sim.investigation.acoustic.faults import bearing_defect, tooth_and_play
from sim.investigation.acoustic.operating_states import LEAST_CRUISES, Course, course_of
from sim.investigation.acoustic.recording_quality import recording_faults
from sim.investigation.acoustic.residual import left_in
from sim.investigation.acoustic.several_recordings import (
    contradictions,
    names_of,
    with_recordings,
    without_copies,
)
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.unexplained import Unexplained
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
WEAK = 0.85  # of a finding beside something without a name
SAME_PITCH = 0.03  # relative
FIRST_TO_MEND = (Clipping, LostSamples, ToothDamage, Backlash, StructuralResonance, MeshError, BearingDefect)
ADVICE = (
    "How deep tooth damage (notch) or how wide backlash (play) is cannot be heard. "
    "Telemetry shows that, and what was not examined."
)
COMPARE = (
    "Give a recording of the same motion from when the axis was new as well, if there is one: it shows whether teeth "
    "are louder than as new and whether something rings."
)


def sound_beside_telemetry(
    axis: Axis, sound: Recording, measurement: Measurement | None, offset_s: float
) -> tuple[tuple[AcousticFinding, ...], Unexplained | None]:
    """Findings of one recording, and what is left of it; with telemetry, speed and reversals are the measured ones."""
    if measurement is None:
        alone = sound_alone(axis, [sound])
        return alone.heard, alone.left
    course = course_of(axis, sound, measurement, offset_s)
    machine = [h for h in tooth_and_play(axis, [course]) if h.probability >= SURE]
    bearing = [h for h in bearing_defect(axis, [course]) if h.probability >= SAID]
    out = [*recording_faults(course), *bearing, *(replace(h, indistinguishable_from=()) for h in machine)]
    left = _left([course], [], named=bool(out))
    return tuple(discounted(h, left) for h in out), left


def sound_alone(axis: Axis, sounds: Sequence[Recording], as_new: Sequence[Recording] = ()) -> AcousticResult:
    """Findings of one or more recordings of the same axis, made without telemetry.

    `as_new`: recordings of the same motion from when the axis was in good order, to compare with.
    """
    sounds, copied = without_copies(sounds)
    names = names_of(sounds)
    courses, before = (tuple(course_of(axis, one, None, 0.0) for one in group) for group in (sounds, as_new))
    machine = [*tooth_and_play(axis, courses, before), *bearing_defect(axis, courses)]
    machine, told = _told_by_growth(machine, grown(axis, courses, before))
    found = [h for h in (*machine, *_faults(courses)) if h.probability >= SAID]
    rejected = tuple((h.mechanism, h.probability) for h in machine if h.probability < SAID)
    within = reach(axis, courses, before)
    as_new_names = names_of(as_new)
    remarks = (
        within.sentence(),
        *(f"{name}: {c.contradiction}" for name, c in zip(names, courses, strict=True) if c.contradiction),
        *contradictions(machine, names),
        *unlike_recordings_as_new(courses, before, names),
        *copied,
        *told,
        ADVICE,
        *(f"Sound as new, {name}: {fault.explanation}"
          for name, course in zip(as_new_names, before, strict=True) for fault in recording_faults(course)),
        *(() if as_new else (COMPARE,)),
    )  # fmt: skip
    left = _left(courses, before, named=bool(found))
    heard = tuple(discounted(with_recordings(h, names), left) for h in found)
    following = _next(heard, courses)
    return AcousticResult(
        heard, rejected, remarks, following, courses, within.examined, within.not_examined, names, before, left
    )


def _left(courses: Sequence[Course], as_new: Sequence[Course], *, named: bool) -> Unexplained | None:
    """What is left most in any recording and was not as new; what comes and goes is that of a cause if `named`."""
    before = [one.numbers["frequency_hz"] for one in map(left_in, as_new) if one is not None]
    rest = [one for one in map(left_in, courses) if one is not None and not (named and one.kind == "time")]
    new = [u for u in rest if all(abs(u.numbers["frequency_hz"] / was - 1.0) > SAME_PITCH for was in before)]
    return max(new, key=lambda u: u.score, default=None)


def discounted(heard: AcousticFinding, left: Unexplained | None) -> AcousticFinding:
    """A finding of the axis: no surer than a weak one, where something without a name is left."""
    if left is None or kind_or_any(heard.mechanism).traits.of_the_recording:
        return heard
    return replace(heard, probability=min(heard.probability, WEAK))


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


def _faults(courses: Sequence[Course]) -> list[AcousticFinding]:
    """Faults of the recordings, each as it is in the first that has it."""
    each = [{f.mechanism: f for f in recording_faults(c)} for c in courses]
    first = {name: fault for faults in reversed(each) for name, fault in faults.items()}
    return [replace(f, p_values=tuple(0.0 if n in faults else 1.0 for faults in each)) for n, f in first.items()]


def not_named_yet(
    named: Sequence[str], heard: Sequence[AcousticFinding], load_encoder: bool
) -> tuple[AcousticFinding, ...]:
    """What sound adds to mechanisms that telemetry has named: no name twice, and no gear fault against an encoder.

    With a load encoder telemetry shows damaged teeth and play below what can be heard; without one, sound may name
    them where telemetry found nothing else that it could have taken for them.
    """
    blind = not load_encoder and not set(named)
    return tuple(h for h in heard if h.mechanism not in named and (blind or not _loses_contact(h)))


def _loses_contact(h: AcousticFinding) -> bool:
    return kind_or_any(h.mechanism).traits.loses_contact


def _next(heard: Sequence[AcousticFinding], courses: Sequence[Course]) -> str:
    named = {h.mechanism for h in heard}
    for kind in FIRST_TO_MEND:
        if kind.sound and kind.name in named:
            return kind.sound.then
    if not any(course.repeats and len(course.cruises) >= LEAST_CRUISES for course in courses):
        return (
            "Move back and forth between the same two positions at constant speed, five times or more, and record that."
        )
    if ElectricalHum.sound and ElectricalHum.name in named:
        return ElectricalHum.sound.then
    return (
        "Record motor torque and angle with the sound, best with an encoder at the load: most causes cannot be heard."
    )
