"""Panels of telemetry: measured and simulated, and what each model leaves of a channel, sorted by where it may live.

The noise floor is what the quieter blocks of the record have, at each frequency of whichever model leaves less: one
that fits badly cannot widen it by what comes and goes. What both get wrong all the time, it takes for noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from sim.chain.model import Array
from sim.investigation.estimation.doubts import by_doubts
from sim.investigation.estimation.problem import Problem
from sim.investigation.report.panels import DESCRIBED, EXTENDED, FLOOR, MEASURED, Panel
from sim.investigation.search.search import Selection

MEAN_S = 0.01  # values over time are means of this, which leaves what is below 50 Hz
SHOWN_S = 8.0
SHOWN_HZ = 250.0
LINE_HZ = 0.5
BINS, LEVELS = 72, 24
OUTLIERS = 0.002  # of the rows, at either end, beyond the last bins
FEWEST_ROWS = 10  # of a bin, each a mean of MEAN_S
ORDERS_PER_TURN = 128
TURNS, FEWEST_TURNS = 16, 4
TRANSFORM = 8192  # longer than any whitening filter
DRAWS = 4  # of noise, for its floor over orders
Lines = tuple[tuple[str, Array], ...]


def overlay_panels(selection: Selection) -> list[Panel]:
    """Measured and simulated motor torque beside what is left of it, over time and frequency."""
    motor, torque = channels(selection)[0], selection.problem.measurement.torque
    return [
        motor.measured_over_time(torque), motor.left_over_time(), motor.measured_spectrum(torque), motor.spectrum(),
    ]  # fmt: skip


def residual_panels(selection: Selection) -> list[Panel]:
    """What is left of every channel by angle of each shaft, order, speed, torque, direction and time."""
    motor, *others = channels(selection)
    return [*motor.sorted(), *(p for load in others for p in (load.left_over_time(), load.spectrum(), *load.sorted()))]


def channels(selection: Selection) -> list[Channel]:
    """The motor torque, and what the model lacks at the load where an encoder sees it."""
    problem = selection.problem
    m = problem.measurement
    fits = [(DESCRIBED, selection.base)] + ([(EXTENDED, selection.fit)] if selection.fit.terms else [])
    left = [(name, problem.raw_residuals(f.terms, f.values, weighted=False)) for name, f in fits]
    # of the whole model alone: before, what is missing looks like a wrong known torque
    name, (torque, guide) = left[-1]
    left[-1] = name, (torque - by_doubts(m, problem.noise, torque), guide)
    noises = [problem.noise_of(fit) for _, fit in fits]
    motor = tuple((name, torque) for name, (torque, _) in left)
    out = [Channel("Motor torque", problem, 1, m.weight, motor, tuple(n.torque for n in noises))]
    if problem.guided:
        stride = m.load_stride
        load = tuple((name, guide) for name, (_, guide) in left)
        out.append(
            Channel(
                "Torque at the load", problem, stride, m.load_weight[::stride], load, tuple(n.guide for n in noises)
            )
        )
    return out


@dataclass(frozen=True)
class Channel:
    """What each model leaves of one channel [N m], shape (n,), every `stride` rows of the measurement.

    `weight` (n,) is 0 where nothing is known, as at standstill, where dry friction holds whatever it likes;
    `whitening`: per model the filter that makes the noise under what it leaves white with a deviation of 1.
    """

    name: str
    problem: Problem
    stride: int
    weight: Array
    left: Lines
    whitening: tuple[Array, ...]

    @property
    def rate_hz(self) -> float:
        return self.problem.measurement.rate_hz / self.stride

    @property
    def size(self) -> int:
        return int(self.left[0][1].size)

    def sorted(self) -> list[Panel]:
        """By everything that what is left may hang on."""
        order = self.by_order()
        turning = [*self.by_angles(), *([order] if order else [])]
        return [*turning, self.by_speed(), self.by_torque(), self.by_direction(), self.by_time()]

    def measured_over_time(self, measured: Array) -> Panel:
        return self._over_time(f"{self.name}: measured and simulated", self._simulated(measured), None)

    def left_over_time(self) -> Panel:
        reach = 2 * self.floor()
        return self._over_time(f"{self.name}: residual", self._moving(), (-reach, reach))

    def measured_spectrum(self, measured: Array) -> Panel:
        """Of the rows that count, as `spectrum` of what is left: at a frequency one can be held against the other."""
        lines = [(name, self._level_counted(y)) for name, y in self._simulated(measured)]
        return self._spectra(f"{self.name}, spectrum: measured and simulated", lines)

    def _simulated(self, measured: Array) -> Lines:
        return ((MEASURED, measured), *((name, measured - left) for name, left in self.left))

    def spectrum(self) -> Panel:
        """Of the rows that count, as loud as if all did; a line leads over lost ones, whose edges would be loudest."""
        return self.spectrum_of(f"{self.name}, spectrum: residual", self.left)

    def spectrum_of(self, title: str, shown: Lines) -> Panel:
        """The same of any torques, each of shape (n,) [N m], with the noise floor."""
        lines = [(name, self._level_counted(torque)) for name, torque in shown]
        frequency = lines[0][1][0]
        floor = 10 * np.log10(np.interp(frequency, *self._density))
        return self._spectra(title, [*lines, (FLOOR, (frequency, floor))])

    def by_angles(self) -> list[Panel]:
        """Of every shaft; along the travel where a single body moves less than a turn, as a linear axis does."""
        axis = self.problem.axis
        angle = self.problem.measurement.angle[:: self.stride]
        if not axis.stages and np.ptp(angle) < 2.0 * math.pi:
            edges = np.linspace(float(angle.min()), float(angle.max()), BINS + 1)
            return [self._binned("by position", "position of the motor [rad]", angle, edges)]
        names = ["motor", *(stage.name for stage in axis.stages)]
        edges = np.linspace(0.0, 360.0, BINS + 1)
        turned = [np.degrees(angle / axis.ratio * axis.ratio_from(name)) for name in names]
        return [
            self._binned(f"by angle of {name}", "angle [°]", values, edges, 360.0)
            for name, values in zip(names, turned, strict=True)
        ]

    def by_speed(self) -> Panel:
        m = self.problem.measurement
        speed = m.speed[:: self.stride]
        return self._binned("by speed and direction", "speed of the motor [rad/s]", speed, self._edges(speed))

    def by_torque(self) -> Panel:
        torque = self.problem.measurement.torque[:: self.stride]
        return self._binned("by load (torque)", "motor torque, measured [N m]", torque, self._edges(torque))

    def by_direction(self) -> Panel:
        """Two values: turning backward and forward."""
        way = np.sign(self.problem.measurement.speed[:: self.stride])
        return self._binned("by direction", "direction: -1 backward, 1 forward", way, np.array([-2.0, 0.0, 2.0]))

    def by_time(self) -> Panel:
        time = self.problem.measurement.time_s[:: self.stride]
        edges = np.linspace(float(time[0]), float(time[-1]), BINS + 1)
        return self._binned("by time", "time [s]", time, edges)

    def by_order(self) -> Panel | None:
        """Against turns of the motor instead of time: what a tooth does stands at one order at every speed.

        None where it does not turn often enough.
        """
        speed = np.abs(self.problem.measurement.speed[:: self.stride][: self.size])
        turned = np.concatenate([[0.0], np.cumsum(speed[1:])]) / self.rate_hz / (2 * math.pi)
        if turned[-1] < FEWEST_TURNS:
            return None
        grid = np.arange(0.0, turned[-1], 1.0 / ORDERS_PER_TURN)
        drawn = [(name, *self._by_turns(grid, turned, left)) for name, left in self.left]
        noise = np.mean([self._by_turns(grid, turned, draw)[1] for draw in self._draws()], axis=0)
        order = drawn[0][1]
        teeth = self.problem.axis.stages[0].driver_teeth if self.problem.axis.stages else None
        highest = 2.5 * teeth if teeth else 8.0
        used = (order > 0) & (order <= min(highest, ORDERS_PER_TURN / 2))
        markers = tuple((float(k * teeth), f"mesh {k}×") for k in (1, 2)) if teeth else ()
        lines = [*((name, power) for name, _, power in drawn), (FLOOR, noise)]
        return Panel(
            f"{self.name} by order of the motor",
            "order of the motor [1]",
            "level [dB re 1 (N m)²/order]",
            "order",
            order[used],
            tuple((name, 10 * np.log10(np.maximum(power[used], 1e-30))) for name, power in lines),
            markers=markers,
        )

    def floor(self) -> float:
        """Standard deviation of the measurement's own noise in means of MEAN_S [N m]."""
        frequency, density = self._density
        width = self._rows_of_mean / self.rate_hz
        return math.sqrt(float(np.trapezoid(density * np.sinc(frequency * width) ** 2, frequency)))

    @cached_property
    def _density(self) -> tuple[Array, Array]:
        """Frequency [Hz] and power of the noise [(N m)²/Hz], the lowest that any model leaves."""
        power = np.min([1.0 / np.abs(np.fft.rfft(taps, TRANSFORM)) ** 2 for taps in self.whitening], axis=0)
        frequency: Array = np.fft.rfftfreq(TRANSFORM, 1.0 / self.rate_hz).astype(np.float64)
        return frequency, np.asarray(2.0 / self.rate_hz * power)

    def _draws(self) -> list[Array]:
        """Noise of this density, as long as the record: the same numbers each time."""
        white = np.fft.rfft(np.random.default_rng(0).standard_normal((DRAWS, self.size)))
        frequency = np.fft.rfftfreq(self.size, 1.0 / self.rate_hz)
        gain = np.sqrt(np.interp(frequency, *self._density) * self.rate_hz / 2.0)
        return list(np.fft.irfft(white * gain, self.size))

    def _by_turns(self, grid: Array, turned: Array, left: Array) -> tuple[Array, Array]:
        even = np.interp(grid, turned, left * self.weight[: self.size])
        order, power = welch(even, ORDERS_PER_TURN, nperseg=min(TURNS * ORDERS_PER_TURN, even.size))
        return order, power

    def _edges(self, values: Array) -> Array:
        """Of even bins over where the rows that count are."""
        means, known = self._means(values[: self.size]), self._means(self.weight[: self.size]) >= 0.5
        low, high = np.quantile(means[known] if known.any() else means, [OUTLIERS, 1.0 - OUTLIERS])
        return np.linspace(low, max(high, low + 1e-12), LEVELS + 1)

    def _moving(self) -> Lines:
        """Where dry friction holds whatever it likes, nothing is left that would mean anything."""
        still = self.weight[: self.size] < 0.5
        return tuple((name, np.where(still, np.nan, left)) for name, left in self.left)

    def _over_time(self, title: str, lines: Sequence[tuple[str, Array]], noise: tuple[float, float] | None) -> Panel:
        count = int(min(self.size, SHOWN_S * self.rate_hz))
        time = self._means(self.problem.measurement.time_s[:: self.stride][:count])
        drawn = tuple((name, self._means(y[:count])) for name, y in lines)
        return Panel(title, "time [s]", "torque [N m]", "time", time, drawn, noise)

    @property
    def _rows_of_mean(self) -> int:
        return max(1, round(MEAN_S * self.rate_hz))

    def _means(self, values: Array) -> Array:
        size = self._rows_of_mean
        whole = values.size // size * size
        return np.asarray(values[:whole].reshape(-1, size).mean(axis=1))

    def _counted(self, left: Array) -> Array:
        if self.stride > 1:
            return left * self.weight[: self.size]
        m = self.problem.measurement
        return np.asarray(m.across(left) * m.awake)

    @property
    def _share(self) -> float:
        """Of the energy of noise, what is left of it by the weights."""
        return max(float(np.mean(self.weight[: self.size] ** 2)), 1e-3)

    def _level_counted(self, values: Array) -> tuple[Array, Array]:
        """Frequency [Hz] and level [dB re 1 (N m)²/Hz] of the rows that count, as loud as if all did."""
        return self._level(self._counted(values), self._share)

    def _level(self, values: Array, share: float) -> tuple[Array, Array]:
        size = min(round(self.rate_hz / LINE_HZ), values.size)
        frequency, power = welch(values, self.rate_hz, nperseg=size)
        used = (frequency > 0) & (frequency <= SHOWN_HZ)
        return frequency[used], 10 * np.log10(np.maximum(power[used] / share, 1e-30))

    def _spectra(self, title: str, lines: Sequence[tuple[str, tuple[Array, Array]]]) -> Panel:
        drawn = tuple((name, level) for name, (_, level) in lines)
        return Panel(title, "frequency [Hz]", "level [dB re 1 (N m)²/Hz]", "frequency", lines[0][1][0], drawn)

    def _binned(self, by: str, x_label: str, where: Array, edges: Array, turn: float | None = None) -> Panel:
        """Effective value of what is left, in means of MEAN_S, per bin; NaN where too little was measured.

        `turn`: where x begins anew.
        """
        bins = edges.size - 1
        middle = self._means(where[: self.size])
        index = np.clip(np.digitize(middle if turn is None else middle % turn, edges) - 1, 0, bins - 1)
        lines = tuple((name, _levels(self._means(left), index, bins)) for name, left in self._moving())
        centres = (edges[:-1] + edges[1:]) / 2
        cursor = "-".join(by.replace("(", "").replace(")", "").split())
        return Panel(f"{self.name} {by}", x_label, "residual, rms [N m]", cursor, centres, lines, (0.0, self.floor()))


def _levels(values: Array, index: NDArray[np.int64], bins: int) -> Array:
    known = np.isfinite(values)
    count = np.bincount(index[known], minlength=bins)
    energy = np.bincount(index[known], values[known] ** 2, bins)
    return np.where(count >= FEWEST_ROWS, np.sqrt(energy / np.maximum(count, 1)), np.nan)
