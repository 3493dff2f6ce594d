"""Power of the sound's envelope over the path of the motor, by orders: what strikes so many times per turn.

The envelope of each band is taken over the path, measured or known from lines of teeth while cruising, and its power
averaged over pieces of the path (Welch 1967).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import find_peaks, spectrogram, welch
from scipy.special import gammainccinv, gammaincinv

from signals.analysis import ANALYSIS_RATE_HZ, Analysis
from signals.band import Band
from sim.chain.model import Array
from sim.description.axis import Axis

if TYPE_CHECKING:
    from sim.investigation.acoustic.operating_states import Course, Mask

LEVEL_BAND_HZ = (150.0, 3_600.0)
CELL = 0.01  # relative: half as wide as a mode of little damping
SEGMENT = 1_024  # 0.13 s: shorter than what a motion takes to reach its speed
LEAST_SEGMENTS = 12
LEAST_AT_REST = 4


@dataclass(frozen=True, eq=False)
class Levels:
    """Mean level in each cell [dB], shape (cells,); None where that lasts too short."""

    cruising: Array | None = None
    speeding: Array | None = None
    resting: Array | None = None


def cells() -> Array:
    """Centres of cells of a constant share of their frequency [Hz], shape (cells,)."""
    count = int(math.log(LEVEL_BAND_HZ[1] / LEVEL_BAND_HZ[0]) / CELL)
    return np.asarray(LEVEL_BAND_HZ[0] * np.exp(CELL * np.arange(count, dtype=np.float64)))


def levels_of(course: Course) -> Levels:
    """Levels of a recording; none without a standstill."""
    samples = course.analysis.samples
    if course.moving is None or samples.size < 2 * SEGMENT:
        return Levels()
    frequency, time, power = spectrogram(samples, ANALYSIS_RATE_HZ, "hann", SEGMENT, SEGMENT * 3 // 4)
    half = 0.5 * SEGMENT / ANALYSIS_RATE_HZ
    moves = [course.moving_at(time + part * half) for part in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    speeding = moves[2] & ~course.cruising_at(time, time)

    def mean(chosen: Mask, least: int) -> Array | None:
        if chosen.sum() < least:
            return None
        return _in_cells(frequency, (10.0 * np.log10(power[:, chosen] + 1e-30)).mean(axis=1))

    return Levels(
        mean(course.cruising_at(time - half, time + half), LEAST_SEGMENTS),
        mean(speeding, LEAST_SEGMENTS),
        mean(~np.any(moves, axis=0), LEAST_AT_REST),
    )


def _in_cells(frequency: Array, level: Array) -> Array:
    """Mean over each cell, by the integral of the curve through the levels."""
    area = np.concatenate(([0.0], np.cumsum(0.5 * (level[1:] + level[:-1])))) * frequency[1]
    edges = np.exp(np.array([[-0.5], [0.5]]) * CELL) * cells()
    return np.asarray(np.diff(np.interp(edges, frequency, area), axis=0)[0] / np.diff(edges, axis=0)[0])


DESCRIBED_WITHIN = 0.15  # of the described speed: payload and override
TRANSFORM = 65_536  # 0.12 Hz at 8 kHz: below what a cruise resolves
SURROUNDINGS_HZ = 16.0  # modes of a housing are wider, lines of constant speed narrower
BAND_HZ = (20.0, 3_700.0)
LARGEST_TURN = 4.4 * math.pi  # of a joint from end to end [rad]
SLOWEST_RAD_S = 0.1  # of the load; a robot that cruises slower makes no sound
CLEAR = 2.5  # logarithm of height that makes a mesh: twelve times the sound beside it
STRUCTURE_HZ = LEVEL_BAND_HZ[0]  # below, arms and housings sing as narrowly as teeth
MULTIPLES = np.array([1.0, 2.0, 3.0])


def mesh_orders(axis: Axis) -> tuple[float, ...]:
    """Tooth contacts of every stage with known teeth per revolution of the motor."""
    turn, orders = 1.0, []
    for stage in axis.stages:
        if stage.driver_teeth is not None:
            orders.append(turn * stage.driver_teeth)
        turn /= stage.ratio
    return tuple(orders)


def over_surroundings(values: Array, rate_hz: float, surroundings_hz: float = SURROUNDINGS_HZ) -> Array:
    """Power spectrum of a stretch over its own median in frequency; 1 is the mean of noise."""
    values = values[:TRANSFORM] - values.mean()
    power = np.abs(np.fft.rfft(values * np.hanning(values.size), TRANSFORM)) ** 2
    step = 8  # the floor needs no finer grid
    width = max(5, round(surroundings_hz / rate_hz * TRANSFORM / step)) | 1
    floor = median_filter(power[::step], width, mode="nearest")
    floor = np.interp(np.arange(power.size), np.arange(floor.size) * step, floor) / math.log(2.0)
    return np.asarray(power / np.maximum(floor, 1e-300))


def mesh_speed(axis: Axis, spectrum: Array, averages: int, cruise_s: float, described: float | None) -> float | None:
    """Speed of the motor [1/s] for which the strongest lines are those of the meshes; None where no line is one.

    `spectrum` (m,) is noise of mean 1 averaged `averages` times, and lines; `cruise_s`: time at that speed in one way;
    only speeds near a described one count.
    """
    lines, height = spectrum_lines(spectrum, averages)
    orders = np.array(mesh_orders(axis))
    if not lines.size or not orders.size:
        return None
    speeds = (lines[:, None] / orders).ravel()
    load = speeds * 2.0 * math.pi / axis.ratio
    able = (load >= SLOWEST_RAD_S) & (load * cruise_s <= LARGEST_TURN)
    if described is not None:
        able &= np.abs(speeds / described - 1.0) < DESCRIBED_WITHIN
    places = speeds[:, None] * np.outer(orders, MULTIPLES).ravel()
    near = np.abs(places[:, :, None] - lines) < np.maximum(0.6, 1.5e-3 * places)[:, :, None]
    found = np.where(near, height, 0.0).max(axis=2) / np.tile(MULTIPLES, orders.size)
    score = found.sum(axis=1)
    own = np.repeat(height, orders.size)
    counted = score - np.where(np.repeat(lines, orders.size) > STRUCTURE_HZ, 0.0, own)
    score = np.where(able & (counted > CLEAR), score, 0.0)
    return float(speeds[np.argmax(score)]) if score.any() else None


def spectrum_lines(spectrum: Array, averages: int) -> tuple[Array, Array]:
    """Frequencies [Hz] and logarithms of height of the lines that noise would not make, 3 Hz apart: both (n,)."""
    spacing = ANALYSIS_RATE_HZ / TRANSFORM
    low, high = (round(edge / spacing) for edge in BAND_HZ)
    log = np.log(np.maximum(spectrum[low:high], 1e-300))
    limit = math.log(gamma_limit(averages, (high - low) / 8.0))
    peaks, _ = find_peaks(log, height=limit, distance=3.0 / spacing)
    left, middle, right = (log[peaks + k] for k in (-1, 0, 1))
    bend = np.minimum(left - 2.0 * middle + right, -1e-300)
    return (low + peaks + 0.5 * (left - right) / bend) * spacing, middle


def gamma_limit(averages: int, places: float, alpha: float = 0.005) -> float:
    """What the mean of `averages` exponential powers of mean 1 exceeds somewhere among `places` with chance alpha."""
    return float(gammainccinv(averages, alpha / max(places, 1.0)) / averages)


BANDS = (Band.MIDDLE, Band.HIGH)
PER_TURN = 128  # samples of the envelope per turn of the motor
PIECE_TURNS = 64.0
LEAST_TURNS = 8.0
LEVEL_S = 0.25  # over which the envelope is taken relative to its mean
PEAK = 12.0  # times the mean, to which the envelope is cut: one knock is no rhythm
FLOOR_BINS = 201


@dataclass(frozen=True, eq=False)
class OrderSpectra:
    """Mean power of `averages` pieces, 1 for noise, in all bands: (bands, m), at `orders` (m,) per turn of the motor.

    `along`: over the path; `fixed`: over time, at orders of the usual speed, where what is fixed in hertz is a line.
    """

    orders: Array
    along: Array
    fixed: Array
    averages: int

    @property
    def step(self) -> float:
        """Distance of two orders."""
        return float(self.orders[1])


def order_spectra(analysis: Analysis, turns_per_s: Array) -> OrderSpectra | None:
    """Spectra of a recording from the speeds (n,) at its samples; None where the motor turns too little."""
    path = np.cumsum(turns_per_s) / ANALYSIS_RATE_HZ
    envelopes = [whole for band in BANDS if (whole := analysis.envelope(band)) is not None]
    if path[-1] < LEAST_TURNS or not envelopes:
        return None
    usual = float(np.median(turns_per_s[turns_per_s > 0.8 * turns_per_s.max()]))
    size = int(min(PIECE_TURNS, 0.5 * path[-1]) * PER_TURN)
    averages = max(1, 2 * int(path[-1] * PER_TURN) // size - 1)
    along, fixed = [], []
    for whole in envelopes:
        envelope = np.sqrt(whole.inside().astype(np.float64))
        level = uniform_filter1d(envelope, round(LEVEL_S * whole.rate_hz))
        envelope = np.minimum(envelope / np.maximum(level, 1e-12) - 1.0, PEAK)
        time: Array = (np.arange(envelope.size) + 0.5) / whole.rate_hz
        place = np.interp(time * ANALYSIS_RATE_HZ, np.arange(path.size), path)
        along.append(_power(place, envelope, size, averages))
        fixed.append(_power(time * usual, envelope, size, averages))
    orders: Array = np.arange(size // 2 + 1) * PER_TURN / size
    return OrderSpectra(orders, np.array(along), np.array(fixed), averages)


def _power(place: Array, envelope: Array, size: int, averages: int) -> Array:
    """Power over its own median, of an envelope at places (n,) of the path."""
    grid: Array = np.arange(place[0], max(place[-1], size / PER_TURN), 1.0 / PER_TURN)
    _, power = welch(np.interp(grid, place, envelope), PER_TURN, "hann", size)
    floor = median_filter(power, FLOOR_BINS, mode="nearest") * averages / gammaincinv(averages, 0.5)
    return np.asarray(power / np.maximum(floor, 1e-300))
