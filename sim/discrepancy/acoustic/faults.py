"""From impacts and lines to names: damaged tooth, play, bearing; one or several recordings of one axis."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from casebase.signals.band import Band
from casebase.signals.motion import HOP_HZ
from sim.description.axis import Axis
from sim.discrepancy.acoustic.evidence import AcousticFinding, log_ratio, probability
from sim.discrepancy.acoustic.gear_harmonics import TURNS_TAIL, Turns, hits_of_turns
from sim.discrepancy.acoustic.impacts import (
    Bump,
    Tail,
    notch_bump,
    notch_hindrance,
    play_bump,
    play_hindrance,
    single_strokes,
)
from sim.discrepancy.acoustic.operating_states import Course
from sim.discrepancy.acoustic.order_spectrum import bearing_family, bearing_hindrance
from sim.discrepancy.acoustic.stroke_impacts import Impacts, end_hindrance, end_of_strokes, impacts, impacts_hindrance
from sim.mechanisms import Backlash, BearingDefect, MeshError, ToothDamage
from sim.torsional.model import Array

# Scores of simulated gearboxes without the fault, of many axes, motions and microphones: 181 recordings whose motion
# repeats for the notch, 254 for play. Above `start` they fall off exponentially.
NOTCH_TAIL = Tail(start=4.0, share=0.12, scale=1.0)
PLAY_TAIL = Tail(start=0.5, share=0.10, scale=0.72)
# The same where the motion does not repeat; of 700 recordings without either fault, 325 for play.
IMPACTS_TAIL = Tail(start=12.1, share=0.05, scale=2.2)
END_TAIL = Tail(start=0.75, share=0.10, scale=0.45)
Tooth = Bump | Impacts | Turns
Sign = tuple[float, Tooth]  # p-value and what is heard
CLEAR = 2.0  # logarithm of a likelihood ratio
SHOWN = 0.05  # p-value of a recording that shows a fault
OF_AROUND = "the sound around it"
SAME_PLACE_RAD = 0.1
SAME_ORDER = 0.01
TIMING_S = 0.012  # of an impact: its rise and the grid of the fold
LEAST_VISITS = 3
VISITED = 0.7
MASKED_DB = 6.0  # a tooth that is damaged this much more is heard while braking, too


def tooth_damage(axis: Axis, courses: Sequence[Course], signs: Sequence[Sign | None]) -> list[AcousticFinding]:
    """A bump in one direction of motion at one place of the travel; or impacts, where the motion does not repeat."""
    known = [(sign, course) for sign, course in zip(signs, courses, strict=True) if sign is not None]
    if not known or not axis.stages:
        return []
    (_, best), course = min(known, key=lambda one: one[0][0])
    p_values: list[float | None] = []
    for sign, other in zip(signs, courses, strict=True):
        same = sign is None or sign[1] is best or _same_tooth(axis, (other, sign[1]), (course, best))
        p_values.append(None if sign is None else sign[0] if same else 1.0)
    numbers: dict[str, tuple[float, float, float]] = {}
    alike: tuple[str, ...] = ()
    if isinstance(best, Turns):
        stage, told = best.stage, True
        text = (
            f"While cruising, the loudness has lines at {best.count} multiples of the turns of the {stage} gear "
            f"({best.order:.3g} per turn of the motor): a damaged tooth hits once in each of them."
        )
    elif isinstance(best, Impacts):
        stage, told = _stage_of_impacts(axis, best)
        text = (
            f"{best.times_s.size} impacts stand {best.height_db:.0f} dB and more over the sound around them, which no "
            "other does: a damaged tooth that meets the mesh, unless something beside the axis knocked. Strokes cannot "
            "be laid over each other, so that its angle is not known."
        )
        alike = (MeshError.name,)
    else:
        stage, told = _stage_of(axis, course, best)
        text = (
            f"Once per cycle, in one direction of motion only, an impact stands {best.height_db:.0f} dB over what "
            f"noise would reach, {_where(course, best)}: a damaged tooth that meets the mesh on one flank."
        )
        own = place_of(axis, course, best)
        if own is not None and stage == axis.stages[-1].name:
            angle, half = own
            name = "angle_rad" if course.load is not None else "angle_from_middle_rad"
            numbers[name] = (angle, angle - half, angle + half)
            if course.load is not None:
                numbers["flank"] = (_direction(course, best),) * 3
            else:
                text += " The angle counts from the middle of the travel, positive the way the axis then moves."
    elsewhere = () if told else tuple(one.name for one in axis.stages if one.name != stage)
    text += _not_told(stage, elsewhere)
    return [
        AcousticFinding(
            ToothDamage.name,
            stage,
            probability(p_values),
            numbers,
            text,
            alike,
            elsewhere,
            tuple(p_values),
        )
    ]


def sign_of_tooth(axis: Axis, course: Course) -> Sign | None:
    """What is heard of a damaged tooth, the clearest; None where it cannot be looked for."""
    sign = _sign_of_impacts(course)
    turns = hits_of_turns(axis, course)
    if turns is None:
        return sign
    p = TURNS_TAIL.p_value(turns.score)
    return (p, turns) if sign is None or p < sign[0] else sign


def not_as_new(
    axis: Axis, signs: Sequence[tuple[Course, Sign | None]], as_new: Sequence[tuple[Course, Sign | None]]
) -> list[Sign | None]:
    """Signs of a tooth, without those that a recording from when the axis was new shows at the same place."""
    shown = [(course, sign[1]) for course, sign in as_new if sign is not None and sign[0] < SHOWN]

    def is_old(course: Course, tooth: Tooth) -> bool:
        return any(
            type(old) is type(tooth) and _same_tooth(axis, (course, tooth), (other, old)) for other, old in shown
        )

    return [(1.0, sign[1]) if sign is not None and is_old(course, sign[1]) else sign for course, sign in signs]


def _sign_of_impacts(course: Course) -> tuple[float, Bump | Impacts] | None:
    bump = notch_bump(course)
    if bump is not None:
        return NOTCH_TAIL.p_value(bump.score), bump
    found = impacts(course)
    if found is None:
        return None
    p = IMPACTS_TAIL.p_value(found.score)
    if found.like_play:
        end = end_of_strokes(course)
        if end is not None and log_ratio(END_TAIL.p_value(end.score)) > CLEAR:
            p = 1.0  # play, where it is crossed
    return p, found


def _masks(tooth: Tooth, course: Course, of_play: Bump) -> bool:
    """Whether what is heard of play may be the tooth: less high, or of a gear that hits all along strokes."""
    if isinstance(tooth, Turns):
        return not course.repeats
    return of_play.height_db < tooth.height_db - MASKED_DB


def hindrance_of_tooth(course: Course) -> str | None:
    """Why a damaged tooth cannot be looked for; None where it can."""
    return notch_hindrance(course) if impacts_hindrance(course) else None


def hindrance_of_play(course: Course) -> str | None:
    """Why play cannot be looked for; None where it can."""
    return play_hindrance(course) if course.repeats else end_hindrance(course)


def _same_tooth(axis: Axis, one: tuple[Course, Tooth], other: tuple[Course, Tooth]) -> bool:
    """Whether two signs may be of one tooth: at the same angle, where both tell it."""
    if isinstance(one[1], Turns) and isinstance(other[1], Turns):
        return one[1].stage == other[1].stage
    if not (isinstance(one[1], Bump) and isinstance(other[1], Bump)):
        return True
    return _agree(place_of(axis, one[0], one[1]), place_of(axis, other[0], other[1]))


def play(axis: Axis, courses: Sequence[Course], teeth: Sequence[Sign | None]) -> list[AcousticFinding]:
    """Impacts where braking begins, at both ends; or at the end of most strokes, where the motion does not repeat."""
    bumps = [play_bump(course) if course.repeats else end_of_strokes(course) for course in courses]
    known = [(bump, course) for bump, course in zip(bumps, courses, strict=True) if bump is not None]
    if not known or not axis.stages:
        return []
    p_values: list[float | None] = []
    for course, one, tooth in zip(courses, bumps, teeth, strict=True):
        if one is None:
            p_values.append(None)
            continue
        masked = tooth is not None and log_ratio(tooth[0]) > CLEAR and _masks(tooth[1], course, one)
        tail = PLAY_TAIL if course.repeats else END_TAIL
        p_values.append(1.0 if masked else tail.p_value(one.score))
    bump, course = min(known, key=lambda one: (PLAY_TAIL if one[1].repeats else END_TAIL).p_value(one[0].score))
    where = "At both ends of the motion" if course.repeats else "At the end of most strokes"
    text = (
        f"{where}, {-bump.offset_s:.2f} s before the standstill, where braking begins and the torque changes its sign, "
        f"an impact stands {bump.height_db:.0f} dB over {'what noise would reach' if course.repeats else OF_AROUND}: "
        "tooth flanks meet after crossing the backlash. How wide it is cannot be heard."
    )
    stage = axis.stages[-1].name
    elsewhere = tuple(one.name for one in axis.stages[:-1])
    text += _not_told(stage, elsewhere)
    return [
        AcousticFinding(
            Backlash.name, stage, probability(p_values), {}, text, elsewhere=elsewhere, p_values=tuple(p_values)
        )
    ]


def _not_told(stage: str, elsewhere: tuple[str, ...]) -> str:
    """That the place is a guess, where it is one."""
    if not elsewhere:
        return ""
    return (
        f" Where it is is not certain: {stage} and {' and '.join(elsewhere)} sound the same; {stage} is named "
        "because the last gear carries the largest torque."
    )


def bearing_defect(axis: Axis, courses: Sequence[Course], teeth: Sequence[Sign | None]) -> list[AcousticFinding]:
    """A family of lines at an order that no gear has."""
    found = [bearing_family(axis, course) for course in courses]
    known = [family for family in found if family is not None]
    if not known:
        return []
    best = min(known, key=lambda family: family.p_value)
    p_values = tuple(
        None if bearing_hindrance(axis, course)
        else family.p_value if family is not None and abs(family.order / best.order - 1.0) < SAME_ORDER
        else 1.0
        for course, family in zip(courses, found, strict=True)
    )  # fmt: skip
    text = (
        f"While cruising, lines stand at {best.order:.2f} times the speed of the motor and {best.count - 1} of its "
        "multiples: no gear of this axis has this order; a rolling bearing has."
    )
    numbers = {"order": (best.order, best.order - best.half, best.order + best.half)}
    return [AcousticFinding(BearingDefect.name, None, probability(p_values), numbers, text, p_values=p_values)]


def place_of(axis: Axis, course: Course, bump: Bump) -> tuple[float, float] | None:
    """Angle of the load at an impact and half of its 90 % interval [rad]; None where the speed is not known.

    With telemetry it is the encoder's, else it counts from the middle of the travel, positive the way of motion.
    """
    speed = course.speed
    if speed is None or course.analysis.motion.period_s is None:
        return None
    load_speed = 2.0 * math.pi * speed / axis.ratio
    half = TIMING_S * load_speed * 1.645
    if course.load is not None:
        times = impact_times(course, bump)
        angles = np.interp(times, course.load.time_s, course.load.angle_rad) if times.size else np.zeros(0)
        mean = np.exp(1j * angles).mean() if angles.size else 0.0
        return (float(np.angle(mean)) % (2.0 * math.pi), half) if abs(mean) > 0.0 else None
    quarter = 0.25 * course.analysis.motion.period_s
    after = bump.offset_s if bump.offset_s > 0.0 else bump.offset_s + 2.0 * quarter
    return load_speed * (after - quarter), half


def impact_times(course: Course, bump: Bump) -> Array:
    """Times of the impact in every stroke of its kind within the recording [s]."""
    folded = course.analysis.folded(Band.LOW)
    if folded is None:
        return np.zeros(0)
    index = np.arange(folded.centres_s.size)
    times = folded.centres_s[(index + folded.first_direction) % 2 == bump.stroke] + bump.offset_s
    return np.asarray(times[(times >= 0.0) & (times < course.analysis.duration_s)])


def _direction(course: Course, bump: Bump) -> float:
    times = impact_times(course, bump)
    signs = [c.direction for t in times for c in course.cruises if c.start_s - 0.2 <= t <= c.end_s + 0.2]
    return 1.0 if sum(signs) >= 0 else -1.0


def _agree(place: tuple[float, float] | None, own: tuple[float, float] | None) -> bool:
    if place is None or own is None:
        return place is own
    return abs((place[0] - own[0] + math.pi) % (2.0 * math.pi) - math.pi) < SAME_PLACE_RAD


def _where(course: Course, bump: Bump) -> str:
    if course.load is not None:
        return "always at the same angle of the output"
    side = "after" if bump.offset_s > 0.0 else "before"
    return f"{abs(bump.offset_s):.2f} s {side} the same standstill"


def _stage_of(axis: Axis, course: Course, bump: Bump) -> tuple[str, bool]:
    """The driven gear whose revolution spaces the impacts of one stroke, and whether that is told.

    The output gear where there is one impact; that is told where every other gear would have made more.
    """
    last = axis.stages[-1].name
    strokes = single_strokes(course)
    if course.speed is None or strokes is None:
        return last, len(axis.stages) == 1
    offsets, single = strokes
    stroke_s = offsets.size / HOP_HZ
    leaving = bump.stroke if bump.offset_s > 0.0 else 1 - bump.stroke
    # one way from end to end: after one reversal, then before the other
    since = np.concatenate([offsets[offsets > 0.0], stroke_s + offsets[offsets < 0.0]])
    height = np.concatenate([single[leaving][offsets > 0.0], single[1 - leaving][offsets < 0.0]])
    first = bump.offset_s if bump.offset_s > 0.0 else stroke_s + bump.offset_s
    turn = course.speed
    told = True
    for stage in axis.stages[:-1]:
        turn /= stage.ratio
        steps = np.arange(-60, 61)
        reached = [_highest_near(since, height, t) for t in first + steps[steps != 0] / turn]
        seen = [one for one in reached if one is not None]
        if len(seen) >= LEAST_VISITS and np.mean(np.array(seen) > 0.4 * bump.height_db) >= VISITED:
            return stage.name, True
        told = told and len(seen) >= LEAST_VISITS
    return last, told


def _stage_of_impacts(axis: Axis, found: Impacts) -> tuple[str, bool]:
    """The gear that hits as often in a stroke, and whether that is told: the output gear hardly turns once in one."""
    last = axis.stages[-1].name
    if len(axis.stages) == 1:
        return last, True
    return (last if found.of_output else axis.stages[-2].name), False


def _highest_near(offsets: Array, height: Array, at: float) -> float | None:
    near = (np.abs(offsets - at) < 0.016) & np.isfinite(height)
    return float(height[near].max()) if near.any() else None
