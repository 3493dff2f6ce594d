"""Misfit: what a model leaves of a channel and the channel's noise does not explain.

Noise of a sensor, in bursts as well, is as loud below the band of the motion's edge as above it by the same ratio all
along. A cause that no model has acts at some times, angles or torques, and is slow. So the noise in the band of the
motion is what the quieter blocks of the record have, each block in proportion to what it has above that band. A model
that leaves more than `NOISE` times that, or most of what was measured, is not adequate; what it leaves beyond may have
the shape of anything that was found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from sim.investigation.assessment.intervals import NO_SIZE
from sim.investigation.estimation.estimate import Array, Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.refit import MOTION_BAND_HZ
from sim.investigation.results import Estimate, Gain

NOISE = 2.0  # of 62 axes in good order, of two generators, also with noise in bursts: 1.66 at most
BLOCK_S = 0.5
QUIETER = 0.25  # quantile over blocks
FEWEST_BLOCKS = 8
UNREACHED = 0.5  # of the torque: a model that leaves more says nothing of the axis


def excess(problem: Problem, fit: Fit, gained: Sequence[Gain]) -> tuple[float, ...]:
    """Root mean square of the misfit of each channel of `gained` [N m]; 0 where noise explains what is left."""
    m = problem.measurement
    residuals = problem.raw_residuals(fit.terms, fit.values, weighted=False)
    weights = (m.weight, m.load_weight[:: m.load_stride])
    rates = (m.rate_hz, m.rate_hz / m.load_stride)
    out = []
    for gain, values, weight, rate_hz in zip(gained, residuals, weights, rates, strict=False):
        ratio = left_over_noise(values, weight, rate_hz)
        unreached = gain.rms_measured > 0.0 and gain.rms_after > UNREACHED * gain.rms_measured
        share = 1.0 if unreached else math.sqrt(max(0.0, 1.0 - (NOISE / ratio) ** 2))
        out.append(share * gain.rms_after)
    return tuple(out)


def left_over_noise(values: Array, weight: Array, rate_hz: float) -> float:
    """What is left in the band of the motion over the noise there, at least 1; 1 for a record of a few blocks.

    Args:
        values: residual of a channel, shape (n,); weight: 1 where a row counts, else 0; rate_hz: rows per second.

    >>> noise = np.random.default_rng(0).standard_normal(20_000)
    >>> round(left_over_noise(noise, np.ones(20_000), 1000.0), 1)
    1.1
    >>> slow = np.sin(np.arange(20_000) / 500) * (np.arange(20_000) > 10_000)
    >>> left_over_noise(noise + 5 * slow, np.ones(20_000), 1000.0) > 2
    True
    """
    edge = min(MOTION_BAND_HZ, rate_hz / 8.0)
    rows = round(BLOCK_S * rate_hz)
    blocks = values.size // max(rows, 1)
    if blocks < FEWEST_BLOCKS or rows < FEWEST_BLOCKS:
        return 1.0
    used = (weight > 0.5)[: blocks * rows].reshape(blocks, rows)
    enough = used.mean(axis=1) > QUIETER
    if np.count_nonzero(enough) < FEWEST_BLOCKS:
        return 1.0

    def level(sections: Array) -> Array:
        square = sosfiltfilt(sections, values)[: blocks * rows].reshape(blocks, rows) ** 2
        return np.asarray((square * used).sum(axis=1)[enough] / used.sum(axis=1)[enough])

    slow = level(butter(4, edge, fs=rate_hz, output="sos"))
    fast = np.maximum(level(butter(4, (edge, 3.0 * edge), "bandpass", fs=rate_hz, output="sos")), 1e-300)
    noise = float(np.quantile(slow / fast, QUIETER)) * fast
    return max(1.0, math.sqrt(float(slow.mean()) / max(float(noise.mean()), 1e-300)))


def adequacy(left: Sequence[float], gained: Sequence[Gain], *, whole: bool) -> float:
    """Of the squares beyond noise, the share that is explained [1], of the channel in which it is largest.

    Args:
        left: misfit of each channel; whole: by the whole model, else by what it has beyond the description.
    """
    if not any(left):
        return 1.0
    shares = [0.0]
    for rest, gain in zip(left, gained, strict=True):
        before = gain.rms_measured if whole and gain.rms_measured else gain.rms_before
        explained = before**2 - gain.rms_after**2
        if explained > 0.0:
            shares.append(explained / (explained + rest**2))
    return max(shares)


def widened(estimates: Sequence[Estimate], adequate: float) -> tuple[Estimate, ...]:
    """Intervals of sizes, no narrower in proportion than the root of what is not explained over what is."""
    ratio = math.sqrt((1.0 - adequate) / max(adequate, 1e-6))
    out = []
    for e in estimates:
        half = 0.0 if e.name in NO_SIZE else ratio * abs(e.value)
        out.append(replace(e, low=min(e.low, e.value - half), high=max(e.high, e.value + half)))
    return tuple(out)
