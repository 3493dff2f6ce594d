"""What a page shows of an investigation: panels of model and measurement, and the candidates that were weighed.

Overlay and residual are always two panels over one axis, with the noise floor of the measurement; the residual is then
sorted by angle, order, speed and time, because where it lives says what it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import freqz, welch

from sim.chain_model import Array
from sim.discrepancy.candidates import Rival
from sim.discrepancy.criteria import evidence
from sim.discrepancy.fit import Fit, Problem
from sim.discrepancy.selection import Selection

if TYPE_CHECKING:
    from sim.discrepancy.investigation import Investigation

MEAN_S = 0.01  # values over time are means of this, which leaves what is below 50 Hz
SHOWN_S = 8.0
SHOWN_HZ = 250.0
LINE_HZ = 0.5
BINS, SPEEDS = 72, 24
FEWEST_ROWS = 20  # of a bin, each a mean of MEAN_S
ORDERS_PER_TURN = 128
TURNS = 16
DIGITS = 4
DESCRIBED, EXTENDED = "description, calibrated", "with what was found"


@dataclass(frozen=True)
class Panel:
    """Lines over one x, each of shape (n,), NaN where there is nothing; `noise` is a band of y.

    Panels with the same `cursor` are read together.
    """

    title: str
    x_label: str
    y_label: str
    cursor: str
    x: Array
    lines: tuple[tuple[str, Array], ...]
    noise: tuple[float, float] | None = None
    markers: tuple[tuple[float, str], ...] = ()

    def document(self) -> dict[str, object]:
        """JSON; what is not finite is null."""
        return {
            "title": self.title,
            "x_label": self.x_label,
            "y_label": self.y_label,
            "cursor": self.cursor,
            "x": _numbers(self.x),
            "lines": [{"name": name, "y": _numbers(y)} for name, y in self.lines],
            "noise": None if self.noise is None else _numbers(np.array(self.noise)),
            "markers": [{"x": x, "text": text} for x, text in self.markers],
        }


def story(result: Investigation) -> dict[str, object]:
    """Panels and candidates as JSON."""
    selection = result.selection
    if selection is None:
        return _heard(result)
    shown = _Residuals.of(selection)
    overlay = (shown.torque_over_time(), shown.torque_left(), shown.spectrum(), shown.spectrum_left())
    where = (shown.by_angle(), shown.by_order(), shown.by_speed(), shown.by_time(), *shown.at_the_load())
    return {
        "overlay": [panel.document() for panel in overlay],
        "residual": [panel.document() for panel in where],
        "candidates": [_candidate(selection, rival) for rival in selection.rejected[:12]],
    }


def _heard(result: Investigation) -> dict[str, object]:
    from sim.discrepancy.sound_story import sound_candidates, sound_panels  # which draws on the panels here

    if result.listening is None:
        return {"overlay": [], "residual": [], "candidates": []}
    overlay, where = sound_panels(result.listening)
    return {
        "overlay": [panel.document() for panel in overlay],
        "residual": [panel.document() for panel in where],
        "candidates": sound_candidates(result.listening),
    }


@dataclass(frozen=True)
class _Residuals:
    """What each model leaves of the motor torque [N m], shape (n,), and at the load, on its own slower clock.

    `whitening` is the filter that makes the measurement's own noise white with a deviation of 1.
    """

    problem: Problem
    whitening: Array
    left: tuple[tuple[str, Array], ...]
    at_load: tuple[tuple[str, Array], ...]

    @staticmethod
    def of(selection: Selection) -> _Residuals:
        fits = [(DESCRIBED, selection.base)] + ([(EXTENDED, selection.fit)] if selection.fit.terms else [])
        found = [(name, _left(selection.problem, fit)) for name, fit in fits]
        return _Residuals(
            selection.problem,
            selection.problem.noise_of(selection.fit).torque,
            tuple((name, torque) for name, (torque, _) in found),
            tuple((name, guide) for name, (_, guide) in found if guide.size),
        )

    @property
    def rate_hz(self) -> float:
        return self.problem.measurement.rate_hz

    def torque_over_time(self) -> Panel:
        m = self.problem.measurement
        lines = (("measured", m.torque), *((name, m.torque - left) for name, left in self.left))
        return self._over_time("Motor torque: measured and simulated", lines, None)

    def torque_left(self) -> Panel:
        return self._over_time("Motor torque: what is left", self._moving(), (-2 * self.floor(), 2 * self.floor()))

    def spectrum(self) -> Panel:
        m = self.problem.measurement
        lines = (("measured", m.torque), *((name, m.torque - left) for name, left in self.left))
        return self._spectra("Spectrum: measured and simulated", [(name, self._level(y)) for name, y in lines])

    def spectrum_left(self) -> Panel:
        lines = [(name, self._level(left)) for name, left in self.left]
        frequency = self._level(self.left[0][1])[0]
        _, response = freqz(self.whitening, worN=frequency, fs=self.rate_hz)
        floor = 10 * np.log10(2.0 / self.rate_hz / np.abs(response) ** 2)
        return self._spectra("Spectrum: what is left", [*lines, ("noise floor", (frequency, floor))])

    def by_angle(self) -> Panel:
        chain = self.problem.chain((), {})
        ratio = math.prod(link.ratio for link in chain.links)
        angle = np.degrees(self.problem.measurement.angle / ratio) % 360.0
        edges = np.linspace(0.0, 360.0, BINS + 1)
        return self._binned("By angle of the load", "angle of the load [°]", angle, edges)

    def by_speed(self) -> Panel:
        m = self.problem.measurement
        speed = self._means(m.speed)
        moving = speed[self._means(m.moving) >= 0.5]
        edges = np.unique(np.quantile(moving if moving.size else speed, np.linspace(0.0, 1.0, SPEEDS + 1)))
        return self._binned("By speed and direction", "speed of the motor [rad/s]", m.speed, edges)

    def by_time(self) -> Panel:
        time = self.problem.measurement.time_s
        edges = np.linspace(float(time[0]), float(time[-1]), BINS + 1)
        return self._binned("By time", "time [s]", time, edges)

    def by_order(self) -> Panel:
        """Against turns of the motor instead of time: what a tooth does stands at one order at every speed."""
        m = self.problem.measurement
        turned = np.concatenate([[0.0], np.cumsum(np.abs(m.speed[1:])) / m.rate_hz]) / (2 * math.pi)
        grid = np.arange(0.0, turned[-1], 1.0 / ORDERS_PER_TURN)
        lines = []
        order = np.zeros(0)
        for name, left in self.left:
            even = np.interp(grid, turned, left * m.weight)
            order, power = welch(even, ORDERS_PER_TURN, nperseg=min(TURNS * ORDERS_PER_TURN, even.size))
            lines.append((name, 10 * np.log10(np.maximum(power, 1e-30))))
        teeth = self.problem.axis.stages[0].driver_teeth if self.problem.axis.stages else None
        highest = 2.5 * teeth if teeth else 8.0
        used = (order > 0) & (order <= min(highest, ORDERS_PER_TURN / 2))
        markers = tuple((float(k * teeth), f"mesh {k}×") for k in (1, 2)) if teeth else ()
        return Panel(
            "By order of the motor",
            "order of the motor [1]",
            "level [dB re 1 (N m)²/order]",
            "order",
            order[used],
            tuple((name, y[used]) for name, y in lines),
            markers=markers,
        )

    def at_the_load(self) -> tuple[Panel, ...]:
        if not self.at_load:
            return ()
        rate = self.rate_hz / self.problem.guide_stride
        count = min(self.at_load[0][1].size, int(SHOWN_S * rate))
        time = self.problem.measurement.time_s[:: self.problem.guide_stride][:count]
        lines = tuple((name, values[:count]) for name, values in self.at_load)
        return (Panel("Torque that the model lacks at the load", "time [s]", "torque [N m]", "time", time, lines),)

    def floor(self) -> float:
        """Standard deviation of the measurement's own noise in means of MEAN_S [N m]."""
        frequency = np.linspace(0.0, self.rate_hz / 2, 2048)
        _, response = freqz(self.whitening, worN=frequency, fs=self.rate_hz)
        density = 2.0 / self.rate_hz / np.abs(response) ** 2 * np.sinc(frequency * MEAN_S) ** 2
        return math.sqrt(float(np.trapezoid(density, frequency)))

    def _moving(self) -> tuple[tuple[str, Array], ...]:
        """Where dry friction holds whatever it likes, nothing is left that would mean anything."""
        still = self.problem.measurement.weight < 0.5
        return tuple((name, np.where(still, np.nan, left)) for name, left in self.left)

    def _over_time(self, title: str, lines: Sequence[tuple[str, Array]], noise: tuple[float, float] | None) -> Panel:
        m = self.problem.measurement
        count = int(min(m.samples, SHOWN_S * m.rate_hz))
        time = self._means(m.time_s[:count])
        drawn = tuple((name, self._means(y[:count])) for name, y in lines)
        return Panel(title, "time [s]", "torque [N m]", "time", time, drawn, noise)

    def _means(self, values: Array) -> Array:
        size = max(1, round(MEAN_S * self.rate_hz))
        whole = values.size // size * size
        return np.asarray(values[:whole].reshape(-1, size).mean(axis=1))

    def _level(self, values: Array) -> tuple[Array, Array]:
        size = min(round(self.rate_hz / LINE_HZ), values.size)
        frequency, power = welch(values, self.rate_hz, nperseg=size)
        used = (frequency > 0) & (frequency <= SHOWN_HZ)
        return frequency[used], 10 * np.log10(np.maximum(power[used], 1e-30))

    def _spectra(self, title: str, lines: Sequence[tuple[str, tuple[Array, Array]]]) -> Panel:
        drawn = tuple((name, level) for name, (_, level) in lines)
        return Panel(title, "frequency [Hz]", "level [dB re 1 (N m)²/Hz]", "frequency", lines[0][1][0], drawn)

    def _binned(self, title: str, x_label: str, where: Array, edges: Array) -> Panel:
        """Effective value of what is left, in means of MEAN_S, per bin; NaN where too little was measured."""
        bins = edges.size - 1
        index = np.clip(np.digitize(self._means(where), edges) - 1, 0, bins - 1)
        lines = []
        for name, left in self._moving():
            values = self._means(left)
            known = np.isfinite(values)
            count = np.bincount(index[known], minlength=bins)
            energy = np.bincount(index[known], values[known] ** 2, bins)
            level = np.sqrt(energy / np.maximum(count, 1))
            lines.append((name, np.where(count >= FEWEST_ROWS, level, np.nan)))
        centres = (edges[:-1] + edges[1:]) / 2
        cursor = title.lower().replace(" ", "-")
        return Panel(title, x_label, "what is left, rms [N m]", cursor, centres, tuple(lines), (0.0, self.floor()))


def _left(problem: Problem, fit: Fit) -> tuple[Array, Array]:
    return problem.raw_residuals(fit.terms, fit.values, weighted=False)


def _candidate(selection: Selection, rival: Rival) -> dict[str, object]:
    """A mechanism that was weighed and left out: how probable, and why not."""
    fit = selection.fit
    rows = fit.residual.size
    gain = rival.gain / max(1.0, fit.misfit / rows)
    probability = 1.0 / (1.0 + math.exp(min(-evidence(rival.term, gain, rows), 50.0)))
    if rival.gain <= 0:
        reason = "It explains nothing that the others leave."
    elif rival.beyond <= 0.0:
        reason = "The size that fits best is what a new gearbox has."
    elif probability < 0.5:
        reason = "What it explains is less than one more mechanism must explain."
    else:
        reason = "It did not hold on rows that the fit had not seen, or another explains the same."
    return {
        "mechanism": rival.term.mechanism,
        "location": rival.term.location,
        "probability": round(probability, 4),
        "reason": reason,
    }


def _numbers(values: Array) -> list[float | None]:
    return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in values.tolist()]
