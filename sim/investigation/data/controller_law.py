"""Noise of the torque channel, known by the law by which the drive asks for torque.

A drive makes its torque of a reference and of the motor's encoder.  Where the reference was recorded too, the record
itself shows by which law, and what the torque channel says beyond that law is its own noise: the axis does not feel it.
Adaptive noise cancelling (Widrow et al., Proc. IEEE 63 (1975) 1692) with the drive as the second sensor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import median_filter
from scipy.signal import butter, sosfiltfilt, welch

from sim.chain.model import Array
from sim.investigation.data.preprocessing import Measurement, smooth

LAW_CUT_HZ = 80.0  # up to here drive and encoder follow what the axis does
ERROR_DERIVATIVES, REFERENCE_DERIVATIVES = range(4), range(5)
WIDTHS = (0.001, 0.01, 0.05)  # of the largest speed, over which friction that the drive expects turns its sign
LATEST_S, LATE_STEP_S = 8e-3, 1e-3  # by which the torque channel may be late
SPECTRUM_S = 4.0
LINE, LINE_REACH = 30.0, 40  # times the median of the cells beside it, and how many of those: a line and no noise
BANDS_HZ = ((0.5, 4.0), (4.0, 10.0), (10.0, 25.0))
FOLLOWS = 0.15  # off one: what the model leaves must be the noise, in every band
KNOWN = 0.4  # standard deviation of that
LEAST_EDGE_HZ = 10.0  # up to where it must be at least
ROUNDS, FAR = 3, 5.0  # in which rows are left out that lie so many times the median away
LEFT = 0.2  # of the noise's amplitude
FEWEST_ROWS = 4000


@dataclass(frozen=True)
class DriveLaw:
    """What the torque channel says beyond the drive's law: `noise`, shape (n,) [N m].

    `unsure`, shape (n, p) [N m]: independent ways in which the law itself may be wrong, each by a standard deviation.
    """

    noise: Array
    unsure: Array


def drive_law(m: Measurement, rate_hz: float, torque: Array, angle: Array, reference: Array) -> DriveLaw | None:
    """The law in channels of shape (rows,) of which `m` was prepared; None for a record too short to tell."""
    margin, stride = round(m.time_s[0] * rate_hz), max(1, round(rate_hz / m.rate_hz))
    cut = min(LAW_CUT_HZ, 0.1 * rate_hz)

    def channel(values: Array, derivative: int) -> Array:
        return smooth(values, cut, rate_hz, derivative, margin)[::stride].copy()

    used = m.valid > 0.5
    if used.sum() < FEWEST_ROWS:
        return None
    asked, error = channel(torque, 0), reference - angle
    errors = [channel(error, k) for k in ERROR_DERIVATIVES]
    wanted = [channel(reference, k) for k in REFERENCE_DERIVATIVES]
    top = float(np.abs(wanted[1]).max())
    if top == 0.0:
        return None
    expected = [np.tanh(wanted[1] / (width * top)) for width in WIDTHS]
    even = [np.ones(m.samples), np.linspace(-1.0, 1.0, m.samples)]
    columns = np.stack([*errors, np.cumsum(errors[0]) / m.rate_hz, *wanted, *expected, *even], axis=1)
    best = min((_fitted(_late(columns, rows), asked, used) for rows in _delays(m)), key=lambda found: found[0])
    _, columns, numbers = best
    noise = asked - columns @ numbers
    spread = _spread(columns * used[:, None], noise * used, m.rate_hz)
    return DriveLaw(_without_lines(noise, m.rate_hz), columns @ spread)


def _delays(m: Measurement) -> range:
    return range(0, round(LATEST_S * m.rate_hz) + 1, max(1, round(LATE_STEP_S * m.rate_hz)))


def _late(columns: Array, rows: int) -> Array:
    return np.concatenate([np.repeat(columns[:1], rows, axis=0), columns[: columns.shape[0] - rows]])


def _fitted(columns: Array, asked: Array, used: NDArray[np.bool_]) -> tuple[float, Array, Array]:
    """Squares that are left, columns of unit size and their numbers."""
    columns = columns / np.maximum(np.abs(columns[used]).max(axis=0), 1e-300)
    numbers, *_ = np.linalg.lstsq(columns[used], asked[used], rcond=1e-10)
    left = asked[used] - columns[used] @ numbers
    return float(left @ left), columns, np.asarray(numbers, dtype=np.float64)


def _spread(columns: Array, noise: Array, rate_hz: float) -> Array:
    """A square root of the covariance of least squares under coloured noise, shape (p, p)."""
    rows = noise.size
    size = next_fast_len(rows, real=True)
    segment = min(rows, int(SPECTRUM_S * rate_hz))
    places, power = welch(noise, rate_hz, nperseg=segment)
    level = np.sqrt(np.interp(rfftfreq(size, 1.0 / rate_hz), places, power * rate_hz / 2.0))
    coloured = irfft(rfft(columns, size, axis=0) * level[:, None], size, axis=0)
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-14, hermitian=True)
    return np.asarray((np.linalg.qr(coloured, mode="r") @ inverse).T)


def _without_lines(noise: Array, rate_hz: float) -> Array:
    """`noise` but for what is of one frequency all along: hum, which is looked for."""
    spectrum = rfft(noise)
    power = np.abs(spectrum) ** 2
    lines = power > LINE * median_filter(power, 2 * LINE_REACH + 1)
    places = rfftfreq(noise.size, 1.0 / rate_hz)
    return np.asarray(irfft(np.where(lines & (places > BANDS_HZ[1][0]), 0.0, spectrum), noise.size))


def known_noise(law: DriveLaw, m: Measurement, left: Array) -> DriveLaw | None:
    """Of `law` what is slow and what a model leaves of the torque as well, shape (n,), or None.

    What the drive's law misses is felt by the axis, and a model of the axis does not leave it. What is fast of the
    noise stays: there a law that is a little off moves every phase, and a delay that is not there would explain it.
    """
    edge = 0.0
    for low, high in BANDS_HZ:
        noise, rest = (_band(x, low, high, m.rate_hz) for x in (law.noise, left))
        if not _follows(noise, rest, m, high - low):
            break
        edge = high
    if edge < LEAST_EDGE_HZ:
        return None
    below = [_band(x, 0.0, edge, m.rate_hz) for x in (law.noise, *law.unsure.T)]
    return DriveLaw(below[0], np.stack(below[1:], axis=1))


def _band(values: Array, low_hz: float, high_hz: float, rate_hz: float) -> Array:
    """What of `values` lies between two frequencies (Butterworth of order 4, forth and back), mirrored at its ends."""
    if low_hz > 0.0:
        sections = butter(4, (low_hz, high_hz), "bandpass", fs=rate_hz, output="sos")
    else:
        sections = butter(4, high_hz, "lowpass", fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(sections, values, padtype="even", padlen=values.size - 1))


def _follows(noise: Array, left: Array, m: Measurement, width_hz: float) -> bool:
    """Whether `left` is `noise` and something else, which may be far louder in a few rows."""
    used = m.weight > 0.99
    if used.sum() < FEWEST_ROWS:
        return False
    noise, left = noise[used], left[used]
    for _ in range(ROUNDS):
        gain = float(noise @ left) / max(float(noise @ noise), 1e-300)
        rest = np.abs(left - gain * noise)
        near = rest <= FAR * float(np.median(rest))
        noise, left = noise[near], left[near]
    rest = left - gain * noise
    rows = 2.0 * width_hz * noise.size / m.rate_hz
    spread = math.sqrt(float(rest @ rest) / max(float(noise @ noise), 1e-300) / max(rows, 1.0))
    return spread < KNOWN and abs(gain - 1.0) < FOLLOWS + 2.0 * spread


def without_noise(m: Measurement, law: DriveLaw) -> Measurement:
    """`m` without that noise in its torque, but for a share of it: no form of a model is worth more."""
    share = 1.0 - LEFT
    return replace(m, torque=m.torque - share * law.noise, unsure=share * law.unsure)
