"""Whitening: noise with a level over time and a spectrum, made white by an inverse filter of minimum phase."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.signal import oaconvolve

from sim.investigation.estimation.estimate import Array

Spectrum = NDArray[np.complex128]
SMOOTH_BINS = 4  # half of the running median over a noise spectrum, and at most this many hertz
WITH_TEETH, WITHOUT = 0.25, 0.5  # quantile over blocks that is noise: without teeth little else comes and goes
FEWEST_BLOCKS = 16  # for the quartile of a spectrum
LEAST_BLOCKS = 12  # half overlapping, of a spectrum: thirty seconds have 14 of the longest
MODE_BAND = 0.2  # around the load's own frequency
MODE_NOISE = 3.0  # power of the noise there over its floor, where no encoder sees the load
LITTLE = 1e-3  # by which a way may count less and be left as it is


@dataclass(frozen=True)
class Memory:
    """How long noise is taken to remember: whitening filters of `filter_s`, spectra over blocks of `block_s`.

    `least_drop`: of the squared residual in one step of a fit; less says nothing where the noise is known so roughly.
    """

    block_s: float
    filter_s: float
    least_drop: float

    def within(self, seconds: float) -> Memory:
        """As long as so many seconds that count let a spectrum be known: from a few blocks it is that of the motion,
        and whitening takes friction for noise."""
        share = min(1.0, 2.0 * seconds / (LEAST_BLOCKS + 1) / self.block_s)
        return self if share == 1.0 else replace(self, block_s=share * self.block_s, filter_s=share * self.filter_s)


SHORT, LONG = Memory(1.0, 0.4, 2.0), Memory(4.0, 2.0, 1.0)


@dataclass(frozen=True)
class Noise:
    """Per channel a causal whitening filter and the level of the noise over time, relative to the filter's [1].

    `ways`, orthonormal, shape (torque rows, p): in them the whitened torque is noisier; `less`, shape (p,): the share
    by which they count less.
    """

    torque: Array
    guide: Array
    torque_level: Array = field(default_factory=lambda: np.ones(1))
    guide_level: Array = field(default_factory=lambda: np.ones(1))
    ways: Array = field(default_factory=lambda: np.zeros((0, 0)))
    less: Array = field(default_factory=lambda: np.zeros(0))
    _spectra: dict[tuple[str, int], Spectrum] = field(init=False, repr=False, compare=False, default_factory=dict)

    @staticmethod
    def flat(torque_sd: float, guide_sd: float) -> Noise:
        return Noise(np.array([1.0 / torque_sd]), np.array([1.0 / guide_sd]))

    def whiten(self, torque: Array, guide: Array, counts: Array | float = 1.0) -> Array:
        """Both residuals in one row, white and of unit level; `counts`: of the torque's rows, 0 in rests.

        Rests are taken out once white: before, noise would seem to begin from nothing behind each of them.
        """
        first = self._filtered("torque", torque) / self.torque_level * counts
        if self.less.size:
            first -= self.ways @ (self.less * (self.ways.T @ first))
        if not guide.size:
            return first
        return np.concatenate([first, self._filtered("guide", guide) / self.guide_level])

    def log_scale(self, torque_rows: int, guide_rows: int) -> float:
        """Twice the log of how much larger residuals are than white ones: fits under different noise are as likely as
        the sum of this and their cost is small. The first tap of a minimum phase filter is its geometric mean."""
        loud = [(self.torque, self.torque_level, torque_rows), (self.guide, self.guide_level, guide_rows)]
        return -2.0 * float(np.sum(np.log1p(-self.less))) + sum(
            2.0 * rows * (float(np.mean(np.log(level))) - math.log(abs(taps[0]))) for taps, level, rows in loud if rows
        )

    def with_inflated_prior(self, unsure: Array, counts: Array | float = 1.0) -> Noise:
        """The same where the torque may also be wrong as a whole by each column of `unsure`, shape (rows, p) [N m]."""
        if not unsure.size:
            return self
        white = np.stack([self._filtered("torque", c) / self.torque_level * counts for c in unsure.T], axis=1)
        ways, size, _ = np.linalg.svd(white, full_matrices=False)
        less = 1.0 - 1.0 / np.hypot(1.0, size)
        return replace(self, ways=np.ascontiguousarray(ways[:, less > LITTLE]), less=less[less > LITTLE])

    def _filtered(self, channel: str, values: Array) -> Array:
        """By one transform: the filter's own is kept, as nearly all signals of a channel have one length.

        What was before the first row is taken for its mirror: slow noise does not begin with the record.
        """
        taps: Array = getattr(self, channel)
        if taps.size == 1:
            return np.asarray(taps[0] * values)
        before = values[taps.size - 1 : 0 : -1]
        padded = np.concatenate([before, values])
        size = next_fast_len(padded.size + taps.size - 1, real=True)
        if (channel, size) not in self._spectra:
            self._spectra[channel, size] = rfft(taps, size)
        return np.asarray(irfft(rfft(padded, size) * self._spectra[channel, size], size)[before.size : padded.size])


def whitener(
    values: Array,
    weight: Array,
    rate_hz: float,
    memory: Memory,
    mode_hz: float | None = None,
    *,
    teeth: bool,
    least: float,
) -> tuple[Array, Array]:
    """Filter and level over time of the noise under `values`, of `least` at least; it counts less around `mode_hz`.

    What shakes the load shakes it at its own frequency, and the drive answers: there the motor's motion, from which the
    torque is predicted, is not independent of the noise, and a fit would damp the load to make it quiet.
    """
    deaf = None if mode_hz is None else mode_hz / rate_hz * np.array([1.0 - MODE_BAND, 1.0 + MODE_BAND])
    memory = memory.within(float(weight.sum()) / rate_hz)
    block, length = (max(1, int(seconds * rate_hz)) for seconds in (memory.block_s, memory.filter_s))
    smooth = max(1, int(SMOOTH_BINS * memory.block_s))
    taps = floor_filter(values, weight, block, length, deaf, teeth=teeth, smooth=smooth, least=least)
    white = oaconvolve(values, taps)[: values.size]
    level = level_over_time(white, weight, int(rate_hz))
    if not teeth:
        return taps, level
    moving = np.abs(white / level)[weight > 0.5]
    if not moving.size:
        return taps, level
    # quartiles over few blocks lie high where the floor is steep: half of all rows are below 0.67 deviations
    return taps, level * max(min(1.0, 1.4826 * float(np.median(moving))), least * float(taps[0]))


def level_over_time(white: Array, weight: Array, block: int) -> Array:
    """Deviation of whitened noise by the median over blocks and their neighbours, shape (n,), at least 1.

    Noise may come in bursts or grow with speed; by medians, what an effect does at reversals or teeth is left alone.
    """
    count = max(1, white.size // block)
    edges = np.linspace(0, white.size, count + 1).astype(np.int64)
    levels = np.ones(count)
    for k in range(count):
        part = slice(int(edges[max(k - 1, 0)]), int(edges[min(k + 2, count)]))
        used = np.abs(white[part][weight[part] > 0.5])
        if used.size > 20:
            levels[k] = 1.4826 * float(np.median(used))
    centres = 0.5 * (edges[1:] + edges[:-1])
    return np.asarray(np.maximum(np.interp(np.arange(white.size), centres, levels), 1.0), dtype=np.float64)


def floor_filter(
    values: Array,
    weight: Array,
    block: int,
    length: int,
    deaf: Array | None = None,
    *,
    teeth: bool = True,
    smooth: int = SMOOTH_BINS,
    least: float = 0.0,
) -> Array:
    """Whitening filter (length,) of the noise under a residual that may still hold effects.

    The lower quartile over blocks of the spectrum, at each frequency, then a running median over frequency: neither
    what comes and goes (reversals, passages of a tooth) nor lines of one order are taken for noise. Without `teeth` the
    median over all blocks: the steps of an encoder are quiet at even speed and loud while it changes.
    `deaf`: ends of a band [1 over a sample] in which the noise is taken for louder than it is. `least`: deviation of
    white noise that is there in any case, in the unit of `values`.
    """
    wanted, block = block, max(64, min(block, values.size // 4))
    smooth = max(SMOOTH_BINS, smooth * block // wanted)
    window = np.hanning(block)
    starts = range(0, values.size - block + 1, block // 2)
    used = [s for s in starts if weight[s : s + block].min() > 0.99]
    if len(used) < FEWEST_BLOCKS or not teeth:
        used = [s for s in starts if weight[s : s + block].mean() > 0.6] or list(starts)
    power = np.array(
        [
            np.abs(np.fft.rfft(values[s : s + block] * window)) ** 2
            / max(float(np.sum((window * weight[s : s + block]) ** 2)), 1e-300)
            for s in used
        ]
    )
    share = WITH_TEETH if teeth else WITHOUT
    floor = np.quantile(power, share, axis=0) / -math.log(1.0 - share)
    level = np.maximum(running_median(floor, smooth), least**2)
    if deaf is not None:
        place = np.arange(level.size) / block
        level[(place > deaf[0]) & (place < deaf[1])] *= MODE_NOISE
    return minimum_phase(1.0 / np.maximum(level, 1e-9 * level.max() + 1e-300), length)


def running_median(values: Array, most: int) -> Array:
    """Of half its place to either side, between SMOOTH_BINS and `most`: slow noise is steep over frequency."""
    most = min(most, values.size - 2)
    padded = np.concatenate([values[most:0:-1], values, values[-2 : -2 - most : -1]])
    places = np.arange(values.size)
    reach = np.clip(places // 2, SMOOTH_BINS, most)
    out = np.empty(values.size)
    for half in np.unique(reach):
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * int(half) + 1)
        mine = places[reach == half]
        out[mine] = np.median(windows[mine + most - half], axis=1)
    return out


def minimum_phase(power: Array, length: int) -> Array:
    """Causal filter (length,) whose squared gain is `power` on an even grid from 0 to half the rate, by its cepstrum.

    Its first tap is the geometric mean of the gain: white noise stays as likely as it was.
    """
    cepstrum = np.fft.irfft(0.5 * np.log(power))
    size = cepstrum.size
    fold = np.zeros(size)
    fold[0], fold[1 : size // 2], fold[size // 2] = 1.0, 2.0, 1.0
    taps = np.fft.irfft(np.exp(np.fft.rfft(cepstrum * fold)), size)
    return np.asarray(taps[: min(length, size // 2)])
