"""Orders of bearings where telemetry gives the angle of the motor at every sample of the sound."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import butter, hilbert, medfilt, sosfiltfilt

from sim.axis import Axis
from sim.chain_model import Array
from sim.discrepancy.measurement import Measurement
from sim.discrepancy.sound_evidence import Heard

PER_TURN = 128  # samples of the envelope per revolution of the motor
LOWEST_ORDER, HIGHEST_ORDER = 1.2, 30.0  # below, what stands still in Hz at constant speed looks like an order
HIGHEST_HZ = 1500.0
LINE = 10.0  # power of a line over the local median; of 10,000 exponential bins the largest is near 10 / ln 2 = 14
LEAST_LINES = 3  # of the first `HARMONICS`
LEAST_SCORE = 6.5  # sum of ln(height / LINE); without a bearing or a damaged tooth 80 recordings reach 6 at most
WEAK_SCORE = 2.0  # where the first `LEAST_LINES` are lines, the first not far below the largest, nothing fixed near
WEAK_ORDER = 2.0
WEAK_FIRST = 0.5
WEAK_FIXED = 2.0
WEAK_BESIDE = 10.0  # times as loud: beside what is fixed in Hz a weak one may be what that and gears make together
SURE, WEAK = 0.95, 0.85  # probabilities of a bearing
SCORE_AMONG_LINES = 10.0  # where something fixed in Hz is louder than all that turns, and leaves lines everywhere
LOWEST_FIXED_HZ, HIGHEST_FIXED_HZ = 4.0, 100.0
FIXED = 4.0  # times as high over time as over the path: what is fixed in Hz is no order
SLIP = 0.004  # of a bearing's balls, by which its order is uncertain
DRIFT = 0.01  # of the cruising speed
HARMONICS = 5
BANDS = ((0.08, 0.25), (0.25, 0.5), (0.5, 0.9))  # of half the rate
CRUISE = 0.8  # of the largest speed


def bearing_along_path(axis: Axis, values: Array, rate_hz: float, m: Measurement, offset_s: float) -> list[Heard]:
    """Lines of the envelope over the motor's path at one order and its multiples that no gear explains.

    A family counts by all of its lines together: those of a weak defect hardly stand out one by one. A line that a
    gear explains counts for none.
    """
    (orders, heights), (spacing_hz, over_time) = envelopes(values, rate_hz, m, offset_s)
    if orders.size == 0:
        return []
    spacing = float(orders[1])
    cruising = np.abs(m.speed) > CRUISE * float(np.abs(m.speed).max())
    turns_per_s = float(np.median(np.abs(m.speed[cruising]))) / (2.0 * math.pi)
    lowest = int(LOWEST_FIXED_HZ / spacing_hz)
    at_fixed = lowest + int(np.argmax(over_time[lowest : int(HIGHEST_FIXED_HZ / spacing_hz)]))
    loudest_fixed = over_time[at_fixed]
    among_lines = loudest_fixed >= heights[orders < 4.0 * HIGHEST_ORDER].max()
    least = SCORE_AMONG_LINES if among_lines else LEAST_SCORE
    best = (0.0, 0.0, 0)
    for index in np.flatnonzero((orders > LOWEST_ORDER) & (orders < HIGHEST_ORDER) & (heights > LINE)):
        order = _centre(orders, heights, int(index), spacing)
        if _of_gears(axis, order, spacing) or _is_whole(order, spacing) or _of_a_comb(axis, heights, order, spacing):
            continue
        numbers = range(1, HARMONICS + 1)
        found = [_height(heights, k * order / spacing, 1 + k // 2) for k in numbers]
        lines = [k for k in numbers if found[k - 1] > LINE and not _of_gears(axis, k * order, spacing)]
        score = sum(math.log(found[k - 1] / LINE) for k in lines)
        weak = score < least
        if weak and (among_lines or score < WEAK_SCORE or not _begins(order, lines, found)):
            continue
        if weak and loudest_fixed > WEAK_BESIDE * max(found):
            continue
        if len(lines) < LEAST_LINES or score < best[0]:
            continue
        if loudest_fixed > max(found) and _follows(order * turns_per_s / spacing_hz, at_fixed):
            continue
        places = {k: k * order * turns_per_s / spacing_hz for k in lines}
        fixed = [_height(over_time, at, 2 + int(DRIFT * at)) / found[k - 1] for k, at in places.items()]
        if np.median(fixed) < (WEAK_FIXED if weak else FIXED):
            best = (score, order, len(lines))
    if not best[2]:
        return []
    order = _refined(orders, heights, best[1], spacing)
    half = max(1.5 * spacing, SLIP * order)
    text = (
        f"Impacts come {order:.2f} times per revolution of the motor, with {best[2] - 1} multiples and a little slip: "
        "no gear has this order; a rolling bearing does."
    )
    probability = SURE if best[0] >= least else WEAK
    return [Heard("bearing_defect", None, probability, {"order": (order, order - half, order + half)}, text)]


def _begins(order: float, lines: list[int], found: list[float]) -> bool:
    """Whether the first multiples of an order are all lines and the very first is among the largest: impacts."""
    first = list(range(1, LEAST_LINES + 1))
    return order > WEAK_ORDER and lines[:LEAST_LINES] == first and found[0] >= WEAK_FIRST * max(found)


def _follows(at: float, fixed: int) -> bool:
    """Whether a line may be a higher multiple of half of one that is fixed in Hz, both in bins at cruising speed."""
    half = 0.5 * fixed
    return at > 1.2 * fixed and abs(at - round(at / half) * half) <= 2.0 + SLIP * at


def _is_whole(order: float, spacing: float) -> bool:
    """Whether an order may be a whole number: that is the motor's own, as of its poles and slots."""
    return abs(order - round(order)) <= max(1.5 * spacing, SLIP * order)


def _of_a_comb(axis: Axis, heights: Array, order: float, spacing: float) -> bool:
    """Whether an order is one of many multiples of a shaft's turn that are heard: a tooth that hits once per turn.

    Of shafts whose multiples lie well apart.
    """
    turn = 1.0
    for stage in axis.stages:
        turn /= stage.ratio
        number = round(order / turn)
        if turn < 10.0 * spacing or abs(order - number * turn) > 2.5 * spacing + 0.001 * order:
            continue
        beside = [_height(heights, (number + k) * turn / spacing, 2) for k in (-2, -1, 1, 2)]
        alike = max(LINE, 0.3 * _height(heights, order / spacing, 1))
        if sum(height > alike for height in beside) >= 2:
            return True
    return False


def envelopes(
    values: Array, rate_hz: float, m: Measurement, offset_s: float
) -> tuple[tuple[Array, Array], tuple[float, Array]]:
    """Power of the envelope over its local median, best of three bands: over the path and over time.

    Orders per motor revolution (k,) and heights (k,), empty where the motor hardly turns; spacing [Hz] and heights.
    """
    time = np.arange(values.size) / rate_hz + offset_s
    inside = (time >= m.time_s[0]) & (time <= m.time_s[-1])
    speed = np.abs(np.interp(time[inside], m.time_s, m.speed))
    path = np.cumsum(speed) / rate_hz / (2.0 * math.pi)
    if path.size < rate_hz or path[-1] < 20.0:
        return (np.zeros(0), np.zeros(0)), (1.0, np.zeros(0))
    grid = np.arange(0.0, path[-1], 1.0 / PER_TURN)
    spacing_hz = rate_hz / path.size
    along, over_time = np.zeros(grid.size // 2 + 1), np.zeros(int(min(HIGHEST_HZ, 0.5 * rate_hz) / spacing_hz))
    for low, high in BANDS:
        sos = butter(4, (0.5 * low * rate_hz, 0.5 * high * rate_hz), "bandpass", fs=rate_hz, output="sos")
        envelope = np.abs(hilbert(sosfiltfilt(sos, values)))
        width = int(0.25 * rate_hz) | 1
        envelope = envelope / (np.convolve(envelope, np.ones(width) / width, "same") + 1e-12) - 1.0
        envelope = np.minimum(envelope[inside], 12.0)
        along = np.maximum(along, _over_median(np.interp(grid, path, envelope), along.size))
        over_time = np.maximum(over_time, _over_median(envelope, over_time.size))
    return (np.arange(along.size) * PER_TURN / grid.size, along), (spacing_hz, over_time)


def _over_median(values: Array, count: int) -> Array:
    """The first `count` powers of a spectrum, over their running median."""
    power = np.abs(np.fft.rfft(values * np.hanning(values.size))[:count]) ** 2
    return np.asarray(power / np.maximum(medfilt(power, 401), 1e-300))


def _height(heights: Array, at: float, reach: int) -> float:
    low = max(round(at) - reach, 0)
    return float(heights[low : round(at) + reach + 1].max()) if low < heights.size - 2 else 0.0


def _centre(orders: Array, heights: Array, index: int, spacing: float) -> float:
    part = slice(max(index - 1, 0), index + 2)
    return float((orders[part] * heights[part]).sum() / heights[part].sum())


def _refined(orders: Array, heights: Array, order: float, spacing: float) -> float:
    """Mean of the multiples over their number, weighted by height and number."""
    total = weight = 0.0
    for k in range(1, HARMONICS + 1):
        at = round(k * order / spacing)
        low = max(at - 2, 1)
        part = heights[low : at + 3]
        if part.size and part.max() > LINE:
            peak = low + int(np.argmax(part))
            total += k * float(orders[peak])
            weight += k * k
    return total / weight if weight else order


def _of_gears(axis: Axis, order: float, spacing: float) -> bool:
    """Whether an order per motor revolution is a multiple of the motor's turn, of a shaft next to it or of a mesh."""
    turn = 1.0
    known: list[float] = []
    for stage in axis.stages:
        if stage.driver_teeth:
            known.append(stage.driver_teeth * turn)
        turn /= stage.ratio
        known.append(turn)
        if stage.driven_teeth:
            known.append(stage.driven_teeth * turn)
    tolerance = 2.5 * spacing + 0.001 * order
    return abs(order - round(order)) < tolerance or any(
        abs(order - round(order / one) * one) < tolerance and round(order / one) >= 1 and round(order / one) <= 12
        for one in known
    )
