"""Lines of the teeth in the sound of a cruise, and the speed of the motor that they tell."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import find_peaks
from scipy.special import gammainccinv

from signals.analysis import ANALYSIS_RATE_HZ
from sim.chain.model import Array
from sim.description.axis import Axis

DESCRIBED_WITHIN = 0.15  # of the described speed: payload and override
TRANSFORM = 65_536  # 0.12 Hz at 8 kHz: below what a cruise resolves
SURROUNDINGS_HZ = 16.0  # modes of a housing are wider, lines of constant speed narrower
BAND_HZ = (20.0, 3_700.0)
LARGEST_TURN = 4.4 * math.pi  # of a joint from end to end [rad]
SLOWEST_RAD_S = 0.1  # of the load; a robot that cruises slower makes no sound
CLEAR = 2.5  # logarithm of height that makes a mesh: twelve times the sound beside it
STRUCTURE_HZ = 150.0  # below, arms and housings sing as narrowly as teeth
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
