"""Does the residual of the best explanation still live somewhere: a frequency, an order, an angle, a speed, a time?"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sim.chain.model import Array
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.hypotheses.nonparametric import Rows
from sim.investigation.search.residual_proposals import BAND_HZ, ELSEWHERE, HIGHEST_HZ, LEAST_LEVEL, LOWEST_HZ, by_speed
from sim.investigation.search.search import Selection
from sim.investigation.unexplained import Unexplained

BINS = 48
SHARE = 0.06  # of the residual's energy: less is how a model's form differs from any real axis
LINE_SCORE = 60.0
MOST_LINES = 4  # that are looked at
SPEED_BANDS = 8  # times as wide as a line: what is seen of when it is there
SELDOM = 0.1  # of the time: what is only then says nothing


def structure_of(problem: Problem, fit: Fit) -> list[Unexplained]:
    """All places, strongest first."""
    m = problem.measurement
    n = m.samples
    out: list[Unexplained] = []
    torque, guide = fit.residual[:n], fit.residual[n:]
    out += fixed_line("motor_torque_nm", torque, m.rate_hz, m.speed, m.weight)
    if guide.size:
        stride = m.load_stride
        rate = m.rate_hz / stride
        out += fixed_line("load_position_rad", guide, rate, m.speed[::stride], m.load_weight[::stride])
        out += _bins(problem, "load_position_rad", guide, stride)
    out += _bins(problem, "motor_torque_nm", torque, 1)
    return sorted(out, key=lambda u: -u.score)


def stands_out(u: Unexplained) -> bool:
    """Whether a place is beyond noise and beyond what a good axis has.

    Only what has a frequency: errors by angle are in every new gear and encoder, wander over time in every slow noise,
    and friction over the speed has been weighed as a term.
    """
    return u.kind == "frequency" and u.score > LINE_SCORE and u.share > SHARE


def nameless(selection: Selection, term: Term) -> Unexplained:
    """What a term without a name has taken out of the residual, as a share of what there was without it."""
    gain, misfit = selection.gains[term.key], selection.fit.misfit
    kind = term.mechanism.removeprefix("friction_over_").removeprefix("fixed_")
    channel = "motor_torque_nm" if term.location == "motor" else "load_position_rad"
    return Unexplained(
        kind, channel, gain / (gain + misfit), gain / math.sqrt(2.0 * misfit), term.report(selection.fit.values)
    )


def fixed_line(channel: str, values: Array, rate_hz: float, speed: Array, weight: Array) -> list[Unexplained]:
    """Strongest band of fixed frequency in a whitened series (n,), if any; `weight`: 1 where its rows count, else 0.

    What is there at one speed only is of unknown teeth, and is none.
    """
    if not weight.any():
        return []
    spectrum = np.fft.rfft(values)
    power = np.abs(spectrum) ** 2 / values.size
    spacing = rate_hz / values.size
    width = max(3, round(BAND_HZ / spacing))
    energy = np.convolve(2.0 * power, np.ones(width), "valid")
    typical = max(float(np.median(energy)), LEAST_LEVEL * 2.0 * width)
    first = max(1, round(LOWEST_HZ / spacing))
    last = min(energy.size, int(min(0.42 * rate_hz, HIGHEST_HZ) / spacing))
    rows = by_speed(speed, weight)
    for _ in range(MOST_LINES if last > first else 0):
        at = first + int(np.argmax(energy[first:last]))
        excess = float(energy[at] - typical)
        inside = power[at : at + width]
        centre = float((inside * (at + np.arange(width))).sum() / inside.sum() * spacing)
        middle, half = at + width // 2, SPEED_BANDS * width // 2
        around = slice(max(middle - half, 0), middle + half)
        noise = typical * (around.stop - around.start) / width / float(weight.sum())
        if _at_all_speeds(spectrum, around, rows, noise):
            score = excess / (typical * math.sqrt(1.0 / width) + 1e-300)
            share = excess / float(values @ values)
            return [Unexplained("frequency", channel, share, score, {"frequency_hz": centre})]
        energy[max(around.start - width, 0) : around.stop] = 0.0
    return []


def _at_all_speeds(spectrum: NDArray[np.complex128], band: slice, rows: tuple[Rows, Rows], noise: float) -> bool:
    """Whether a band of a series' `spectrum` is there at other than the usual speed, by a third of its amplitude.

    By its power over time: what has no name need not keep its phase. `noise`: power of the band without it, per row
    that counts.
    """
    usual, other = rows
    if min(usual.mean(), other.mean()) < SELDOM:
        return True
    kept = np.zeros(usual.size, dtype=np.complex128)
    inside = spectrum[band]
    kept[: inside.size] = inside
    power = 2.0 * np.abs(np.fft.ifft(kept)) ** 2
    there, elsewhere = (max(float(power[part].mean()) - noise, 0.0) for part in rows)
    return elsewhere >= ELSEWHERE**2 * there


def _bins(problem: Problem, channel: str, values: Array, stride: int) -> list[Unexplained]:
    """Means of the residual over angle of each shaft, speed and time, by bins."""
    m = problem.measurement
    chain = problem.chain((), {})
    speed = m.speed[::stride][: values.size]
    way = np.where(speed >= 0.0, 0, 1)
    out = []
    ratios = np.cumprod([1.0, *(link.ratio for link in chain.links)])
    names = ["motor", *(stage.name for stage in problem.axis.stages)] if problem.axis.stages else ["motor", "load"]
    for ratio, name in zip(ratios, names, strict=False):
        turn = (m.angle[::stride][: values.size] / ratio) % (2.0 * math.pi)
        out.append(_binned("angle", channel, values, turn, 2.0 * math.pi, way, {f"angle_{name}_rad": 1.0}))
    out.append(
        _binned("speed", channel, values, np.abs(speed), float(np.abs(speed).max()) * 1.0001, way, {"speed_rad_s": 1.0})
    )
    time = m.time_s[::stride][: values.size]
    out.append(_binned("time", channel, values, time, float(time[-1]) * 1.0001, np.zeros_like(way), {"time_s": 1.0}))
    return out


def _binned(
    kind: str, channel: str, values: Array, where: Array, span: float, way: Array, numbers: Mapping[str, float]
) -> Unexplained:
    index = np.minimum((where / span * BINS).astype(np.int64), BINS - 1) + BINS * way
    count = np.bincount(index, minlength=2 * BINS).astype(float)
    total = np.bincount(index, values, 2 * BINS)
    used = count > 10
    energy = np.where(used, total**2 / np.maximum(count, 1.0), 0.0)
    level = float(values @ values) / values.size
    degrees = int(used.sum())
    excess = float(energy.sum()) - degrees * level
    score = excess / (level * math.sqrt(2.0 * max(degrees, 1)))
    at = int(np.argmax(energy))
    centre = (at % BINS + 0.5) / BINS * span
    found = dict.fromkeys(numbers, centre) | ({"direction": 1.0 if at < BINS else -1.0} if way.any() else {})
    return Unexplained(kind, channel, excess / float(values @ values), score, found)
