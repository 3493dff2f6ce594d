"""What of a sound no part of its model explains.

The model: teeth and shafts sound at orders of the motor's turns, the mains at multiples of their frequency, all else is
noise whose level in an octave is that of the state of motion (standstill, constant speed, between). Three kinds are
left: a line at no order, while the speed changes as well or beside what is known to turn; an octave whose level comes
and goes by itself; and noise at standstill beside which the axis is hardly heard. Something is left where the sound is
more than `TWICE` of what is explained, in power: of a line in the third of an octave around it.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from signals.analysis import ANALYSIS_RATE_HZ
from signals.reading.live_channel import MAINS_HZ
from sim.chain.model import Array
from sim.investigation.acoustic.operating_states import Course, Mask
from sim.investigation.acoustic.order_spectrum import LEVEL_BAND_HZ
from sim.investigation.unexplained import Unexplained

TWICE = 4.0  # in power: the sound has twice the amplitude
SEGMENT = 2_048  # samples: 4 Hz apart
LINE, BESIDE = 5, 21  # bins that a line fills, and from which its surroundings are taken
APART_HZ = 10.0  # what lies so near an order is of it
LEAST = 8  # segments
OFTEN = 2.0 / 3.0  # a line is there for a third of the time: what passes by is not
LOUD = 0.9  # quantile over time
MESHES, TURNS, HUMS = 8, 24, 6  # multiples that a gearbox and the mains have
LOWEST_HZ, HIGHEST_HZ, PER_OCTAVE = 125.0, LEVEL_BAND_HZ[1], 6


def left_in(course: Course) -> Unexplained | None:
    """What is left most in a recording; None where nothing is, or nothing is known of its motion."""
    samples = course.analysis.samples.astype(np.float64)
    if course.moving is None or samples.size < LEAST * SEGMENT:
        return None
    pieces = sliding_window_view(samples, SEGMENT)[:: SEGMENT // 2]
    power = np.abs(np.fft.rfft(pieces * np.hanning(SEGMENT))) ** 2
    frequency: Array = np.arange(SEGMENT // 2 + 1, dtype=np.float64) * (ANALYSIS_RATE_HZ / SEGMENT)
    middle: Array = (np.arange(len(power), dtype=np.float64) + 1.0) * SEGMENT / 2 / ANALYSIS_RATE_HZ
    moving = course.moving_at(middle)
    found = (
        *(_line(power[rows], frequency, _of_no_order(course, middle, frequency)[rows]) for rows in (moving, ~moving)),
        _change(power, frequency, middle, _states(course, middle, moving)),
        _noise(power, frequency, moving),
    )
    return max((one for one in found if one is not None), key=lambda one: one.score, default=None)


def _unexplained(kind: str, times: float, **numbers: float) -> Unexplained | None:
    """`times`: power of the sound over what is explained of it."""
    return Unexplained(kind, "sound", 1.0 - 1.0 / times, times, numbers) if times > TWICE else None


def _of_no_order(course: Course, middle: Array, frequency: Array) -> Mask:
    """Where no order lies, and no multiple of the mains; nowhere at a steady speed that is unknown."""
    orders = np.array([k * o for o in course.mesh_orders for k in range(1, MESHES + 1)] + list(range(1, TURNS + 1)))
    hums = np.array([k * mains for mains in MAINS_HZ for k in range(1, HUMS + 1)])
    free = np.tile(np.abs(frequency[:, None] - hums).min(axis=1) > APART_HZ, (middle.size, 1))
    half = SEGMENT / 2 / ANALYSIS_RATE_HZ
    for row, (start, end) in enumerate(zip(middle - half, middle + half, strict=True)):
        slowest, fastest = course.turns_within(start, end)
        low, high = slowest * orders - APART_HZ, fastest * orders + APART_HZ
        free[row] &= ~((frequency[:, None] > low) & (frequency[:, None] < high)).any(axis=1)
    return free


def _line(power: Array, frequency: Array, free: Mask) -> Unexplained | None:
    """The line that stands out most of the third of an octave around it, where it is `free` of orders."""
    count = free.sum(axis=0)
    if not (count >= LEAST).any():
        return None
    usual = np.full(count.size, np.nan)
    known = count >= LEAST
    usual[known] = np.nanquantile(np.where(free, power, np.nan)[:, known], OFTEN, axis=0)
    around = sliding_window_view(usual, BESIDE)
    side = (BESIDE - LINE) // 2 - 2
    beside = np.maximum(np.median(around[:, :side], axis=1), np.median(around[:, -side:], axis=1))
    middle = slice((BESIDE - LINE) // 2, (BESIDE + LINE) // 2)
    line = np.nan_to_num(around[:, middle].sum(axis=1) - LINE * beside)
    place = np.arange(line.size) + BESIDE // 2
    total = np.concatenate([[0.0], np.cumsum(np.where(known, usual, np.quantile(power, OFTEN, axis=0)))])
    half = np.maximum((place * (2.0 ** (1.0 / 6.0) - 1.0)).astype(np.int64), BESIDE // 2)
    all_of_it = total[np.minimum(place + half + 1, frequency.size)] - total[np.maximum(place - half, 0)]
    others = np.maximum(all_of_it - line, 1e-300)
    inside = (frequency[place] >= LOWEST_HZ) & (frequency[place] <= HIGHEST_HZ)
    times = np.where(inside, 1.0 + line / others, 0.0)
    best = int(np.argmax(times))
    return _unexplained("frequency", float(times[best]), frequency_hz=float(frequency[place[best]]))


def _octaves(power: Array, frequency: Array) -> tuple[Array, Array]:
    """Centres of octaves (m,) [Hz], and their levels beside lines in every segment (segments, m)."""
    count = int(np.log2(HIGHEST_HZ / LOWEST_HZ / 2.0) * PER_OCTAVE) + 1
    centres = LOWEST_HZ * 2.0 ** (0.5 + np.arange(count) / PER_OCTAVE)
    inside = [(frequency >= c / 2.0**0.5) & (frequency < c * 2.0**0.5) for c in centres]
    return centres, np.stack([np.median(power[:, one], axis=1) for one in inside], axis=1)


def _states(course: Course, middle: Array, moving: Mask) -> NDArray[np.int64]:
    """0 at standstill, 1 between, 2 while cruising, of every segment."""
    half = SEGMENT / 2 / ANALYSIS_RATE_HZ
    return np.asarray(moving.astype(np.int64) + course.cruising_at(middle - half, middle + half))


def _change(power: Array, frequency: Array, middle: Array, states: NDArray[np.int64]) -> Unexplained | None:
    """The octave whose level is most beside the usual one of its state of motion."""
    centres, level = _octaves(power, frequency)
    usual = np.empty_like(level)
    for state in np.unique(states):
        usual[states == state] = np.median(level[states == state], axis=0)
    times = level.mean(axis=0) / np.maximum(usual.mean(axis=0), 1e-300)
    best = int(np.argmax(times))
    when = float(middle[np.argmax(level[:, best] / np.maximum(usual[:, best], 1e-300))])
    return _unexplained("time", float(times[best]), time_s=when, frequency_hz=float(centres[best]))


def _noise(power: Array, frequency: Array, moving: Mask) -> Unexplained | None:
    """Noise at standstill, and the octave in which it is loudest, where the axis adds less than a third of it, also
    where it is loud: one that mostly creeps is heard at its fast strokes."""
    if min(moving.sum(), (~moving).sum()) < LEAST:
        return None
    inside = (frequency >= LOWEST_HZ) & (frequency <= HIGHEST_HZ)
    total = power[:, inside].sum(axis=1)
    moves, rests = float(np.quantile(total[moving], LOUD)), float(np.median(total[~moving]))
    centres, level = _octaves(power[~moving], frequency)
    loudest = float(centres[np.argmax(np.median(level, axis=0) * centres)])
    return _unexplained("frequency", moves / max(moves - rests, 1e-9 * moves), frequency_hz=loudest)
