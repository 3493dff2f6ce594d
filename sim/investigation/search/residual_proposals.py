"""Proposals from the residual: lines that follow the speed, lines that do not, curves over speed, angle and time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import welch

from sim import mechanisms
from sim.chain.model import Array
from sim.investigation.data.excitation import excitation_of, lacking
from sim.investigation.data.preprocessing import Measurement
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.catalogue import gain, hum
from sim.investigation.hypotheses.friction import friction_felt
from sim.investigation.hypotheses.gear_mesh import ripple
from sim.investigation.hypotheses.generic import ORDERS as ALWAYS_TRIED
from sim.investigation.hypotheses.generic import frequency_of, terms_of_kind
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.hypotheses.identifiability import HUM_HZ, highest_order, lowest_order
from sim.investigation.hypotheses.nonparametric import (
    ORDERS,
    Rows,
    error_over_angle,
    half_teeth,
    over_angle,
    over_speed,
    sine,
    torque_over_angle,
)
from sim.investigation.search.score_test import Rest
from sim.mechanisms.catalogue import kind_of
from sim.mechanisms.mechanism import LEAST_GAIN

LOWEST_HZ, HIGHEST_HZ = 2.0, 120.0  # above, teeth and their aliases
MOTION = 5e-3  # of the largest power of the acceleration: below it the motion itself has ended
BAND_HZ = 0.6
FINER = 8  # spacing of the frequencies tried, over that of the record's own
COHERENT = 0.5  # of a line's energy, that one sine of constant phase explains
MAINS = 0.005  # by which the frequency of the mains may be off
SPEEDS, OFTEN = 40, 0.3  # bins of the speed, and share of the time at one of them that makes lines of orders
ELSEWHERE = 0.35  # of the size of a line, at other speeds: a real one has 0.7 and more, one of unknown teeth 0 to 0.1
LEAST_LEVEL = 0.5  # of white noise under the residual: one that is far below its noise has no line in it
RIPPLES = 2  # orders proposed of those looked at
LINES = 2  # frequencies proposed of those looked at
WINDOWS, SHORTEST = 60, 2  # of a record, in which a factor may differ: parts of it, and the fewest
BESIDE_FRICTION = 0.5  # of the torque, at least
USUAL_GAIN = 0.02  # share by which a factor that differs is tried
LINE_EXCESS = 14.0  # energy of a line over that of its neighbours: once in a hundred records of noise


def nameless_terms(problem: Problem, fit: Fit) -> list[Term]:
    """Friction over speed and over angle at both ends, and a sine of constant phase where the residual has a line."""
    m = problem.measurement
    level = 0.01 * float(np.sqrt(np.mean(m.torque**2)))
    n = m.samples
    ends = [("motor", fit.residual[:n], 1, level, m.weight)]
    out = half_teeth(problem.axis)
    if problem.guided:
        ends.append(("load", fit.residual[n:], m.load_stride, level * problem.axis.ratio, m.load_weight))
        out += error_over_angle(problem.axis, m)
    ratio = problem.axis.ratio * m.gear
    turned = [order for order in ORDERS if order * float(np.ptp(m.angle)) > math.pi * ratio]
    for place, left, stride, step, weight in ends:
        rate_hz, rows = m.rate_hz / stride, (m.speed[::stride], weight[::stride])
        out += [over_speed(place, m, step, even=even) for even in (True, False)]
        out += [over_angle(place, m, ratio, step, order) for order in turned]
        if turned[-2:] == list(ORDERS[1:]):
            out.append(torque_over_angle(place, m, ratio, step))
        frequency = line_of(left, rate_hz, motion_end_hz(m))
        if frequency is not None and is_fixed(left, rate_hz, frequency, *rows):
            mains = place == "motor" and any(abs(frequency / f - 1.0) < MAINS for f in HUM_HZ)
            line = hum(frequency, 100.0 * level)
            shown = not kind_of(line.mechanism).shown_by & lacking(m)
            out.append(line if mains and shown else sine(place, m, frequency, step))
    return out


def ripples(problem: Problem, fit: Fit) -> list[Term]:
    """Torque over the motor's angle at the whole orders at which most of the residual is, beyond those always tried.

    Order analysis by the angle itself: whatever the speed does, a line of one order stays one line. Up to the order
    that goes at half the rate at the usual speed; looked for among all of them, and that is its price. What repeats
    more often than the torque of any motor is of a gear before it, which no description has: it stands aside, unnamed.
    """
    m = problem.measurement
    seen = excitation_of(m)
    counts = m.weight > 0.5
    turn = np.exp(-1j * m.angle[counts])
    orders = range(lowest_order(seen, doubted=m.doubts.size > 0), highest_order(seen) + 1)
    wave, left = fit.residual[: m.samples][counts] * turn ** (orders.start - 1), {}
    for order in orders:
        wave *= turn
        left[order] = abs(wave.sum()) ** 2 / turn.size
    likely = sorted(orders, key=lambda order: -left[order])[:RIPPLES]
    present = problem.chain(fit.terms, fit.values)
    terms = (ripple(float(order), m.torque_rms, problem.axis, present) for order in likely if order not in ALWAYS_TRIED)
    return [replace(term, among=len(orders)) for term in terms]


def waves(problem: Problem, fit: Fit) -> list[Term]:
    """Mechanisms of the catalogue that repeat in time, at the frequencies of which the residual has most.

    Of all that the record tells apart in the range of such a mechanism; that is its price.
    """
    open_to_any = [kind for kind in mechanisms.MECHANISMS.values() if not kind.traits.own_hypothesis]
    kinds = [(kind, often) for kind in open_to_any if (often := frequency_of(kind)) is not None]
    if not kinds:
        return []
    m = problem.measurement
    left = fit.residual[: fit.torque_rows]
    frequencies = np.fft.rfftfreq(FINER * left.size, 1.0 / m.rate_hz)
    power = np.abs(np.fft.rfft(left, FINER * left.size)) ** 2
    out = []
    for kind, often in kinds:
        inside = (frequencies >= max(often.low, m.rate_hz / left.size)) & (
            frequencies <= min(often.high, 0.5 * m.rate_hz)
        )
        among = int(inside.sum()) // FINER
        for _ in range(min(LINES, among)):
            at = int(np.argmax(np.where(inside, power, 0.0)))
            terms = terms_of_kind(kind, problem.axis, m, float(frequencies[at]))
            out += [replace(term, among=among) for term in terms]
            inside[max(at - FINER, 0) : at + FINER + 1] = False
    return out


def changed_gain(problem: Problem, fit: Fit) -> list[Term]:
    """The torque channel read by another factor for the part of the record in which this explains most.

    By the squares that a share of the measured torque takes away between two times, of all pairs of times on a grid,
    the rest of the model following in the linear picture: inertia and friction bend to what a factor asks of them.
    None where the known torque is doubted, which changes with the posture and so with the time; nor where friction is
    most of the torque: another factor and friction that has changed are one then.
    """
    m = problem.measurement
    if m.doubts.size:
        return []
    present, top = problem.chain(fit.terms, fit.values), float(np.abs(m.speed).max())
    dry, all_of_it = friction_felt(present, 0.0), friction_felt(present, top)
    other = m.torque - np.sign(m.speed) * dry - m.speed / top * (all_of_it - dry)
    if float(np.std(other[m.weight > 0.5])) < BESIDE_FRICTION * m.torque_rms:
        return []
    n = m.samples
    measured = problem.white((m.across(m.torque), np.zeros(fit.residual.size - n)))[:n]
    edges = np.linspace(0, n, WINDOWS + 1).astype(np.int64)
    parts = np.zeros((WINDOWS, fit.residual.size))
    for part, first, last in zip(parts, edges[:-1], edges[1:], strict=True):
        part[first:last] = -measured[first:last]
    own, pull, _ = Rest.of(fit, ()).against(parts, fit.residual)
    both = np.concatenate([[0.0], pull.cumsum()])
    table = np.pad(own.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    first, last = np.triu_indices(WINDOWS + 1, SHORTEST)
    inside = last - first <= WINDOWS // 2  # what a factor is most of the time is the torque constant
    first, last = first[inside], last[inside]
    squares = table[last, last] - table[first, last] - table[last, first] + table[first, first]
    gained = (both[last] - both[first]) ** 2 / np.maximum(squares, 1e-9 * table[-1, -1] + 1e-300)
    if gained.max() <= LEAST_GAIN:
        return []
    best = int(np.argmax(gained))
    start_s, end_s = (float(m.time_s[min(edges[k], n - 1)]) for k in (first[best], last[best]))
    return [gain(USUAL_GAIN, float(m.time_s[-1]), start_s, end_s, gained.size)]


def line_of(left: Array, rate_hz: float, lowest_hz: float = LOWEST_HZ) -> float | None:
    """Frequency of the strongest line of a whitened residual [Hz], None where there is none of constant phase.

    Below `lowest_hz` a line is as likely what the motion makes of a wrong model.
    """
    size = FINER * left.size
    power = np.abs(np.fft.rfft(left, size)) ** 2 / left.size
    spacing = rate_hz / size
    first, last = round(lowest_hz / spacing), int(min(0.42 * rate_hz, HIGHEST_HZ) / spacing)
    if last <= first + FINER:
        return None
    at = first + int(np.argmax(power[first:last]))
    half = round(0.5 * BAND_HZ / spacing)
    typical = max(float(np.median(power[first:last])) / math.log(2.0), LEAST_LEVEL)
    band = float(power[max(at - half, 0) : at + half + 1].sum()) / FINER
    excess = band - typical * (2 * half + 1) / FINER
    if power[at] < LINE_EXCESS * typical or power[at] - typical < COHERENT * excess:
        return None
    return at * spacing


def is_fixed(left: Array, rate_hz: float, frequency_hz: float, speed: Array, weight: Array) -> bool:
    """Whether a line of a residual (n,) is there at other speeds (n,) as well, by a third of its size at least.

    An axis that mostly moves at one speed makes a line of every order that its description does not know, such as
    teeth of which it gives no number. `weight`: 1 where a row counts, else 0.
    """
    usual, other = by_speed(speed, weight)
    if usual.mean() < OFTEN or not other.any():
        return True
    turning = left * np.exp(-2j * math.pi * frequency_hz / rate_hz * np.arange(left.size))
    there, elsewhere = turning[usual].mean(), turning[other].mean()
    return bool((elsewhere * np.conj(there)).real >= ELSEWHERE * abs(there) ** 2)


def by_speed(speed: Array, weight: Array) -> tuple[Rows, Rows]:
    """Rows that count at the speed, but for rest, at which the axis moves most of the time, and at all others."""
    size = np.abs(speed)
    bins, edges = np.histogram(size, SPEEDS)
    most = int(np.argmax(bins[1:])) + 1
    usual = (size >= edges[most - 1]) & (size <= edges[min(most + 2, SPEEDS)])
    counts = weight > 0.5
    return usual & counts, ~usual & counts


def motion_end_hz(m: Measurement) -> float:
    """Frequency above which the motion has no acceleration to speak of [Hz], at least LOWEST_HZ.

    By the median over neighbouring frequencies: a line alone, which also shakes the motor, is no motion.
    """
    frequency, power = welch(m.slow_acceleration, m.rate_hz, nperseg=min(int(4.0 * m.rate_hz), m.samples))
    smooth = median_filter(power, 9, mode="nearest")
    return max(LOWEST_HZ, float(frequency[np.flatnonzero(smooth > MOTION * power.max())[-1:]].max(initial=0.0)))
