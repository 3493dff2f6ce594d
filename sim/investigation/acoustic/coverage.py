"""What recordings without telemetry let be looked for, what not, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sim.description.axis import Axis
from sim.investigation.acoustic.baseline_comparison import hindrance_of_ringing, hindrance_of_teeth
from sim.investigation.acoustic.bearing import bearing_hindrance
from sim.investigation.acoustic.impacts import tooth_hindrance
from sim.investigation.acoustic.operating_states import Course
from sim.investigation.acoustic.recording_quality import recording_hindrances
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
        MeshError.name: hindrance_of_teeth(axis, course, as_new) if axis.stages else NO_GEAR,
        StructuralResonance.name: hindrance_of_ringing(course, as_new),
    }
    told = {name: reason for name, reason in of_machine.items() if reason is not None}
    return {**recording_hindrances(course), **told}
