"""From impacts and lines to names: damaged tooth, play, bearing; one or several recordings of one axis."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.signal import find_peaks
from scipy.stats import trim_mean

from signals.analysis import Analysis
from signals.band import Band
from signals.half_cycles import SMOOTH_S, TOLERANCE, HalfCycles, average_half_cycles
from signals.motion import HOP_HZ
from signals.spectra import BandEnvelope, band_envelope
from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.acoustic.bearing import TURNS_TAIL, bearing_family, bearing_hindrance, turns_of_tooth
from sim.investigation.acoustic.evidence import AcousticFinding, Tail, log_ratio, probability
from sim.investigation.acoustic.operating_states import LEAST_CRUISES, NO_STANDSTILL, Course
from sim.mechanisms import Backlash, BearingDefect, MeshError, ToothDamage

TEETH_BAND_HZ = (40.0, 100.0, 8.0)  # low, high, whitening: above arm and servo, below the housing
APART_S = 0.06  # an impact is over by then
RAMP_S = 0.05  # the speed is not yet steady when the loudness is
AROUND_S = 1.0  # what an impact stands out of, where strokes do not repeat
MOST = 24  # impacts of a damaged tooth there
END_S = 0.8  # of a stroke, at least: where it brakes or starts


@dataclass(frozen=True, eq=False)
class Bump:
    """The strongest candidate: score and height [dB], offset from the reversal [s], which stroke (0, 1).

    `times_s` (k,): of impacts that do not repeat, empty of a average_half_cycles.
    """

    score: float
    height_db: float
    offset_s: float = 0.0
    stroke: int = 0
    times_s: Array | None = None


def tooth_hindrance(course: Course) -> str | None:
    """Why a damaged tooth, and play, cannot be looked for; None where they can."""
    analysis, count = course.analysis, len(course.analysis.motion.reversal_times_s)
    if count == 0:
        return NO_STANDSTILL
    if analysis.envelope(Band.LOW) is None or _teeth_band(analysis) is None:
        return f"the sample rate of {analysis.recording.sample_rate_hz:.0f} Hz is too low"
    return None if count >= LEAST_CRUISES else f"{LEAST_CRUISES} standstills are needed and {count} heard"


def notch_bump(course: Course) -> Bump | None:
    """A bump in one direction of motion while cruising; None where the motion does not repeat."""
    folded = course.analysis.folded(Band.LOW)
    if folded is None or not course.repeats or not _complete(folded):
        return None
    start, end = course.analysis.motion.slow_s
    cruising = (folded.offset_s < start - RAMP_S) | (folded.offset_s > end + RAMP_S)
    if not cruising.any():
        return None
    strokes = np.stack([folded.forward_db, folded.backward_db])
    other = _widened(strokes[::-1])
    single = np.where(cruising, strokes - np.maximum(other, np.median(other, axis=1, keepdims=True)), -np.inf)
    stroke, place = (int(i) for i in np.unravel_index(int(np.argmax(single)), single.shape))
    height = float(single[stroke, place])
    # after one end and before the other the axis moves the same way
    way = np.stack([folded.offset_s < 0, folded.offset_s > 0])
    rest = float(np.where(way != way[stroke, place], single, -np.inf).max())
    return Bump(2.0 * height - max(rest, 0.0), height, _middle(strokes[stroke], folded, place), stroke)


def play_bump(course: Course) -> Bump | None:
    """A bump at both ends of the motion where braking begins, for there the torque changes its sign."""
    analysis = course.analysis
    low, teeth = analysis.folded(Band.LOW), _teeth_band(analysis)
    if low is None or teeth is None or not _complete(low):
        return None
    folded = average_half_cycles(
        teeth.smoothed(SMOOTH_S, HOP_HZ), analysis.motion, 2 * 1.5 * SMOOTH_S * teeth.bandwidth_hz
    )
    braking = low.in_zone & ~low.in_quiet & (low.offset_s < 0.0)
    if folded is None or not braking.any():
        return None
    both = 0.5 * (_widened(_both(low)) + _widened(_both(folded)))
    place = int(np.argmax(np.where(braking, both, -np.inf)))
    offset, height = float(low.offset_s[place]), float(both[place])
    rest = float(np.where(~low.in_quiet & (np.abs(low.offset_s - offset) > APART_S), both, -np.inf).max())
    return Bump(height - max(rest, 0.0), height, offset)


def impacts(course: Course) -> Bump | None:
    """Three impacts or more that stand out of the sound and of all others; None where none can be looked for."""
    if tooth_hindrance(course):
        return None
    over = over_around(course.analysis.envelope(Band.LOW))
    peaks, _ = find_peaks(over, height=0.0, distance=HOP_HZ / 4.0)
    peaks = peaks[np.argsort(-over[peaks], kind="stable")]
    counts = np.arange(LEAST_CRUISES, min(MOST, peaks.size - 1) + 1)
    if counts.size == 0:
        return Bump(0.0, 0.0, times_s=np.zeros(0))
    scores = 2.0 * over[peaks[counts - 1]] - over[peaks[counts]]
    count = int(counts[np.argmax(scores)])
    times: Array = np.sort((peaks[:count] + 0.5) / HOP_HZ)
    return Bump(float(scores.max()), float(over[peaks[count - 1]]), times_s=times)


def end_of_half_cycles(course: Course) -> Bump | None:
    """How much louder strokes end than they begin and go on, the middle of all; None where too few are heard."""
    low, teeth, motion = course.analysis.envelope(Band.LOW), _teeth_band(course.analysis), course.analysis.motion
    if low is None or teeth is None:
        return None
    over = np.asarray(0.5 * (_widened(over_around(low)) + _widened(over_around(teeth))))
    time: Array = (np.arange(over.size, dtype=np.float64) + 0.5) / HOP_HZ
    before, after = min(motion.reversal_zone_s[0], -END_S), max(motion.reversal_zone_s[1], END_S)
    found = []
    for left, right in itertools.pairwise(motion.reversal_times_s):
        half = 0.5 * (left + right)
        start = over[(time > left + motion.quiet_s[1]) & (time <= min(left + after, half))]
        middle = over[(time > left + after) & (time < right + before)]
        end = (time >= max(right + before, half)) & (time < right + motion.quiet_s[0])
        if start.size and end.any():
            usual = float(np.median(maximum_filter1d(middle, start.size))) if middle.size > start.size else -np.inf
            high = float(over[end].max())
            found.append((high - max(float(start.max()), usual), high, float(time[end][np.argmax(over[end])]) - right))
    if len(found) < LEAST_CRUISES:
        return None
    louder, height, offset = zip(*found, strict=True)
    return Bump(float(trim_mean(louder, 0.25)), float(np.median(height)), float(np.median(offset)))


def over_around(envelope: BandEnvelope | None) -> Array:
    """How far a band stands over its own median of the second around [dB], `HOP_HZ` values per second."""
    if envelope is None:
        return np.zeros(0)
    level = 10.0 * np.log10(envelope.smoothed(SMOOTH_S, HOP_HZ).astype(np.float64))
    return np.asarray(level - median_filter(level, int(AROUND_S * HOP_HZ) | 1, mode="nearest"))


def _teeth_band(analysis: Analysis) -> BandEnvelope | None:
    return band_envelope(analysis.spectrum, *TEETH_BAND_HZ) if TEETH_BAND_HZ[1] < analysis.highest_hz else None


def _both(folded: HalfCycles) -> Array:
    return np.asarray(np.maximum(np.minimum(folded.forward_db, _widened(folded.backward_db)), -6.0))


def _complete(folded: HalfCycles) -> bool:
    return bool(np.isfinite(folded.forward_db).all() and np.isfinite(folded.backward_db).all())


def _widened(height_db: Array) -> Array:
    """Let every height hold within the tolerance of the motion, too, along the last axis."""
    return np.asarray(maximum_filter1d(height_db, 2 * TOLERANCE + 1, axis=-1))


def _middle(height_db: Array, folded: HalfCycles, place: int) -> float:
    """Middle of the plateau that the tolerance makes of a peak [s]."""
    near = np.flatnonzero(height_db >= height_db[place] - 1e-9)
    near = near[np.abs(near - place) <= 2 * TOLERANCE]
    return float(folded.offset_s[near].mean()) + 0.5 / HOP_HZ


# Scores of simulated gearboxes without the fault, of many axes, motions and microphones: 181 recordings whose motion
# repeats for the notch, 254 for play. Above `start` they fall off exponentially.
NOTCH_TAIL = Tail(start=4.0, share=0.12, scale=1.0)
PLAY_TAIL = Tail(start=0.5, share=0.10, scale=0.72)
# The same where the motion does not repeat; of 700 recordings without either fault, 325 for play.
IMPACTS_TAIL = Tail(start=12.1, scale=2.2)
END_TAIL = Tail(start=0.75, share=0.10, scale=0.45)
CLEAR = 2.0  # logarithm of a likelihood ratio
SHOWN = 0.05  # p-value of a recording that shows a fault
SAME_PLACE_RAD = 0.1
SAME_ORDER = 0.01
TIMING_S = 0.02  # half of the 90 % interval of an impact: its rise and the grid of the fold
MASKED_DB = 6.0  # a tooth that is damaged this much more is heard while braking, too


@dataclass(frozen=True)
class Sign:
    """What one recording shows of a fault, with its p-value and height [dB] over all else.

    `stage`: None where it is not told; `place`: angle from the middle of the travel and half of its 90 % interval
    [rad]; `alike`: mechanisms that sound the same.
    """

    p_value: float
    height_db: float
    text: str
    stage: str | None = None
    place: tuple[float, float] | None = None
    alike: tuple[str, ...] = ()


def sign_of_tooth(axis: Axis, course: Course) -> Sign | None:
    """What is heard of a damaged tooth, the clearest; None where it cannot be looked for."""
    if not axis.stages:
        return None
    only = axis.stages[0].name if len(axis.stages) == 1 else None
    found = []
    if (turns := turns_of_tooth(axis, course)) is not None:
        text = (
            f"While cruising, the loudness has lines at all multiples of the turns of the {turns.stage} gear "
            f"({turns.order:.3g} per turn of the motor): a damaged tooth hits once in each of them."
        )
        found.append(Sign(TURNS_TAIL.p_value(turns.score), math.inf, text, turns.stage))
        if log_ratio(found[0].p_value) > CLEAR:  # it alone tells the gear
            return found[0]
    if (bump := notch_bump(course)) is not None:
        text = (
            f"Once per cycle, in one direction of motion only, an impact stands {bump.height_db:.0f} dB over what "
            f"noise would reach, {_when(bump)} the same standstill: a damaged tooth that meets the mesh on one flank."
        )
        found.append(Sign(NOTCH_TAIL.p_value(bump.score), bump.height_db, text, only, place_of(axis, course, bump)))
    elif (bump := impacts(course)) is not None and bump.times_s is not None:
        text = (
            f"{bump.times_s.size} impacts stand {bump.height_db:.0f} dB and more over the sound around them, which no "
            "other does: a damaged tooth that meets the mesh, unless something beside the axis knocked. The motion "
            "does not repeat, so its angle is not known."
        )
        end = end_of_half_cycles(course)
        played = end is not None and log_ratio(END_TAIL.p_value(end.score)) > CLEAR
        p_value = 1.0 if played else IMPACTS_TAIL.p_value(bump.score)
        found.append(Sign(p_value, bump.height_db, text, only, None, (MeshError.name,)))
    return min(found, key=lambda one: one.p_value, default=None)


def sign_of_play(axis: Axis, course: Course, tooth: Sign | None) -> Sign | None:
    """What is heard of play; None where it cannot be looked for. A tooth that is damaged much more may sound so."""
    bump = play_bump(course) if course.repeats else end_of_half_cycles(course)
    if bump is None or not axis.stages:
        return None
    where = "At both ends of the motion" if course.repeats else "At the end of most strokes"
    text = (
        f"{where}, {_when(bump)} the standstill, where braking begins and the torque changes its sign, an impact "
        f"stands {bump.height_db:.0f} dB over {'what noise would reach' if course.repeats else 'the sound around it'}: "
        "tooth flanks meet after crossing the backlash. How wide it is cannot be heard."
    )
    masked = tooth is not None and log_ratio(tooth.p_value) > CLEAR and bump.height_db < tooth.height_db - MASKED_DB
    p_value = (PLAY_TAIL if course.repeats else END_TAIL).p_value(bump.score)
    only = axis.stages[0].name if len(axis.stages) == 1 else None
    return Sign(1.0 if masked else p_value, bump.height_db, text, only)


def not_as_new(signs: Sequence[Sign | None], as_new: Sequence[Sign | None]) -> list[Sign | None]:
    """Signs, without those that a recording from when the axis was new shows at the same place."""
    old = [one for one in as_new if one is not None and one.p_value < SHOWN]
    return [one and replace(one, p_value=1.0) if any(_same(one, other) for other in old) else one for one in signs]


def finding_of_signs(axis: Axis, mechanism: str, signs: Sequence[Sign | None]) -> list[AcousticFinding]:
    """One finding of what recordings show at the same place as the clearest of them; none where none could show it."""
    best = min((one for one in signs if one is not None), key=lambda one: one.p_value, default=None)
    if best is None:
        return []
    p_values = tuple(None if one is None else one.p_value if _same(one, best) else 1.0 for one in signs)
    stage = best.stage or axis.stages[-1].name
    elsewhere = () if best.stage else tuple(one.name for one in axis.stages if one.name != stage)
    text = best.text
    if elsewhere:
        text += (
            f" Where it is is not certain: {stage} and {' and '.join(elsewhere)} sound the same; {stage} is named "
            "because the last gear carries the largest torque."
        )
    numbers = {}
    if best.place is not None:
        angle, half = best.place
        numbers["angle_from_middle_rad"] = (angle, angle - half, angle + half)
        text += " The angle counts from the middle of the travel, positive the way the axis then moves."
    return [AcousticFinding(mechanism, stage, probability(p_values), numbers, text, best.alike, elsewhere, p_values)]


def tooth_and_play(axis: Axis, courses: Sequence[Course], as_new: Sequence[Course] = ()) -> list[AcousticFinding]:
    """A damaged tooth and play, but for what recordings as new show as well."""
    teeth, before = ([sign_of_tooth(axis, one) for one in group] for group in (courses, as_new))
    play, played = (
        [sign_of_play(axis, course, tooth) for course, tooth in zip(group, signs, strict=True)]
        for group, signs in ((courses, teeth), (as_new, before))
    )
    return [
        *finding_of_signs(axis, ToothDamage.name, not_as_new(teeth, before)),
        *finding_of_signs(axis, Backlash.name, not_as_new(play, played)),
    ]


def bearing_defect(axis: Axis, courses: Sequence[Course]) -> list[AcousticFinding]:
    """A family of lines at an order that no gear has."""
    found = [bearing_family(axis, course) for course in courses]
    best = min((family for family in found if family is not None), key=lambda family: family.p_value, default=None)
    if best is None:
        return []
    p_values = tuple(
        None if course.measured is None and bearing_hindrance(axis, course)
        else family.p_value if family is not None and abs(family.order / best.order - 1.0) < SAME_ORDER
        else 1.0
        for course, family in zip(courses, found, strict=True)
    )  # fmt: skip
    text = (
        f"Impacts come {best.order:.2f} times per turn of the motor, with {best.count - 1} multiples and a little "
        "slip: no gear of this axis has this order; a rolling bearing has."
    )
    numbers = {"order": (best.order, best.order - best.half, best.order + best.half)}
    return [AcousticFinding(BearingDefect.name, None, probability(p_values), numbers, text, p_values=p_values)]


def place_of(axis: Axis, course: Course, bump: Bump) -> tuple[float, float] | None:
    """Angle of the load at an impact from the middle of the travel, positive the way of motion, and half of its 90 %
    interval [rad]; None where the speed is not known, or another gear may turn round."""
    if course.speed is None or course.analysis.motion.period_s is None:
        return None
    load_speed = 2.0 * math.pi * course.speed / axis.ratio
    quarter = 0.25 * course.analysis.motion.period_s
    after = bump.offset_s if bump.offset_s > 0.0 else bump.offset_s + 2.0 * quarter
    return load_speed * (after - quarter), TIMING_S * load_speed


def _when(bump: Bump) -> str:
    return f"{abs(bump.offset_s):.2f} s {'after' if bump.offset_s > 0.0 else 'before'}"


def _same(one: Sign | None, other: Sign) -> bool:
    """Whether two signs may be of one fault: of the same gear and at the same angle, where both tell it."""
    if one is None or (one.stage and other.stage and one.stage != other.stage):
        return False
    return one.place is None or other.place is None or abs(one.place[0] - other.place[0]) < SAME_PLACE_RAD
