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
LINE = 40.0  # power of a line over the local median: of 10,000 exponential bins the largest is near 10 ln 2 = 14
SLIP = 0.004  # of a bearing's balls, by which its order is uncertain
HARMONICS = 5


def bearing_along_path(axis: Axis, values: Array, rate_hz: float, m: Measurement, offset_s: float) -> list[Heard]:
    """Lines of the envelope over the motor's path at one order and its multiples that no gear explains."""
    orders, heights = _envelope_orders(values, rate_hz, m, offset_s)
    if orders.size == 0:
        return []
    spacing = float(orders[1])
    best = (0.0, 0.0, 0)
    grid = np.flatnonzero((orders > 0.4) & (orders < HIGHEST_ORDER) & (heights > LINE))
    for index in grid:
        order = _centre(orders, heights, int(index), spacing)
        if _of_gears(axis, order, spacing) or _is_whole(order, spacing):
            continue
        found = [_height(heights, k * order / spacing, 1 + k // 2) for k in range(1, HARMONICS + 1)]
        count = sum(h > LINE for h in found)
        score = sum(math.log(max(h / LINE, 1.0)) for h in found)
        if count >= 2 and order > LOWEST_ORDER and found[0] > LINE and score > best[0]:
            best = (score, order, count)
    if best[2] < 2 or _fixed_line(values, rate_hz) > float(heights[orders < 4.0 * HIGHEST_ORDER].max()):
        return []
    order = _refined(orders, heights, best[1], spacing)
    half = max(1.5 * spacing, SLIP * order)
    text = (
        f"Impacts come {order:.2f} times per revolution of the motor, with {best[2]} multiples and a little slip: "
        "no gear has this order; a rolling bearing does."
    )
    return [Heard("bearing_defect", None, 0.95, {"order": (order, order - half, order + half)}, text)]


def _is_whole(order: float, spacing: float) -> bool:
    """Whether an order may be a whole number: that is the motor's own, as of its poles and slots."""
    return abs(order - round(order)) <= max(1.5 * spacing, SLIP * order)


def _envelope_orders(values: Array, rate_hz: float, m: Measurement, offset_s: float) -> tuple[Array, Array]:
    """Orders per motor revolution and the envelope's power over its local median, best of three bands."""
    time = np.arange(values.size) / rate_hz + offset_s
    inside = (time >= m.time_s[0]) & (time <= m.time_s[-1])
    speed = np.abs(np.interp(time[inside], m.time_s, m.speed))
    path = np.cumsum(speed) / rate_hz / (2.0 * math.pi)
    if path.size < rate_hz or path[-1] < 20.0:
        return np.zeros(0), np.zeros(0)
    grid = np.arange(0.0, path[-1], 1.0 / PER_TURN)
    total = np.zeros(grid.size // 2 + 1)
    nyquist = 0.5 * rate_hz
    for low, high in ((0.08, 0.25), (0.25, 0.5), (0.5, 0.9)):
        sos = butter(4, (low * nyquist, high * nyquist), "bandpass", fs=rate_hz, output="sos")
        envelope = np.abs(hilbert(sosfiltfilt(sos, values)))
        width = int(0.25 * rate_hz) | 1
        envelope = envelope / (np.convolve(envelope, np.ones(width) / width, "same") + 1e-12) - 1.0
        along = np.interp(grid, path, np.minimum(envelope[inside], 12.0))
        power = np.abs(np.fft.rfft(along * np.hanning(grid.size))) ** 2
        total = np.maximum(total, power / np.maximum(medfilt(power, 401), 1e-300))
    return np.arange(total.size) * PER_TURN / grid.size, total


def _fixed_line(values: Array, rate_hz: float) -> float:
    """Height of the strongest line of the envelope over time: what is fixed in Hz is no order."""
    sos = butter(4, (0.08 * 0.5 * rate_hz, 0.45 * rate_hz), "bandpass", fs=rate_hz, output="sos")
    envelope = np.abs(hilbert(sosfiltfilt(sos, values)))
    power = np.abs(np.fft.rfft((envelope - envelope.mean()) * np.hanning(values.size))) ** 2
    spacing = rate_hz / values.size
    part = power[: int(100.0 / spacing)]
    ratio = part / np.maximum(medfilt(part, 401), 1e-300)
    return float(ratio[int(4.0 / spacing) :].max())


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
    """Whether an order per motor revolution is a multiple of a shaft next to the motor or of a mesh."""
    turn = 1.0
    known = [1.0]
    for stage in axis.stages:
        if stage.driver_teeth:
            known.append(stage.driver_teeth * turn)
        turn /= stage.ratio
        known.append(turn)
        if stage.driven_teeth:
            known.append(stage.driven_teeth * turn)
    tolerance = 2.5 * spacing + 0.001 * order
    return any(
        abs(order - round(order / one) * one) < tolerance and round(order / one) >= 1 and round(order / one) <= 12
        for one in known
    )
