"""Lines that follow the speed while cruising: teeth have known orders; a family at none of them is a rolling bearing.

A damaged bearing hits at an order that is no whole number of any shaft, since its balls roll and slip, with many
multiples of like strength (McFadden and Smith, J. Sound Vib. 96 (1984) 69). They stand in the spectrum of the sound,
or in that of its envelope where a mode of the housing carries them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from casebase.signals.analysis import ANALYSIS_RATE_HZ
from sim.description.axis import Axis
from sim.discrepancy.acoustic.impacts import NO_STANDSTILL
from sim.discrepancy.acoustic.operating_states import LEAST_CRUISES, Course, Mask
from sim.discrepancy.acoustic.spectral_lines import TRANSFORM, gamma_limit, mesh_orders
from sim.torsional.model import Array

BANDS_HZ = ((150.0, 800.0), (800.0, 2000.0), (2000.0, 3700.0))
STEP = 0.004  # orders per revolution of the motor
HIGHEST_ORDER = 90.0
LOWEST_ORDER, HIGHEST_BASE = 1.2, 30.0
MULTIPLES = 8
LEAST_MULTIPLES = 5
LEAST_KNOWN = 2
MAJORITY_OF = 12
LEAST_FREE = 3
LARGEST_POWER = 100.0  # of one cruise: none alone makes a line of the mean
SLIP = 0.001  # relative: rolling elements slip, and what they hit comes early or late
FITTED = 0.15  # of the resolution: how well the highest multiple is placed
GEAR_WITHIN = 0.0005  # relative: what a speed from lines of teeth is known within
SHORT = 0.5  # of the turns of the longest cruise but one


@dataclass(frozen=True)
class Family:
    """A base order with multiples: order and half of its 90 % interval, how many multiples, chance for noise."""

    order: float
    half: float
    count: int
    p_value: float


def bearing_hindrance(axis: Axis, course: Course) -> str | None:
    """Why a bearing cannot be looked for; None where it can."""
    if axis.stages and not mesh_orders(axis):
        return "the description gives no tooth numbers, which separate teeth from bearings"
    if course.analysis.highest_hz < BANDS_HZ[0][1]:
        return f"the sample rate of {course.analysis.recording.sample_rate_hz:.0f} Hz is too low"
    if not course.analysis.motion.reversal_times_s:
        return NO_STANDSTILL
    if len(course.cruises) < LEAST_CRUISES:
        return f"{LEAST_CRUISES} strokes at constant speed are needed and {len(course.cruises)} heard"
    if course.speed is None:
        return "no tooth of this axis is heard as a line, so that the speed is unknown"
    if len(_known(course)) < LEAST_KNOWN:
        return "the speed is known of one stroke only"
    return None


def _known(course: Course) -> list[int]:
    """Places of the cruises at known speed, but for short ones, which would blur all."""
    turned = {k: c.turned for k, c in enumerate(course.cruises) if c.turns_per_s}
    least = SHORT * (sorted(turned.values())[-LEAST_KNOWN] if len(turned) >= LEAST_KNOWN else 0.0)
    return [k for k, turns in turned.items() if turns > least]


def bearing_family(axis: Axis, course: Course) -> Family | None:
    """The clearest family of lines that no gear explains; None where there is none or the speed is unknown."""
    if bearing_hindrance(axis, course):
        return None
    known = [(index, course.cruises[index].turns_per_s or 1.0) for index in _known(course)]
    resolution = 2.0 / min(
        turns * (course.cruises[index].end_s - course.cruises[index].start_s) for index, turns in known
    )
    grid: Array = np.arange(0.5, HIGHEST_ORDER, STEP, dtype=np.float64)
    kinds = [[on_orders(grid, course.spectra[index], turns) for index, turns in known]]
    for band in bands_of(course):
        kinds.append([on_orders(grid, course.envelope(index, band), turns) for index, turns in known])
    powers = [np.asarray(np.minimum(kind, LARGEST_POWER).mean(axis=0), np.float64) for kind in kinds]
    best: Family | None = None
    for power in powers:
        found = _family(axis, grid, power, len(known), resolution)
        if found is not None and (best is None or found.p_value < best.p_value):
            best = found
    if best is None or _also_teeth(axis, best.order, powers[0], len(known), grid, resolution):
        return None
    return best


def _also_teeth(axis: Axis, order: float, power: Array, averages: int, grid: Array, resolution: float) -> bool:
    """Whether the family could be the teeth, at another speed at which the lines taken for teeth are such, too."""
    lines = _lines(grid, power, averages, resolution)
    meshes = [k * mesh for mesh in mesh_orders(axis) for k in (1, 2, 3)]
    teeth = [one for one in lines if any(abs(one - mesh) < 0.5 * resolution for mesh in meshes)]
    for mesh in mesh_orders(axis):
        scale = mesh / order
        others = [one * scale / m for one in teeth for m in mesh_orders(axis)]
        whole = [abs(one - round(one)) < FITTED * resolution * scale and round(one) >= 1 for one in others]
        explained = [any(whole[i : i + len(mesh_orders(axis))]) for i in range(0, len(whole), len(mesh_orders(axis)))]
        if all(explained):
            return True
    return False


def bands_of(course: Course) -> list[tuple[float, float]]:
    """Bands [Hz] that a recording holds whole."""
    return [band for band in BANDS_HZ if band[1] <= course.analysis.highest_hz]


def on_orders(grid: Array, spectrum: Array, turns_per_s: float) -> Array:
    """Power at orders; 1, the mean of noise, where the recording does not reach."""
    place = grid * turns_per_s * TRANSFORM / ANALYSIS_RATE_HZ
    return np.asarray(np.interp(place, np.arange(spectrum.size), spectrum, right=1.0))


def _family(axis: Axis, grid: Array, power: Array, averages: int, resolution: float) -> Family | None:
    lines = _lines(grid, power, averages, resolution)
    free = np.array([order for order in lines if not of_gears(axis, order, 0.25 * resolution)])
    if free.size < LEAST_FREE or len(lines) < LEAST_MULTIPLES:
        return None
    best: Family | None = None
    for line in free[:24]:
        for k in (1, 2, 3):
            if LOWEST_ORDER < line / k < HIGHEST_BASE:
                found = _matched(axis, float(line / k), np.array(lines), free, resolution)
                if found is not None and (best is None or (found.p_value, found.order) < (best.p_value, best.order)):
                    best = found
    return best


def _lines(grid: Array, power: Array, averages: int, resolution: float) -> list[float]:
    """Orders of lines that noise does not make, strongest first."""
    limit = gamma_limit(averages, (grid[-1] - grid[0]) / resolution)
    peaks = np.flatnonzero((power[1:-1] > limit) & (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])) + 1
    kept: list[float] = []
    for k in peaks[np.argsort(-power[peaks], kind="stable")]:
        order = float(grid[k])
        if all(abs(order - other) > 2.0 * resolution for other in kept):
            kept.append(order)
    return kept[:80]


def _matched(axis: Axis, base: float, lines: Array, free: Array, resolution: float) -> Family | None:
    """Fit the base order to the lines on its multiples, and count them against chance.

    Some of them may coincide with those of gears, but neither the base nor most of them; and most of what no gear
    explains must belong to the family: lines all over come from something fixed in hertz that modulates the sound.
    """
    tolerance = 0.5 * resolution
    top = int(min(MULTIPLES, HIGHEST_ORDER / base))
    order, numbers = base, np.zeros(0)
    for _ in range(2):
        hit = _on_multiples(lines, order, tolerance, top)
        if not hit.any():
            return None
        number = np.rint(lines[hit] / order)
        number /= np.gcd.reduce(number.astype(np.int64))  # every second multiple of a base is a base of its own
        numbers = np.unique(number)
        order = float((lines[hit] * number).sum() / (number**2).sum())
    if numbers.size < LEAST_MULTIPLES or numbers[0] > 2:
        return None
    if _gear_family(axis, order, FITTED * resolution / numbers[-1], lines, resolution):
        return None
    strongest = free[:MAJORITY_OF]
    own = _on_multiples(strongest, order, tolerance, int(HIGHEST_ORDER / order))
    if own.mean() < 0.5 or own.sum() < LEAST_FREE:
        return None
    width = 2.0 * (tolerance + 0.5 * SLIP * HIGHEST_ORDER)
    chance = min(width * lines.size / HIGHEST_ORDER, 0.9)
    p = min(1.0, 3.0 * lines.size * float(binom.sf(numbers.size - 2, max(top - 1, 1), chance)))
    half = 1.645 * 0.3 * resolution / math.sqrt(float((numbers**2).sum()))
    return Family(order, max(half, 1.5 * SLIP * order), int(numbers.size), p)


def _on_multiples(lines: Array, order: float, tolerance: float, top: int) -> Mask:
    number = np.rint(lines / order)
    near = np.abs(lines - number * order) < tolerance + SLIP * lines
    return np.asarray(near & (number >= 1.0) & (number <= top))


def of_gears(axis: Axis, order: float, tolerance: float) -> bool:
    """Whether a line per revolution of the motor may be of shafts and teeth.

    Those are multiples of shafts, and what meshes make together: i times one plus j times the next, with the sidebands
    of their shafts.
    """
    return bool(_near_gears(axis, np.array([order]), tolerance)[0])


def _near_gears(axis: Axis, orders: Array, tolerance: float) -> Mask:
    turns = _turns(axis)
    sums = [0.0]
    for mesh in mesh_orders(axis):
        sums = [total + k * mesh for total in sums for k in range(-4, 5)]
    sides = [0.0, *(side * turn for turn in turns[:2] for side in (-2.0, -1.0, 1.0, 2.0))]
    known = [k * turn for turn in turns for k in range(1, 13)]
    known += [float(k) for k in range(1, 101)]
    known += [total + side for total in sums for side in sides]
    places = np.unique(known)
    after = np.clip(np.searchsorted(places, orders), 1, places.size - 1)
    apart = np.minimum(np.abs(orders - places[after - 1]), np.abs(orders - places[after]))
    return np.asarray(apart < tolerance + GEAR_WITHIN * orders)


def _gear_family(axis: Axis, order: float, tolerance: float, lines: Array, resolution: float) -> bool:
    """Whether a whole family is that of a shaft or a mesh.

    Its base is then the shaft's or the mesh's own order, or a whole number of turns of the motor, or one of their
    multiples while those below are heard, too.
    """
    turns, meshes = _turns(axis), mesh_orders(axis)
    limit = tolerance + GEAR_WITHIN * order
    single = [*turns, *meshes, *(mesh + side * turn for mesh in meshes for turn in turns[:2] for side in (-1.0, 1.0))]
    if abs(order - round(order)) < limit or any(abs(order - one) < limit for one in single):
        return True
    for one in (*turns[1:], *meshes):
        k = round(order / one)
        if 2 <= k <= 12 and abs(order - k * one) < limit:
            below = [np.min(np.abs(lines - j * one)) < 0.5 * resolution for j in range(1, k)]
            if np.mean(below) >= 0.5:
                return True
    return False


def _turns(axis: Axis) -> list[float]:
    turns = [1.0]
    for stage in axis.stages:
        turns.append(turns[-1] / stage.ratio)
    return turns
