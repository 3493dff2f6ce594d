"""Orders of bearings where telemetry gives the angle of the motor at every sample of the sound."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, hilbert, medfilt, sosfiltfilt

from sim.description.axis import Axis
from sim.discrepancy.acoustic.evidence import AcousticFinding
from sim.discrepancy.acoustic.harmonic_comb import slipping_comb
from sim.discrepancy.acoustic.operating_states import Mask
from sim.discrepancy.data.preprocessing import Measurement
from sim.mechanisms import BearingDefect
from sim.torsional.model import Array

PER_TURN = 128  # samples of the envelope per revolution of the motor
LOWEST_ORDER, HIGHEST_ORDER = 1.2, 30.0  # below, what stands still in Hz at constant speed looks like an order
LOWEST_WEAK = 2.0
HIGHEST_HZ = 1500.0
LINE = 10.0  # power of a line over the local median; of 10,000 exponential bins the largest is near 10 / ln 2 = 14
LEAST_LINES = 3  # of the first `HARMONICS`
LEAST_SCORE = 6.5  # sum of ln(height / LINE); without a bearing or a damaged tooth 80 recordings reach 6 at most
SCORE_AMONG_LINES = 10.0  # where something fixed in Hz is louder than all that turns, and leaves lines everywhere
LEAST_TOGETHER = 6.0  # nats by chance; of 574 recordings without a bearing or a fault of teeth 573 have 4.7 at most
SURE, WEAK = 0.95, 0.85  # probabilities of a bearing
LOWEST_FIXED_HZ, HIGHEST_FIXED_HZ = 4.0, 100.0
FIXED, FIXED_WEAK = 4.0, 2.0  # times as high over time as over the path: what is fixed in Hz is no order
SLIP = 0.004  # of a bearing's balls, by which its order is uncertain
DRIFT = 0.01  # of the cruising speed
HARMONICS = 5
BANDS = ((0.08, 0.25), (0.25, 0.5), (0.5, 0.9), (0.05, 0.95))  # of half the rate; the last with an even spectrum
EVEN_BINS = 201  # of a spectrum, over which it is made even
CRUISE = 0.8  # of the largest speed


@dataclass(frozen=True, eq=False)
class Envelopes:
    """Power of the envelope over its local median in each of `BANDS`.

    `along` (bands, m): over the path, at multiples of `step` orders per revolution of the motor; `over_time` (bands,
    n): at multiples of `spacing_hz`, up to `HIGHEST_HZ`. `turns_per_s`: of the motor while cruising [1/s].
    """

    along: Array
    step: float
    over_time: Array
    spacing_hz: float
    turns_per_s: float

    @property
    def orders(self) -> Array:
        """Orders per revolution of the motor (m,)."""
        return np.asarray(np.arange(self.along.shape[1]) * self.step)

    @cached_property
    def heights(self) -> Array:
        """The highest of all bands over the path (m,)."""
        return np.asarray(self.along.max(axis=0))

    @cached_property
    def fixed(self) -> Array:
        """The highest of all bands over time (n,)."""
        return np.asarray(self.over_time.max(axis=0))

    @property
    def top(self) -> float:
        """Highest order that is looked at over time as well, while cruising."""
        return self.fixed.size * self.spacing_hz / max(self.turns_per_s, 1e-9)

    def bins_of(self, order: float) -> float:
        """Where an order lies over time while cruising, in bins."""
        return order * self.turns_per_s / self.spacing_hz


def bearing_along_path(
    axis: Axis, values: Array, rate_hz: float, m: Measurement, offset_s: float
) -> list[AcousticFinding]:
    """Lines of the envelope over the motor's path at one order and its multiples that no gear explains.

    A family counts by all of its lines together: those of a weak defect hardly stand out one by one.
    """
    heard = envelopes(values, rate_hz, m, offset_s)
    if heard is None:
        return []
    order, count = _lines(axis, heard)
    probability = SURE
    if not count:
        order, count = _together(axis, heard)
        probability = WEAK
    if not count:
        return []
    half = max(1.5 * heard.step, SLIP * order)
    text = (
        f"Impacts come {order:.2f} times per revolution of the motor, with {count - 1} multiples and a little slip: "
        "no gear has this order; a rolling bearing does."
    )
    return [
        AcousticFinding(BearingDefect.name, None, probability, {"order": (order, order - half, order + half)}, text)
    ]


def _lines(axis: Axis, heard: Envelopes) -> tuple[float, int]:
    """Order of the family whose lines stand out most one by one, and of how many; 0 where there is none.

    A line that a gear explains counts for none.
    """
    orders, heights, over_time, spacing = heard.orders, heard.heights, heard.fixed, heard.step
    lowest = int(LOWEST_FIXED_HZ / heard.spacing_hz)
    at_fixed = lowest + int(np.argmax(over_time[lowest : int(HIGHEST_FIXED_HZ / heard.spacing_hz)]))
    loudest_fixed = over_time[at_fixed]
    among_lines = loudest_fixed >= heights[orders < 4.0 * HIGHEST_ORDER].max()
    best = (SCORE_AMONG_LINES if among_lines else LEAST_SCORE, 0.0, 0)
    for index in np.flatnonzero((orders > LOWEST_ORDER) & (orders < HIGHEST_ORDER) & (heights > LINE)):
        order = _centre(orders, heights, int(index), spacing)
        if _of_gears(axis, order, spacing) or _is_whole(order, spacing) or _of_a_comb(axis, heights, order, spacing):
            continue
        numbers = range(1, HARMONICS + 1)
        found = [_height(heights, k * order / spacing, 1 + k // 2) for k in numbers]
        lines = [k for k in numbers if found[k - 1] > LINE and not _of_gears(axis, k * order, spacing)]
        score = sum(math.log(found[k - 1] / LINE) for k in lines)
        if len(lines) < LEAST_LINES or score < best[0]:
            continue
        if loudest_fixed > max(found) and _follows(heard.bins_of(order), at_fixed):
            continue
        fixed = [_fixed(over_time, heard.bins_of(k * order)) / found[k - 1] for k in lines]
        if np.median(fixed) < FIXED:
            best = (score, order, len(lines))
    _, order, count = best
    return (_refined(orders, heights, order, spacing), count) if count else (0.0, 0)


def _together(axis: Axis, heard: Envelopes) -> tuple[float, int]:
    """Order of the family whose lines stand out together, and of how many; 0 where there is none."""
    of_gears = _near_gears(axis, heard.orders, heard.step)
    bases = (LOWEST_WEAK, HIGHEST_ORDER)
    best = (LEAST_TOGETHER, 0.0, 0)
    for along, over_time in zip(heard.along, heard.over_time, strict=True):
        score, order, count = slipping_comb(math.log(2.0) * along, heard.step, of_gears, bases, heard.top)
        if score < best[0] or _is_whole(order, heard.step) or _of_a_comb(axis, along, order, heard.step):
            continue
        numbers = range(1, min(HARMONICS, int(heard.orders[-2] / order)) + 1)
        found = [_height(along, k * order / heard.step, 1 + k // 2) for k in numbers]
        fixed = [_fixed(over_time, heard.bins_of(k * order)) / height for k, height in enumerate(found, 1)]
        if np.median(fixed) < FIXED_WEAK:
            best = (score, order, count)
    return best[1:]


def _fixed(over_time: Array, at: float) -> float:
    return _height(over_time, at, 2 + int(DRIFT * at))


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


def envelopes(values: Array, rate_hz: float, m: Measurement, offset_s: float) -> Envelopes | None:
    """Spectra of the envelope; None where the motor hardly turns."""
    time = np.arange(values.size) / rate_hz + offset_s
    inside = (time >= m.time_s[0]) & (time <= m.time_s[-1])
    speed = np.abs(np.interp(time[inside], m.time_s, m.speed))
    path = np.cumsum(speed) / rate_hz / (2.0 * math.pi)
    if path.size < rate_hz or path[-1] < 20.0:
        return None
    grid = np.arange(0.0, path[-1], 1.0 / PER_TURN)
    spacing_hz = rate_hz / path.size
    along, over_time = [], []
    for low, high in BANDS:
        band = (0.5 * low * rate_hz, 0.5 * high * rate_hz)
        sos = butter(4, band, "bandpass", fs=rate_hz, output="sos")
        sound = _evened(values) if (low, high) == BANDS[-1] else values
        envelope = np.abs(hilbert(sosfiltfilt(sos, sound)))
        width = int(0.25 * rate_hz) | 1
        envelope = envelope / (np.convolve(envelope, np.ones(width) / width, "same") + 1e-12) - 1.0
        envelope = np.minimum(envelope[inside], 12.0)
        along.append(_over_median(np.interp(grid, path, envelope), grid.size // 2 + 1))
        over_time.append(_over_median(envelope, int(min(HIGHEST_HZ, 0.5 * rate_hz) / spacing_hz)))
    cruising = np.abs(m.speed) > CRUISE * float(np.abs(m.speed).max())
    turns_per_s = float(np.median(np.abs(m.speed[cruising]))) / (2.0 * math.pi)
    return Envelopes(np.array(along), PER_TURN / grid.size, np.array(over_time), spacing_hz, turns_per_s)


def _evened(values: Array) -> Array:
    """The same sound with a spectrum that is even but for lines: modes of the housing carry impacts no more."""
    spectrum = np.fft.rfft(values)
    smooth = uniform_filter1d(medfilt(np.abs(spectrum), EVEN_BINS), EVEN_BINS)
    return np.fft.irfft(spectrum / np.maximum(smooth, 1e-12 * float(smooth.max()) + 1e-300), values.size)


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
    return bool(_near_gears(axis, np.array([order]), spacing)[0])


def _near_gears(axis: Axis, orders: Array, spacing: float) -> Mask:
    """The same of many orders, shape (m,)."""
    turn = 1.0
    known: list[float] = []
    for stage in axis.stages:
        if stage.driver_teeth:
            known.append(stage.driver_teeth * turn)
        turn /= stage.ratio
        known.append(turn)
        if stage.driven_teeth:
            known.append(stage.driven_teeth * turn)
    tolerance = 2.5 * spacing + 0.001 * orders
    near = np.abs(orders - np.round(orders)) < tolerance
    for one in known:
        multiple = np.clip(np.round(orders / one), 1.0, 12.0)
        near |= np.abs(orders - multiple * one) < tolerance
    return np.asarray(near)
