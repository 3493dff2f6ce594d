"""Rolling bearings, whose orders no gear has; and a tooth of a gear between motor and load, which strikes at each turn.

From impact to impact of a bearing the phase of multiple k walks by 2 pi k `SLIP`, so that its line has half its height
at pi (k `SLIP`)^2 times the base to either side (Randall and Antoni, Mech. Syst. Signal Process. 25 (2011) 485): it is
summed over that. All multiples count together (Fisher).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.special import gammaincc
from scipy.stats import gamma, rankdata

from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.acoustic.evidence import Tail
from sim.investigation.acoustic.operating_states import LEAST_CRUISES, NO_STANDSTILL, Course, Mask
from sim.investigation.acoustic.order_spectrum import BANDS, OrderSpectra, mesh_orders

BASES = (2.0, 30.0)  # orders of rolling bearings per turn of the motor; shafts and teeth that err lie below
MULTIPLES = 8
SLIP = 0.01  # of the way from one impact to the next, at random
CLEAR = 3.0  # nats by which a multiple stands out
LARGEST = 9.0  # nats of one multiple: none alone makes a bearing
OF_DOUBLE = 1.5  # times the nats of the multiples between: then the base is the double
PER_BIN = 4  # bases per bin
GEAR_MULTIPLES = 12
SIDEBANDS = 0.15  # turns of the motor on either side of a line of teeth: slow shafts and an uneven speed
TEETH_MULTIPLES, TURN_ORDERS = 4, 12.0  # of a gear with a damaged tooth
# Natural logarithms of power. Of 290 simulated gearboxes without such a tooth one in twenty reaches 0.3 and none 0.6; a
# badly damaged tooth of the output gear reaches 0.5, one of a gear between 0.7 to 3.
TURNS_TAIL = Tail(start=0.45, scale=0.08)


@dataclass(frozen=True)
class Family:
    """A base order with multiples: order and half of its 90 % interval, how many are clear, chance for noise."""

    order: float
    half: float
    count: int
    p_value: float


@dataclass(frozen=True)
class Turns:
    """Lines at multiples of a gear's turns: the gear, its turns per turn of the motor, how far they stand out of the
    places between them [natural logarithm of power]."""

    stage: str
    order: float
    score: float


def bearing_hindrance(axis: Axis, course: Course) -> str | None:
    """Why a bearing cannot be looked for; None where it can."""
    if axis.stages and not mesh_orders(axis):
        return "the description gives no tooth numbers, which separate teeth from bearings"
    if all(course.analysis.envelope(band) is None for band in BANDS):
        return f"the sample rate of {course.analysis.recording.sample_rate_hz:.0f} Hz is too low"
    if not course.analysis.motion.reversal_times_s:
        return NO_STANDSTILL
    if len(course.cruises) < LEAST_CRUISES:
        return f"{LEAST_CRUISES} strokes at constant speed are needed and {len(course.cruises)} heard"
    if course.speed is None:
        return "no tooth of this axis is heard as a line, so that the speed is unknown"
    return None if course.orders else "the motor turns too few times at a speed that is known"


def bearing_family(axis: Axis, course: Course) -> Family | None:
    """The clearest family of lines of which no gear explains most; None where there is none or the speed is unknown."""
    spectra = course.orders
    if spectra is None:
        return None
    free = ~_near_gears(axis, spectra.orders, 1.5 * spectra.step)
    turns = turns_of_tooth(axis, course)
    if turns is not None and TURNS_TAIL.p_value(turns.score) < 1.0:
        free &= ~_near_multiples(spectra.orders, [turns.order], math.inf, spectra.step)
    found = [_family(spectra, band, free, mesh_orders(axis)) for band in range(len(spectra.along))]
    return min((one for one in found if one is not None), key=lambda one: one.p_value, default=None)


def turns_of_tooth(axis: Axis, course: Course) -> Turns | None:
    """The gear between motor and load whose multiples stand out most; None where none can be looked for."""
    spectra, found = course.orders, []
    if spectra is None:
        return None
    free = ~_near_multiples(spectra.orders, [1.0], math.inf, 1.5 * spectra.step)
    free &= ~_near_multiples(spectra.orders, mesh_orders(axis), TEETH_MULTIPLES, SIDEBANDS)
    for stage, order in zip(axis.stages, _shafts(axis), strict=True):
        if order < 4.0 * spectra.step:
            continue
        halves: Array = np.arange(2.0, min(2.0 * TURN_ORDERS / order, 48.0))
        for power in spectra.along:
            height, _, used = _lines(spectra, power, halves[:, None], np.array([0.5 * order]), free)
            there, between = (np.log(np.maximum(height[k::2][used[k::2]], 1e-9)) for k in (2, 1))
            if min(there.size, between.size) >= 5:
                found.append(Turns(stage.name, float(order), float(np.median(there) - np.median(between))))
    return max(found, key=lambda one: one.score, default=None)


def _lines(spectra: OrderSpectra, power: Array, k: Array, bases: Array, free: Mask) -> tuple[Array, Array, Mask]:
    """Of multiples k (n, 1) of bases (m,), all (n, m): power of each line, its bins, whether no gear explains it."""
    step = spectra.step
    summed = np.concatenate([[0.0], np.cumsum(np.where(free, power, 0.0))])
    counted = np.concatenate([[0], np.cumsum(free)])
    half = np.maximum(1.5 * math.pi * (k * SLIP) ** 2 * bases, 0.5 * step)
    first = np.clip(np.rint((k * bases - half) / step).astype(np.intp), 0, power.size)
    last = np.clip(np.rint((k * bases + half) / step).astype(np.intp) + 1, 0, power.size)
    at = np.clip(np.rint(k * bases / step).astype(np.intp), 0, power.size - 1)
    bins = counted[last] - counted[first]
    used = free[at] & (k * bases + half < float(spectra.orders[-1]))
    return np.where(used, (summed[last] - summed[first]) / np.maximum(bins, 1), 1.0), bins, used


def _family(spectra: OrderSpectra, band: int, free: Mask, meshes: Sequence[float]) -> Family | None:
    """The base of which most multiples stand out, over the path more than over time; those of `meshes` are of teeth.

    How seldom a line is so strong is asked of the same multiple of all bases: whatever turns makes lines in this
    recording, and only a family has all of its own.
    """
    bases = np.arange(*BASES, spectra.step / PER_BIN, dtype=np.float64)
    bases = bases[~_near_multiples(bases, meshes, math.inf, 0.5 * spectra.step, share=0.0)]
    k = np.arange(1.0, MULTIPLES + 1.0, dtype=np.float64)[:, None]
    height, bins, used = _lines(spectra, spectra.along[band], k, bases, free)
    fixed, _, _ = _lines(spectra, spectra.fixed[band], k, bases, free)
    shape = spectra.averages * np.maximum(0.67 * bins, 1.0)  # neighbours depend on each other under a Hann window
    chance = np.where(used, gammaincc(shape, shape * height), 1.0)
    # by Wilson and Hilferty's normal deviate (Proc. Natl. Acad. Sci. 17 (1931) 684): chances below 1e-308 are all 0
    deviate = (np.cbrt(height) - 1.0 + 1.0 / (9.0 * shape)) * np.sqrt(shape)
    for row, use, far in zip(chance, used, deviate, strict=True):
        row[use] = np.maximum(row[use], rankdata(-far[use], "max") / max(use.sum(), 1))
    nats = np.minimum(-np.log(np.maximum(chance, 1e-300)), LARGEST)
    clear = nats > CLEAR
    lowest = used & (np.cumsum(used, axis=0) <= 3)  # of those that no gear hides
    enough = (clear.sum(axis=0) >= 4) & ((clear & lowest).sum(axis=0) >= 2)
    fixed = maximum_filter1d(fixed, 2 * PER_BIN + 1, axis=1)  # over the path it is blurred to either side
    enough &= np.log(height / np.maximum(fixed, 1e-9)).sum(axis=0) > 0.0
    if not enough.any():
        return None
    trials = bases.size / PER_BIN
    score = np.where(enough, -gamma.logsf(nats.sum(axis=0), np.maximum(used.sum(axis=0), 1)), 0.0)
    best = int(np.argmax(score))
    odd, even = (nats[k::2, best].sum() / max(used[k::2, best].sum(), 1) for k in (0, 1))
    order = float(bases[best]) * (2.0 if even > OF_DOUBLE * odd else 1.0)
    p_value = min(1.0, trials * math.exp(-score[best]))
    return Family(order, max(0.5 * spectra.step, 0.4 * SLIP * order), int(clear[:, best].sum()), p_value)


def _shafts(axis: Axis) -> Array:
    """Turns of each driven gear per turn of the motor, shape (stages,)."""
    return np.asarray(1.0 / np.cumprod([stage.ratio for stage in axis.stages]), dtype=np.float64)


def _near_gears(axis: Axis, orders: Array, tolerance: float) -> Mask:
    """Whether orders (m,) may be of shafts and teeth: multiples of each, and whole numbers of turns of the motor."""
    near = _near_multiples(orders, [1.0], math.inf, tolerance)
    near |= _near_multiples(orders, _shafts(axis), GEAR_MULTIPLES, tolerance)
    return near | _near_multiples(orders, mesh_orders(axis), TEETH_MULTIPLES, SIDEBANDS)


def _near_multiples(orders: Array, bases: Iterable[float], most: float, tolerance: float, share: float = 0.001) -> Mask:
    near = np.zeros(orders.size, dtype=np.bool_)
    for one in bases:
        near |= np.abs(orders - np.clip(np.round(orders / one), 1.0, most) * one) < tolerance + share * orders
    return near
