"""What an axis sounds of more than when it was new: teeth of one gear, or something that rings at one pitch.

Every gearbox sounds of its teeth and every housing rings, so that one recording does not tell an error of teeth or a
loose part from what is as new; two do. How loud a microphone is and where it stands drop out: lines of teeth are held
against the sound beside them, which comes the same way, and the spectrum against its own surroundings. What differs
upwards and downwards alike is another place of the microphone. A resonance stays at its frequency while the speed
changes and is silent at rest (Randall, Vibration-based Condition Monitoring, 2nd edition (2021), chapter 3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import ShortTimeFFT

from casebase.signals.analysis import ANALYSIS_RATE_HZ
from sim.axis import Axis
from sim.chain_model import Array
from sim.discrepancy.sound_course import Course, Mask
from sim.discrepancy.sound_evidence import Heard, log_ratio, probability
from sim.discrepancy.sound_impacts import NO_STANDSTILL, Tail
from sim.discrepancy.sound_lines import TRANSFORM, gamma_limit, mesh_orders, over_surroundings

NO_AS_NEW = "no recording from when the axis was new was given to compare with"
SAME_SPEED = 0.15  # relative: at another speed teeth excite the housing at other frequencies
AROUND_HZ = 64.0  # wider than what an uneven speed smears a strong line over
MULTIPLES = (1, 2, 3)
HIGHEST_HZ = 3_600.0
RUNG = 0.1  # relative: so near a pitch that rings its sound lifts lines
BESIDE_HZ = 1.5  # of a line: how far the speed of one cruise may be off
SEGMENT = 1_024  # 0.13 s: shorter than what a motion takes to reach its speed
LEAST_SEGMENTS = 12
LOWEST_HZ = 150.0
CELL = 0.01  # relative: half as wide as a mode of little damping
BASE = 141  # cells: an octave each way, over which loudness differs by itself
LINE_CELLS = 1.5  # half of what a line of teeth covers
AT_REST_DB = 4.0  # what is hardly louder while moving is none of the axis
ALIKE = 0.7  # correlation; simulated recordings of one gearbox in good order have 0.88 and more
# Scores of simulated gearboxes on two days: of 157 with teeth as new, half of them with something that rings, eight
# reach 4.5; of 79 in good order the ring of none reaches 2.5.
TEETH_TAIL = Tail(start=4.5, share=0.05, scale=2.0)
USUAL_DB = 2.5
RING_TAIL = Tail(start=USUAL_DB, share=0.05, scale=1.5)
Row = tuple[float, float, Array]  # speed of the motor [1/s], length [s], spectrum over its surroundings (m,)


@dataclass(frozen=True)
class Growth:
    """How much more something is heard than as new: decibels over all else that differs; at which stage or pitch."""

    score: float
    height_db: float
    stage: str | None = None
    frequency_hz: float = 0.0
    half_hz: float = 0.0


def hindrance_of_teeth(axis: Axis, course: Course, as_new: Sequence[Course]) -> str | None:
    """Why errors of teeth cannot be compared; None where they can."""
    if not as_new:
        return NO_AS_NEW
    if not mesh_orders(axis):
        return "the description gives no tooth numbers"
    own, *before = ([c.turns_per_s for c in one.cruises if c.turns_per_s is not None] for one in (course, *as_new))
    if not own or not any(before):
        return "no tooth of this axis is heard as a line in one of the recordings, so that the speed is unknown"
    if not any(_alike(v, w) for v in own for speeds in before for w in speeds):
        told = ", ".join(f"{np.median(speeds):.3g}" for speeds in before if speeds)
        return f"the motor turned {np.median(own):.3g} times per second, and as new {told}: record the same motion"
    return None


def hindrance_of_ringing(course: Course, as_new: Sequence[Course]) -> str | None:
    """Why resonances cannot be compared; None where they can."""
    if not as_new:
        return NO_AS_NEW
    for one in (course, *as_new):
        if one.moving is None:
            return NO_STANDSTILL
        if one.analysis.highest_hz < HIGHEST_HZ:
            return f"the sample rate of {one.analysis.recording.sample_rate_hz:.0f} Hz is too low"
        if _spectra(one)["speeding"] is None:
            return f"the speed changes in fewer than {LEAST_SEGMENTS} stretches of {SEGMENT / ANALYSIS_RATE_HZ:.2g} s"
    return None


def grown(axis: Axis, courses: Sequence[Course], as_new: Sequence[Course]) -> list[Heard]:
    """Errors of teeth and resonances that recordings show more of than those as new."""
    both = [_growths(axis, course, as_new) for course in courses]
    return [*_mesh_error(axis, [teeth for teeth, _ in both]), *_resonance([ringing for _, ringing in both])]


def strangers_as_new(courses: Sequence[Course], as_new: Sequence[Course], names: Sequence[str]) -> tuple[str, ...]:
    """A remark where a recording has so little in common with those as new that they may be of another gearbox."""
    known = [
        (name, max(_likeness(course, one) for one in as_new))
        for name, course in zip(names, courses, strict=True)
        if as_new and hindrance_of_ringing(course, as_new) is None
    ]
    return tuple(
        f"The spectrum{'' if len(names) == 1 else f' of {name}'} has little in common with that as new (correlation "
        f"{likeness:.2f}): either something very loud has come in, or it is another gearbox, housing or place of the "
        "microphone, and then the comparison says nothing."
        for name, likeness in known
        if likeness < ALIKE
    )


def _likeness(course: Course, as_new: Course) -> float:
    """Correlation of both spectra over their surroundings, without the largest difference."""
    now, then = (_spectra(one)["speeding"] for one in (course, as_new))
    if now is None or then is None:
        return 1.0
    grown = int(np.argmax(_over_base(now - then)))
    rest = np.abs(np.arange(now.size) - grown) > BASE // 3
    return float(np.corrcoef(_over_base(now)[rest], _over_base(then)[rest])[0, 1])


def growth_curves(course: Course, as_new: Course) -> tuple[Array, tuple[tuple[str, Array], ...]]:
    """For a picture: frequencies [Hz], and how much louder than as new [dB] while cruising and while speed changes.

    No curves where they cannot be compared.
    """
    if hindrance_of_ringing(course, [as_new]):
        return _cells(), ()
    now, then = _spectra(course), _spectra(as_new)
    words = {"cruising": "while cruising", "speeding": "while the speed changes"}
    lines = []
    for kind, name in words.items():
        own, before = now[kind], then[kind]
        if own is not None and before is not None:
            lines.append((name, _over_base(own - before)))
    return _cells(), tuple(lines)


def _growths(axis: Axis, course: Course, as_new: Sequence[Course]) -> tuple[Growth | None, Growth | None]:
    """Of teeth and of a pitch: lines that grow are heard at any pitch that they pass, and what rings lifts a line."""
    teeth, ringing = _teeth_of(axis, course, as_new), _ringing_of(course, as_new)
    if teeth is not None and ringing is not None:
        ringing = replace(ringing, score=ringing.score - max(0.0, teeth.score - TEETH_TAIL.start))
        if log_ratio(RING_TAIL.p_value(ringing.score)) > 0.0:
            teeth = _teeth_of(axis, course, as_new, ringing.frequency_hz)
    return teeth, ringing


def _mesh_error(axis: Axis, found: Sequence[Growth | None]) -> list[Heard]:
    """Lines of one gear's teeth that stand out more than as new, while those of the others do not."""
    best = max((one for one in found if one is not None), key=lambda one: one.score, default=None)
    if best is None:
        return []
    p_values = tuple(
        None if one is None else TEETH_TAIL.p_value(one.score) if one.stage == best.stage else 1.0 for one in found
    )
    times = 10.0 ** (best.height_db / 20.0)
    others = ", and those of no other gear do so" if len(mesh_orders(axis)) > 1 else ""
    text = (
        f"While cruising, the lines of the teeth of {best.stage} stand {best.height_db:.0f} dB ({times:.2g} times) "
        f"higher over the sound around them than as new{others}: its teeth err more."
    )
    return [Heard("mesh_error", best.stage, probability(p_values), {}, text, p_values=p_values)]


def _resonance(found: Sequence[Growth | None]) -> list[Heard]:
    """A pitch at which the sound has grown at any speed, but not at rest."""
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
        "as new, at every speed and not at rest: something rings that did not, a cover, a bolt or a pipe that is loose."
    )
    pitch = (best.frequency_hz, best.frequency_hz - best.half_hz, best.frequency_hz + best.half_hz)
    numbers = {"frequency_hz": pitch}
    return [Heard("structural_resonance", None, probability(p_values), numbers, text, p_values=p_values)]


def _teeth_of(axis: Axis, course: Course, as_new: Sequence[Course], ringing_hz: float | None = None) -> Growth | None:
    """The stage whose lines have grown most beyond those of the others, over the as-new recording nearest to it.

    Lines near `ringing_hz` are left out.
    """
    if hindrance_of_teeth(axis, course, as_new):
        return None
    own = _rows(course)
    each = [grown for one in as_new if (grown := _grown(axis, own, _rows(one), ringing_hz)) is not None]
    grown = np.min(each, axis=0)
    names = [stage.name for stage in axis.stages if stage.driver_teeth is not None]
    place = int(np.argmax(grown))
    others = np.delete(grown, place)
    height = float(grown[place])
    return Growth(height - max(0.0, float(others.max(initial=0.0))), height, names[place])


def _alike(speed: float, other: float) -> bool:
    return abs(other / speed - 1.0) <= SAME_SPEED


def _rows(course: Course) -> list[Row]:
    """Every cruise of known speed."""
    out = []
    for c in course.cruises:
        if c.turns_per_s is not None:
            first, last = round(c.start_s * ANALYSIS_RATE_HZ), round(c.end_s * ANALYSIS_RATE_HZ)
            part = course.analysis.samples[first:last].astype(np.float64)
            out.append((c.turns_per_s, c.length_s, over_surroundings(part, ANALYSIS_RATE_HZ, AROUND_HZ)))
    return out


def _grown(axis: Axis, own: Sequence[Row], before: Sequence[Row], ringing_hz: float | None) -> Array | None:
    """How much each stage's lines have grown [dB], shape (stages,), at speeds that both have; None without any."""
    lasts: dict[float, float] = {}
    for speed, length, _ in own:
        lasts[speed] = lasts.get(speed, 0.0) + length
    growths, lengths = [], []
    for speed, length in lasts.items():
        now, then = ([row for row in rows if _alike(speed, row[0])] for rows in (own, before))
        if then:
            here, there = (_line_heights(axis, rows, ringing_hz) for rows in (now, then))
            growths.append(10.0 * np.log10(here / there))
            lengths.append(length)
    return np.average(growths, axis=0, weights=lengths) if growths else None


def _line_heights(axis: Axis, rows: Sequence[Row], ringing_hz: float | None) -> Array:
    """Power of each stage's lines over the sound around them, no less than what noise reaches, shape (stages,)."""
    spacing = ANALYSIS_RATE_HZ / TRANSFORM
    floor = gamma_limit(len(rows), 2.0 * BESIDE_HZ / spacing)
    out = []
    for order in mesh_orders(axis):
        total = 0.0
        for k in MULTIPLES:
            lines = [(row, k * order * turns) for turns, _, row in rows]
            heights = [_at(row, line / spacing, BESIDE_HZ / spacing) for row, line in lines
                       if line < HIGHEST_HZ and not (ringing_hz and abs(line / ringing_hz - 1.0) < RUNG)]  # fmt: skip
            total += max(float(np.mean(heights)), floor) if heights else 0.0
        out.append(max(total, floor))
    return np.array(out)


def _at(row: Array, place: float, within: float) -> float:
    first = max(0, math.floor(place - within))
    return float(row[first : math.ceil(place + within) + 1].max(initial=1.0))


def _ringing_of(course: Course, as_new: Sequence[Course]) -> Growth | None:
    """The pitch at which the sound has grown most, beyond what differs downwards, over every as-new recording."""
    if hindrance_of_ringing(course, as_new):
        return None
    centres = _cells()
    own = _spectra(course)
    up: Array = np.full(centres.size, np.inf)
    down: Array = np.full(centres.size, np.inf)
    for one in as_new:
        before = _spectra(one)
        for kind in ("cruising", "speeding"):
            now, then = own[kind], before[kind]
            if now is not None and then is not None:
                over = _over_base(now - then)
                up, down = np.minimum(up, over), np.minimum(down, -over)
    rest, moving = own["resting"], own["speeding"]
    if rest is not None and moving is not None:
        up = np.where(moving - rest < AT_REST_DB, -np.inf, up)
    of_teeth = _of_teeth(centres, (course, *as_new))
    up, down = (np.where(of_teeth, -np.inf, one) for one in (up, down))
    peak = int(np.argmax(up))
    height = float(up[peak])
    if not math.isfinite(height):  # nothing sounds of the axis alone
        return Growth(0.0, 0.0, None, float(centres[peak]))
    apart = np.abs(np.arange(centres.size) - peak)
    near = np.flatnonzero(up > height - 3.0)
    near = near[apart[near] <= BASE // 4]
    weight = 10.0 ** (up[near] / 10.0)
    frequency = float((weight * centres[near]).sum() / weight.sum())
    half = max(0.5 * ANALYSIS_RATE_HZ / SEGMENT, CELL * frequency)
    other = float(down[apart > BASE // 2].max(initial=0.0))  # beside its peak a mode cancels others
    return Growth(height - other, height, None, frequency, half)


def _of_teeth(centres: Array, courses: Sequence[Course]) -> Mask:
    """Which cells hold lines of teeth at a speed that is heard: a speed that changes moves them."""
    lines = np.array([
        k * order * turns
        for course in courses
        for turns in {round(c.turns_per_s, 3) for c in course.cruises if c.turns_per_s is not None}
        for order in course.mesh_orders
        for k in MULTIPLES
    ])  # fmt: skip
    if not lines.size:
        return np.zeros(centres.size, dtype=np.bool_)
    apart = np.abs(centres[:, None] - lines)
    within = LINE_CELLS * CELL * lines + ANALYSIS_RATE_HZ / SEGMENT
    return np.asarray((apart < within).any(axis=1))


def _cells() -> Array:
    """Centres of cells of a constant share of their frequency [Hz]."""
    count = int(math.log(HIGHEST_HZ / LOWEST_HZ) / CELL)
    return np.asarray(LOWEST_HZ * np.exp(CELL * np.arange(count, dtype=np.float64)))


def _over_base(level_db: Array) -> Array:
    return np.asarray(level_db - median_filter(level_db, BASE, mode="nearest"))


def _spectra(course: Course) -> dict[str, Array | None]:
    """Mean level in each cell [dB] while cruising, while the speed changes and at rest; None where too short."""
    transform = ShortTimeFFT(np.hanning(SEGMENT), SEGMENT // 4, ANALYSIS_RATE_HZ, fft_mode="onesided")
    values = course.analysis.samples.astype(np.float64)
    first, last = transform.lower_border_end[1], transform.upper_border_begin(values.size)[1]
    power = transform.spectrogram(values, p0=first, p1=last)
    middle = transform.t(values.size, p0=first, p1=last)
    level = 10.0 * np.log10(power + 1e-30)
    centres = _cells()
    out: dict[str, Array | None] = {}
    for kind, chosen in _kinds(course, middle).items():
        if chosen.sum() < LEAST_SEGMENTS:
            out[kind] = None
            continue
        out[kind] = _in_cells(transform.f, level[:, chosen].mean(axis=1), centres)
    return out


def _in_cells(frequency: Array, level: Array, centres: Array) -> Array:
    """Mean over each cell, by the integral of the curve through the levels."""
    spacing = frequency[1] - frequency[0]
    area = np.concatenate(([0.0], np.cumsum(0.5 * (level[1:] + level[:-1])))) * spacing
    low, high = centres * math.exp(-0.5 * CELL), centres * math.exp(0.5 * CELL)
    return np.asarray((np.interp(high, frequency, area) - np.interp(low, frequency, area)) / (high - low))


def _kinds(course: Course, middle: Array) -> dict[str, Mask]:
    """Which stretches lie in a cruise, which in motion outside of it, which wholly at rest."""
    half = 0.5 * SEGMENT / ANALYSIS_RATE_HZ
    cruising = np.zeros(middle.size, dtype=np.bool_)
    within = np.zeros(middle.size, dtype=np.bool_)
    for cruise in course.cruises:
        cruising |= (middle - half >= cruise.start_s) & (middle + half <= cruise.end_s)
        within |= (middle > cruise.start_s) & (middle < cruise.end_s)
    moving = np.zeros(middle.size, dtype=np.bool_) if course.moving is None else course.moving
    before = np.concatenate(([0], np.cumsum(moving)))
    places = np.rint((middle[:, None] + [-half, 0.0, half]) * course.analysis.recording.sample_rate_hz).astype(np.int64)
    places = np.clip(places, 0, moving.size - 1)
    speeding = moving[places[:, 1]] & ~within
    return {"cruising": cruising, "speeding": speeding, "resting": before[places[:, 2]] == before[places[:, 0]]}
