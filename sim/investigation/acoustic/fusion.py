"""What sound says of an axis: alone, beside telemetry, or as several recordings of the same axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from signals.recording import Recording
from sim.description.axis import Axis
from sim.investigation.acoustic.baseline_comparison import (
    Grown,
    grown,
    mesh_hindrance,
    resonance_hindrance,
)
from sim.investigation.acoustic.bearing import bearing_hindrance
from sim.investigation.acoustic.evidence import REPORTED, AcousticFinding, AcousticResult, log_ratio, probability
from sim.investigation.acoustic.faults import SHOWN, bearing_defect, tooth_and_play, tooth_hindrance
from sim.investigation.acoustic.operating_states import LEAST_CRUISES, Course, course_of
from sim.investigation.acoustic.recording_quality import recording_faults, recording_hindrances
from sim.investigation.acoustic.residual import left_in
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.unexplained import Unexplained
from sim.mechanisms import (
    MECHANISMS,
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

PLACES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")


def names_of(sounds: Sequence[Recording]) -> tuple[str, ...]:
    """What to call each recording: by its name where all have one of their own, else by its place."""
    own = tuple(sound.name for sound in sounds)
    if all(own) and len(set(own)) == len(own):
        return own
    return tuple(f"the {PLACES[i]}" if i < len(PLACES) else f"number {i + 1}" for i in range(len(sounds)))


def without_copies(sounds: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """Every recording once, and a remark where one was given more than once: that is no more evidence."""
    kept = tuple({sound.sha256: sound for sound in reversed(sounds)}.values())[::-1]
    if len(kept) == len(sounds):
        return kept, ()
    return kept, (f"Copies count once: {len(kept)} of {len(sounds)} recordings are left.",)


def with_recordings(heard: AcousticFinding, names: Sequence[str]) -> AcousticFinding:
    """Say in which recordings the evidence of a finding is, where there are several."""
    if len(names) < 2:
        return heard
    known = list(zip(names, heard.p_values, strict=True))
    shown = [name for name, p in known if p is not None and p < SHOWN]
    silent = [name for name, p in known if p is not None and p >= SHOWN]
    closed = [name for name, p in known if p is None]
    said = f"Heard in {len(shown)} of {len(names)} recordings{': ' if shown else ''}{_listed(shown)}."
    said += f" Not heard in {_listed(silent)}." if silent else ""
    said += f" Could not be looked for in {_listed(closed)}." if closed else ""
    return replace(heard, explanation=f"{heard.explanation} {said}")


def contradictions(machine: Sequence[AcousticFinding], names: Sequence[str]) -> tuple[str, ...]:
    """Where one recording by itself would name a fault and another speaks against it."""
    out = []
    for heard in machine:
        alone = [name for name, p in zip(names, heard.p_values, strict=True)
                 if p is not None and probability([p]) >= REPORTED]  # fmt: skip
        against = [name for name, p in zip(names, heard.p_values, strict=True) if p is not None and log_ratio(p) < 0.0]
        if alone and against:
            taken = "" if heard.probability >= REPORTED else ", and all together do not name it"
            out.append(
                f"The recordings contradict each other: {WORDS[heard.mechanism]} would be named by {_listed(alone)} "
                f"alone, but is not heard in {_listed(against)}{taken}. If they are of different axes, or of before "
                "and after a repair, investigate them one by one."
            )
    return tuple(out)


def _listed(names: Sequence[str]) -> str:
    return " and ".join([part for part in (", ".join(names[:-1]), *names[-1:]) if part])


HEARD = (
    ElectricalHum, Clipping, LostSamples, ToothDamage, Backlash, BearingDefect, MeshError, StructuralResonance,
)  # fmt: skip
"""What sound alone can show."""

WORDS: Mapping[str, str] = {kind.name: kind.sound.name for kind in HEARD if kind.sound}

NO_GEAR = "the axis has no gear"
UNTOLD = "sound alone does not show it"


@dataclass(frozen=True)
class Reach:
    """`examined` in one recording at least; `not_examined`: to the reason."""

    examined: tuple[str, ...]
    not_examined: Mapping[str, str]

    def sentence(self) -> str:
        """Both in words, as the first remark.

        >>> Reach(("clipping",), {"backlash": "no standstill is heard"}).sentence()[:67]
        'Examined: clipping. Not examined: backlash, because no standstill i'
        """
        examined = ", ".join(WORDS[name] for name in self.examined)
        together: dict[str, list[str]] = {}
        for name, reason in self.not_examined.items():
            if name in WORDS:
                together.setdefault(reason, []).append(WORDS[name])
        parts = [f"{', '.join(names)}, because {reason}" for reason, names in together.items()]
        parts.append("friction, stiffness, loads, runout, offsets and delays, because sound does not show them")
        return f"Examined: {examined or 'nothing'}. Not examined: {'; '.join(parts)}."


def reach(axis: Axis, courses: Sequence[Course], as_new: Sequence[Course] = ()) -> Reach:
    """What all recordings together let be looked for, with those from when the axis was new."""
    each = [_hindrances(axis, course, as_new) for course in courses]
    examined = tuple(name for name in WORDS if not all(name in hindrances for hindrances in each))
    hindered = {
        name: ", or ".join(dict.fromkeys(hindrances[name] for hindrances in each))
        for name in WORDS
        if name not in examined
    }
    rest = {name: UNTOLD for name in sorted(MECHANISMS) if name not in WORDS}
    return Reach(examined, {**hindered, **rest})


def _hindrances(axis: Axis, course: Course, as_new: Sequence[Course]) -> dict[str, str]:
    of_gear = tooth_hindrance(course) if axis.stages else NO_GEAR
    of_machine = {
        ToothDamage.name: of_gear,
        Backlash.name: of_gear,
        BearingDefect.name: bearing_hindrance(axis, course),
        MeshError.name: mesh_hindrance(axis, course, as_new) if axis.stages else NO_GEAR,
        StructuralResonance.name: resonance_hindrance(course, as_new),
    }
    told = {name: reason for name, reason in of_machine.items() if reason is not None}
    return {**recording_hindrances(course), **told}


SURE = 0.9  # of what telemetry does not show, though it could
WEAK = 0.85  # of a finding beside something without a name
SAME_PITCH = 0.03  # relative
FIRST_TO_MEND = (Clipping, LostSamples, ToothDamage, Backlash, StructuralResonance, MeshError, BearingDefect)
ADVICE = (
    "How deep tooth damage or how wide backlash is cannot be heard. Telemetry shows that, and what was not examined."
)
COMPARE = (
    "Give a recording of the same motion from when the axis was new as well, if there is one: it shows whether teeth "
    "are louder than as new and whether something rings."
)


def sound_with_telemetry(
    axis: Axis, sound: Recording, measurement: Measurement | None, offset_s: float
) -> tuple[tuple[AcousticFinding, ...], Unexplained | None]:
    """Findings of one recording, and what is left of it; with telemetry, speed and reversals are the measured ones."""
    if measurement is None:
        alone = sound_alone(axis, [sound])
        return alone.heard, alone.left
    course = course_of(axis, sound, measurement, offset_s)
    machine = [h for h in tooth_and_play(axis, [course]) if h.probability >= SURE]
    bearing = [h for h in bearing_defect(axis, [course]) if h.probability >= REPORTED]
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
    machine, told = _explained_by_growth(machine, grown(axis, courses, before))
    found = [h for h in (*machine, *_faults(courses)) if h.probability >= REPORTED]
    rejected = tuple((h.mechanism, h.probability) for h in machine if h.probability < REPORTED)
    within = reach(axis, courses, before)
    as_new_names = names_of(as_new)
    remarks = (
        within.sentence(),
        *contradictions(machine, names),
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


def _explained_by_growth(
    machine: Sequence[AcousticFinding], growth: Grown
) -> tuple[list[AcousticFinding], tuple[str, ...]]:
    """Teeth that have all grown louder make impacts of their own; where none have, impacts are none of theirs.

    What was heard of impacts is then said with the teeth that err: sound does not tell one from the other.
    """
    if growth.teeth_as_new:
        machine = [replace(h, indistinguishable_from=()) for h in machine]
    erring = next((h for h in growth.heard if h.mechanism == MeshError.name and h.probability >= REPORTED), None)
    struck = [h.mechanism for h in machine if _loses_contact(h) and h.probability >= REPORTED]
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
