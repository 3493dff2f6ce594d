"""What an axis sounds of more than when it was new: teeth of one gear, or something that rings at one pitch.

Every gearbox sounds of its teeth and every housing rings, so that one recording does not tell an error of teeth or a
loose part from what is as new; two do. How loud a microphone is and where it stands drop out: lines of teeth are held
against the sound beside them, which comes the same way, and the spectrum against its own surroundings. What differs
upwards and downwards alike is another place of the microphone. A resonance stays at its frequency while the speed
changes and is silent at rest (Randall, Vibration-based Condition Monitoring, 2nd edition (2021), chapter 3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from signals.analysis import ANALYSIS_RATE_HZ
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.acoustic.evidence import AcousticFinding, Tail, log_ratio, probability
from sim.investigation.acoustic.operating_states import NO_STANDSTILL, Course, Cruise, Mask
from sim.investigation.acoustic.order_spectrum import (
    CELL,
    DESCRIBED_WITHIN,
    LEAST_AT_REST,
    LEAST_SEGMENTS,
    LEVEL_BAND_HZ,
    MULTIPLES,
    SEGMENT,
    TRANSFORM,
    cells,
    gamma_limit,
    mesh_orders,
    over_surroundings,
)
from sim.mechanisms import MeshError, StructuralResonance

NO_AS_NEW = "no recording from when the axis was new was given to compare with"
AROUND_HZ = 64.0  # wider than what an uneven speed smears a strong line over
RUNG = 0.1  # relative: so near a pitch that rings its sound lifts lines
BESIDE_HZ = 1.5  # of a line: how far the speed of one cruise may be off
BASE = 141  # cells: an octave each way, over which loudness differs by itself
PEAK_DB = 3.0
CELLS = 1.5  # half of what a line of teeth covers, and what nine in ten simulated pitches are found within
LEAST_OPEN = 0.15  # of the cells
AT_REST_DB = 4.0  # what is hardly louder while moving is none of the axis
# Scores of simulated gearboxes on two days: of 157 with teeth as new, half of them with something that rings, ten
# reach 4.5; of 66 in good order the ring of none reaches 2.5.
TEETH_TAIL = Tail(start=4.5, share=0.065, scale=1.6)
USUAL_DB = 2.5
RING_TAIL = Tail(start=USUAL_DB, scale=1.5)


@dataclass(frozen=True)
class Growth:
    """How much more something is heard than as new: decibels over all else that differs; at which stage or pitch."""

    score: float
    height_db: float
    stage: str | None = None
    frequency_hz: float = 0.0
    half_hz: float = 0.0


@dataclass(frozen=True)
class Grown:
    """What is said to have grown, and whether the teeth of no gear have, whatever the others do."""

    heard: tuple[AcousticFinding, ...]
    teeth_as_new: bool


def mesh_hindrance(axis: Axis, course: Course, as_new: Sequence[Course]) -> str | None:
    """Why errors of teeth cannot be compared; None where they can, with one recording as new at least."""
    if as_new and not mesh_orders(axis):
        return "the description gives no tooth numbers"
    return _all_of([_line_hindrance(course, one) for one in as_new])


def resonance_hindrance(course: Course, as_new: Sequence[Course]) -> str | None:
    """Why resonances cannot be compared; None where they can, with one recording as new at least."""
    return _all_of([_resonance_hindrance(course, one) for one in as_new])


def grown(axis: Axis, courses: Sequence[Course], as_new: Sequence[Course]) -> Grown:
    """Errors of teeth and resonances that recordings show more of than those as new."""
    both = [_growths(axis, course, as_new) for course in courses]
    teeth, ringing = [one for one, _ in both], [one for _, one in both]
    known = [one for one in teeth if one is not None]
    quiet = bool(known) and all(one.height_db < TEETH_TAIL.start for one in known)
    told = all(_heard_cruises(course) for course in (*courses, *as_new)) or not axis.stages
    return Grown((*_mesh_error(axis, teeth), *_resonance(ringing, told)), quiet)


def growth_curves(course: Course, as_new: Sequence[Course]) -> tuple[Array, tuple[tuple[str, Array], ...]]:
    """For a picture: frequencies [Hz], and how much louder than as new [dB] while cruising and while speed changes.

    Over the first recording as new that can be compared, without lines of teeth, as in the search.
    """
    first = next((one for one in as_new if not _resonance_hindrance(course, one)), None)
    if first is None:
        return cells(), ()
    of_teeth = _of_teeth((course, first))
    return cells(), tuple(
        (kind, np.where(of_teeth, np.nan, over)) for kind, over in _over_as_new(course, first).items()
    )


def _all_of(hindrances: Sequence[str | None]) -> str | None:
    """None where one comparison is not hindered, else all reasons."""
    told = [one for one in hindrances if one is not None]
    return (", or ".join(dict.fromkeys(told)) or NO_AS_NEW) if len(told) == len(hindrances) else None


def _heard_cruises(course: Course) -> list[Cruise]:
    return [c for c in course.cruises if c.heard and c.turns_per_s]


def _speed(cruise: Cruise) -> float:
    return cruise.turns_per_s or 0.0


def _matched(course: Course, other: Course) -> list[Cruise]:
    """Cruises at a speed that the other recording has as well."""
    speeds = np.array([_speed(c) for c in _heard_cruises(other)])
    return [c for c in _heard_cruises(course) if (np.abs(speeds / _speed(c) - 1.0) <= DESCRIBED_WITHIN).any()]


def _line_hindrance(course: Course, as_new: Course) -> str | None:
    own, before = ([_speed(c) for c in _heard_cruises(one)] for one in (course, as_new))
    for speeds, where in ((own, ""), (before, " as new")):
        if not speeds:
            return f"no tooth of this axis is heard as a line{where}, so that the speed is unknown"
    if _matched(course, as_new):
        return None
    return (
        f"the motor turned {np.median(own):.3g} times per second, and as new {np.median(before):.3g}: record the same "
        "motion"
    )


def _resonance_hindrance(course: Course, as_new: Course) -> str | None:
    for one, where in ((course, ""), (as_new, "as new ")):
        if one.moving is None:
            return f"{where}{NO_STANDSTILL}"
        if one.analysis.highest_hz < LEVEL_BAND_HZ[1]:
            return f"{where}the sample rate of {one.analysis.recording.sample_rate_hz:.0f} Hz is too low"
        if one.levels.speeding is None:
            least = LEAST_SEGMENTS * SEGMENT / ANALYSIS_RATE_HZ
            return f"{where}the speed changes for less than {least:.2g} s in all"
    if course.levels.resting is None:
        rest = LEAST_AT_REST * SEGMENT / ANALYSIS_RATE_HZ
        return f"it rests for less than {rest:.2g} s in all, so that a fan cannot be separated from the axis"
    if _searched(course, as_new).mean() < LEAST_OPEN:
        return "lines of teeth and what sounds at rest as well leave too few pitches"
    return None


def _growths(axis: Axis, course: Course, as_new: Sequence[Course]) -> tuple[Growth | None, Growth | None]:
    """Of teeth and of a pitch: lines that grow are heard at any pitch that they pass, and what rings lifts a line.

    Over the recording as new that shows the least growth.
    """
    compared = [one for one in as_new if mesh_orders(axis) and _line_hindrance(course, one) is None]
    teeth = _smallest(lambda one: _teeth_of(axis, course, one, math.nan), compared)
    audible = [one for one in as_new if _resonance_hindrance(course, one) is None]
    ringing = _smallest(lambda one: _ringing_of(course, one), audible)
    if teeth is not None and ringing is not None:
        ringing = replace(ringing, score=ringing.score - max(0.0, teeth.score - TEETH_TAIL.start))
        if log_ratio(RING_TAIL.p_value(ringing.score)) > 0.0:
            pitch = ringing.frequency_hz
            teeth = _smallest(lambda one: _teeth_of(axis, course, one, pitch), compared)
    return teeth, ringing


def _smallest(growth: Callable[[Course], Growth], as_new: Sequence[Course]) -> Growth | None:
    return min((growth(one) for one in as_new), key=lambda one: one.score, default=None)


def _mesh_error(axis: Axis, found: Sequence[Growth | None]) -> list[AcousticFinding]:
    """Lines of one gear's teeth that stand out more than as new, by more than those of the others."""
    best = max((one for one in found if one is not None), key=lambda one: one.score, default=None)
    if best is None:
        return []
    p_values = tuple(
        None if one is None else TEETH_TAIL.p_value(one.score) if one.stage == best.stage else 1.0 for one in found
    )
    times = 10.0 ** (best.height_db / 20.0)
    others = f", {best.score:.0f} dB more than those of any other gear" if len(mesh_orders(axis)) > 1 else ""
    text = (
        f"While cruising, the lines of the teeth of {best.stage} stand {best.height_db:.0f} dB ({times:.2g} times) "
        f"higher over the sound around them than as new{others}: its teeth err more."
    )
    return [AcousticFinding(MeshError.name, best.stage, probability(p_values), {}, text, p_values=p_values)]


def _resonance(found: Sequence[Growth | None], speed_told: bool) -> list[AcousticFinding]:
    """A pitch at which the sound has grown at any speed, but not at rest.

    Where the speed is not told, teeth of a steady speed may sing at it.
    """
    best = max((one for one in found if one is not None), key=lambda one: one.score, default=None)
    if best is None:
        return []
    p_values = tuple(
        None if one is None
        else RING_TAIL.p_value(one.score) if abs(one.frequency_hz - best.frequency_hz) <= best.half_hz + one.half_hz
        else 1.0
        for one in found
    )  # fmt: skip
    text = (
        f"Around {best.frequency_hz:.0f} Hz the sound stands {best.height_db:.0f} dB higher over its surroundings than "
        "as new, also while the speed changes and not at rest: something rings that did not, a cover, a bolt or a pipe "
        "that is loose."
    )
    pitch = (best.frequency_hz, best.frequency_hz - best.half_hz, best.frequency_hz + best.half_hz)
    alike = () if speed_told else (MeshError.name,)
    numbers = {"frequency_hz": pitch}
    return [
        AcousticFinding(StructuralResonance.name, None, probability(p_values), numbers, text, alike, p_values=p_values)
    ]


def _teeth_of(axis: Axis, course: Course, as_new: Course, ringing_hz: float) -> Growth:
    """The stage whose lines have grown most beyond those of the others; lines near `ringing_hz` are left out.

    Cruises at like speed are compared, each cut to the same length, as a line stands out more the longer it lasts.
    """
    groups = ((course, _matched(course, as_new)), (as_new, _matched(as_new, course)))
    length_s = float(min(np.median([c.length_s for c in cruises]) for _, cruises in groups))
    both = [_rows(one, cruises, length_s) for one, cruises in groups]
    spacing = ANALYSIS_RATE_HZ / TRANSFORM
    highest = min(LEVEL_BAND_HZ[1], course.analysis.highest_hz, as_new.analysis.highest_hz)
    floor = gamma_limit(min(len(rows) for rows in both), 2.0 * BESIDE_HZ / spacing)
    rise = []
    for order in mesh_orders(axis):
        total = np.full(2, 1e-300)
        for k in MULTIPLES:
            lines = np.array([k * order * turns for rows in both for turns, _ in rows])
            if (np.abs(lines / ringing_hz - 1.0) < RUNG).any() or lines.max() >= highest:
                continue
            for side, rows in enumerate(both):
                heights = [_at(row, k * order * turns / spacing, BESIDE_HZ / spacing) for turns, row in rows]
                total[side] += max(float(np.mean(heights)), floor)
        rise.append(10.0 * math.log10(total[0] / total[1]))
    names = [stage.name for stage in axis.stages if stage.driver_teeth is not None]
    place = int(np.argmax(rise))
    others = float(np.delete(rise, place).max(initial=0.0))
    return Growth(rise[place] - others, rise[place], names[place])


def _rows(course: Course, cruises: Sequence[Cruise], length_s: float) -> list[tuple[float, Array]]:
    """Speed of the motor [1/s] and spectrum over its surroundings (m,) of all cruises that last so long, cut to it."""
    count = round(length_s * ANALYSIS_RATE_HZ)
    long = [c for c in cruises if c.length_s >= length_s * (1.0 - 1e-9)]
    cut = [(_speed(c), c.cut(course.analysis.samples)[:count]) for c in long]
    return [(turns, over_surroundings(part, ANALYSIS_RATE_HZ, AROUND_HZ)) for turns, part in cut]


def _at(row: Array, place: float, within: float) -> float:
    first = max(0, math.floor(place - within))
    return float(row[first : math.ceil(place + within) + 1].max(initial=1.0))


def _ringing_of(course: Course, as_new: Course) -> Growth:
    """The pitch at which the sound has grown most, beyond what has fallen elsewhere."""
    centres, searched, of_teeth = cells(), _searched(course, as_new), _of_teeth((course, as_new))
    over = np.array(list(_over_as_new(course, as_new).values()))
    up = np.where(searched, over.min(axis=0), -np.inf)
    down = np.where(of_teeth, -np.inf, -over.max(axis=0))
    peak = int(np.argmax(up))
    height = float(up[peak])
    low = np.flatnonzero(up <= height - PEAK_DB)
    near = slice(low[low < peak].max(initial=-1) + 1, low[low > peak].min(initial=up.size))
    weight = 10.0 ** (up[near] / 10.0)
    frequency = float((weight * centres[near]).sum() / weight.sum())
    half = max(0.5 * ANALYSIS_RATE_HZ / SEGMENT, CELLS * CELL * frequency)
    apart = np.abs(np.arange(centres.size) - peak)
    other = float(down[apart > BASE // 2].max(initial=0.0))  # beside its peak a mode cancels others
    return Growth(height - other, height, None, frequency, half)


def _over_as_new(course: Course, as_new: Course) -> dict[str, Array]:
    """How much louder than as new each pitch is, over its surroundings [dB], while cruising and at changing speed."""
    now, then = course.levels, as_new.levels
    pairs = {
        "while cruising": (now.cruising, then.cruising),
        "while the speed changes": (now.speeding, then.speeding),
    }
    return {kind: _over_base(a - b) for kind, (a, b) in pairs.items() if a is not None and b is not None}


def _searched(course: Course, as_new: Course) -> Mask:
    """Cells without lines of teeth in which it is louder while moving than at rest."""
    moving, rest = course.levels.speeding, course.levels.resting
    louder = np.ones(cells().size, np.bool_) if moving is None or rest is None else moving - rest >= AT_REST_DB
    return np.asarray(louder & ~_of_teeth((course, as_new)))


def _of_teeth(courses: Sequence[Course]) -> Mask:
    """Which cells hold lines of teeth at a speed that is heard: a speed that changes moves them."""
    speeds = np.unique([round(_speed(c), 3) for course in courses for c in _heard_cruises(course)])
    lines = (np.outer(MULTIPLES, courses[0].mesh_orders)[:, :, None] * speeds).ravel()
    within = CELLS * CELL * lines + ANALYSIS_RATE_HZ / SEGMENT
    return np.asarray((np.abs(cells()[:, None] - lines) < within).any(axis=1))


def _over_base(level_db: Array) -> Array:
    return np.asarray(level_db - median_filter(level_db, BASE, mode="nearest"))
