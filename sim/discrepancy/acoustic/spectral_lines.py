"""Lines of the teeth in the sound of a cruise, and the speed of the motor that they tell."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import gammainccinv

from casebase.signals.analysis import ANALYSIS_RATE_HZ
from sim.description.axis import Axis
from sim.torsional.model import Array

DESCRIBED_WITHIN = 0.15  # of the described speed: payload and override
TRANSFORM = 65_536  # 0.12 Hz at 8 kHz: below what a cruise resolves
SURROUNDINGS_HZ = 16.0  # modes of a housing are wider, lines of constant speed narrower
LOWEST_HZ, HIGHEST_HZ = 20.0, 3_700.0
LARGEST_TURN = 4.4 * math.pi  # of a joint from end to end [rad]
SLOWEST_RAD_S = 0.1  # of the load; a robot that cruises slower makes no sound
STRONGEST = 60
CLEAR = 2.5  # logarithm of height that makes a single line a mesh: twelve times the sound beside it
STRUCTURE_HZ = 150.0  # below, arms and housings sing as narrowly as teeth
PULSES = 6  # a line with so many multiples of its own strength is a train of pulses, not teeth


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


def heard_speed(
    axis: Axis,
    orders: tuple[float, ...],
    spectrum: Array,
    averages: int,
    cruise_s: float,
    described: float | None = None,
) -> float | None:
    """Speed of the motor [1/s] for which the strongest lines are those of the meshes; None where no line is one.

    `spectrum` is noise of mean 1 averaged `averages` times, and lines; only speeds near a described one count.
    """
    spacing = ANALYSIS_RATE_HZ / TRANSFORM
    lines = spectrum_lines(spectrum, averages, spacing)
    best: tuple[float, float] | None = None
    for frequency, height in lines:
        if _is_pulse(frequency, lines):
            continue
        for order in orders:
            speed = frequency / order
            load = speed * 2.0 * math.pi / axis.ratio
            near = described is None or abs(speed / described - 1.0) < DESCRIBED_WITHIN
            if not near or load < SLOWEST_RAD_S or load * cruise_s > LARGEST_TURN:
                continue
            others = sum(_near(o * k * speed, lines) / k for o in orders for k in (1, 2, 3) if o * k != order)
            alone = frequency > STRUCTURE_HZ and height > CLEAR
            score = height + others
            if (alone or others > CLEAR) and (best is None or score > best[0]):
                best = (score, speed)
    return None if best is None else best[1]


def spectrum_lines(spectrum: Array, averages: int, spacing: float) -> list[tuple[float, float]]:
    """Frequency [Hz] and logarithm of height of the strongest lines that noise would not make."""
    low, high = round(LOWEST_HZ / spacing), round(HIGHEST_HZ / spacing)
    part = spectrum[low:high]
    limit = gamma_limit(averages, (high - low) / 8.0)
    peaks = np.flatnonzero((part[1:-1] > limit) & (part[1:-1] >= part[:-2]) & (part[1:-1] > part[2:])) + 1
    strongest = peaks[np.argsort(-part[peaks], kind="stable")]
    kept: list[tuple[float, float]] = []
    for k in strongest:
        frequency = (low + _vertex(part, int(k))) * spacing
        if all(abs(frequency - f) > 3.0 for f, _ in kept):  # the window's own side lobes
            kept.append((frequency, math.log(float(part[k]))))
        if len(kept) == STRONGEST:
            break
    return kept


def gamma_limit(averages: int, places: float, alpha: float = 0.005) -> float:
    """What the mean of `averages` exponential powers of mean 1 exceeds somewhere among `places` with chance alpha."""
    return float(gammainccinv(averages, alpha / max(places, 1.0)) / averages)


def _vertex(values: Array, k: int) -> float:
    left, middle, right = (math.log(values[k + d] + 1e-300) for d in (-1, 0, 1))
    bend = left - 2.0 * middle + right
    return k + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)


def _near(frequency: float, lines: list[tuple[float, float]]) -> float:
    tolerance = max(0.6, 1.5e-3 * frequency)
    return max((height for f, height in lines if abs(f - frequency) < tolerance), default=0.0)


def _is_pulse(frequency: float, lines: list[tuple[float, float]]) -> bool:
    """Whether a line is the k-th of a family of many lines of like strength, k up to 12."""
    own = _near(frequency, lines)
    for k in range(1, 13):
        base = frequency / k
        if base < 2.0 * LOWEST_HZ and k > 1:
            break
        found = [_near(base * n, lines) for n in range(1, 13) if base * n < HIGHEST_HZ]
        if sum(h > 0.5 * own for h in found) >= min(PULSES, len(found)) and len(found) >= PULSES:
            return True
    return False
