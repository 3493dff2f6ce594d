"""One plot for each cause: the torque that it makes, over what it hangs on.

Measured here is what the extended model leaves of the measurement without this one cause: as described it would be
zero, and with the cause it is what the cause makes of it (partial residuals: Cook, Technometrics 35 (1993) 351). Both
are means of all rows in a bin, in the channel where the cause stands highest above the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim.chain.model import Array
from sim.description.transmission import compliance
from sim.investigation.estimation.doubts import by_doubts
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.report.acoustic_panels import along_path, sound_panels
from sim.investigation.report.formatting import named
from sim.investigation.report.panels import AS_DESCRIBED, EXTENDED, MEASURED, Panel
from sim.investigation.report.residual_panels import FEWEST_ROWS, OUTLIERS, Channel, channels, overlay_panels
from sim.investigation.report.wording import numbers_of
from sim.investigation.search.search import Selection
from sim.mechanisms.catalogue import kind_or_any

if TYPE_CHECKING:
    from sim.investigation.results import Finding, Investigation

MINUTES = 60.0 * math.degrees(1.0)  # of arc in a radian
BINS, PER_PERIOD = 48, 8  # of a plot; of one period at least, or its curve is not seen


@dataclass(frozen=True)
class Over:
    """What a cause hangs on: x of every row, shape (n,), and how both axes are called.

    `way`: by which the torque is multiplied, 1 or the sign of the speed; `turn`: where x begins anew; `reach`: how far
    to either side of 0 is shown; `spring`: torque by springs as described, to which what a cause makes is added [N m].
    """

    what: str
    x_label: str
    x: Array
    way: Array
    turn: float | None = None
    reach: float | None = None
    spring: Array | None = None


def cause_panels(result: Investigation) -> list[Panel | None]:
    """The plot of every finding, in their order; one that shows several stands at the first."""
    shown = [cause_panel(result, finding) for finding in result.findings]
    told = [panel and panel.document() for panel in shown]
    return [None if document in told[:place] else shown[place] for place, document in enumerate(told)]


def cause_panel(result: Investigation, finding: Finding) -> Panel | None:
    """The plot that shows a finding; None where nothing was drawn that could."""
    selection = result.selection
    if selection is None or result.data_check is None:
        return _of_encoders(result) or _of_sound(result, finding)
    keys = {(term.mechanism, term.location): term for term in selection.found}
    term = keys.get((finding.mechanism, finding.location))
    if term is not None:
        return _of_term(selection, term, numbers_of(finding))
    if kind_or_any(finding.mechanism).kind == "measurement":
        over_time, _, spectrum, _ = overlay_panels(selection)
        return spectrum if kind_or_any(finding.mechanism).signature.domain == "frequency" else over_time
    return next(iter(along_path(result)), None)


def _of_encoders(result: Investigation) -> Panel | None:
    return next(iter(result.encoders), None)


def _of_sound(result: Investigation, finding: Finding) -> Panel | None:
    """What comes at one place of a motion shows in the strokes, what has a pitch in a spectrum, all else in time."""
    if result.acoustic is None:
        return None
    overlay, strokes = sound_panels(result.acoustic)
    sign = kind_or_any(finding.mechanism).signature
    if sign.per_cycle is not None and strokes:
        return strokes[0]
    spectra = [panel for panel in overlay if panel.cursor == "frequency"]
    return spectra[-1] if spectra and sign.domain in ("angle", "frequency") else overlay[0]


def _of_term(selection: Selection, term: Term, numbers: Mapping[str, float]) -> Panel | None:
    problem, fit = selection.problem, selection.fit
    rest = tuple(other for other in fit.terms if other.key != term.key)
    without = problem.raw_residuals(rest, problem.numbers(rest) | dict(fit.values), weighted=False)
    left = problem.raw_residuals(fit.terms, fit.values, weighted=False)
    wrong = (
        by_doubts(problem.measurement, problem.noise, left[0]),
        np.zeros(1),
    )  # of the known torque, in each channel: of no cause
    shown = [
        (channel, lacking - off, lacking - rest_of_it)
        for channel, lacking, rest_of_it, off in zip(channels(selection), without, left, wrong, strict=False)
    ]
    sign = kind_or_any(term.mechanism).signature
    if sign.domain in ("twist", "reversal") and problem.guided:
        channel, lacking, made = shown[-1]
        return _binned(channel, term, _over_twist(channel, term, fit.values, numbers), lacking, made)
    channel, lacking, made = max(shown, key=lambda each: _height(each[0], each[2]))
    if sign.domain == "frequency":
        title = f"{_begun(named(term.mechanism, term.location))}: spectrum of the residual"
        return channel.spectrum_of(title, ((AS_DESCRIBED, lacking), (EXTENDED, lacking - made)))
    return _binned(channel, term, _over(channel, term, numbers), lacking, made)


def _height(channel: Channel, made: Array) -> float:
    """Of what a cause makes above the noise of a channel."""
    counts = channel.weight[: channel.size]
    return math.sqrt(float(np.mean((made * counts) ** 2))) / max(channel.floor(), 1e-12)


def _over(channel: Channel, term: Term, numbers: Mapping[str, float]) -> Over:
    """What the class of a mechanism says that it hangs on."""
    sign = kind_or_any(term.mechanism).signature
    m = channel.problem.measurement
    speed, time = m.speed[:: channel.stride], m.time_s[:: channel.stride]
    same, along = np.ones(speed.size), np.sign(speed)
    way = along if sign.direction == "opposite" else same
    if sign.domain == "speed":
        return Over("speed", "speed of the motor [rad/s]", speed, same)
    if sign.domain == "torque":
        load = m.torque[:: channel.stride] * along
        return Over("load", "motor torque along the motion, measured [N m]", load, way)
    if sign.domain == "reversal":
        turned = np.degrees(m.angle[:: channel.stride])
        return Over("angle", "angle of the motor since it turned back [°]", _since_reversal(turned, speed), along)
    if sign.domain == "angle":
        return _over_angle(channel, term, numbers)
    return Over("time", "time [s]", time, way)


def _over_twist(channel: Channel, term: Term, values: Mapping[str, float], numbers: Mapping[str, float]) -> Over:
    """How far the motor is ahead of the load, with the springs and the backlash of the description.

    Of a gap a fifth of the plot is its flat middle.
    """
    m, axis = channel.problem.measurement, channel.problem.axis
    assert m.load_angle is not None
    kind = kind_or_any(term.mechanism)
    twist = (m.angle / axis.ratio - m.load_angle + values.get("load_offset_rad", 0.0))[:: channel.stride]
    gap = sum(stage.backlash_rad / axis.ratio_from(stage.name) for stage in axis.stages)
    spring = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * gap, 0.0) / max(compliance(axis), 1e-30)
    reach = None
    if kind.traits.gap and numbers.get(kind.size):
        reach = MINUTES * 2.5 * numbers[kind.size] / axis.ratio_from(term.location or "load")
    label = "motor ahead of the load, at the load [arc min]"
    return Over("twist", label, MINUTES * twist, np.ones(twist.size), reach=reach, spring=spring)


def _over_angle(channel: Channel, term: Term, numbers: Mapping[str, float]) -> Over:
    """A whole turn of the shaft, or one of its periods where more pass in a turn than can be told apart in a plot."""
    sign = kind_or_any(term.mechanism).signature
    m, axis = channel.problem.measurement, channel.problem.axis
    shafts = ["motor", *(stage.name for stage in axis.stages)]
    name = "load" if term.location in (None, "load") else term.location
    shaft = shafts[-1] if name == "load" else name
    if sign.of_input_shaft and shaft in shafts:
        shaft = name = shafts[max(shafts.index(shaft) - 1, 0)]
    order = sign.order or 1
    if order == "mesh":
        order = next((stage.driven_teeth or 1 for stage in axis.stages if stage.name == shaft), 1)
    order = float(numbers.get(order, 1.0) if isinstance(order, str) else order)
    ratio = axis.ratio_from(shaft) / axis.ratio if shaft in axis.locations else 1.0
    ratio = ratio / m.gear if name == "load" else ratio
    angle = np.degrees(m.angle[:: channel.stride] * ratio)
    if float(np.ptp(angle)) < (360.0 if order * PER_PERIOD <= BINS else 360.0 / order):
        return Over("angle", f"angle of {name} [°]", angle, np.ones(angle.size))
    if order * PER_PERIOD <= BINS:
        return Over("turn", f"angle of {name} [°]", angle % 360.0, np.ones(angle.size), 360.0)
    label = f"angle of {name} within one of {order:g} periods of a turn [°]"
    period = 360.0 / order
    return Over("period", label, angle % period, np.ones(angle.size), period)


def _since_reversal(turned: Array, speed: Array) -> Array:
    """How far [as `turned`] since the motion turned back last; NaN before it first did."""
    back = np.flatnonzero(np.diff(np.sign(speed)) != 0) + 1
    at = np.searchsorted(back, np.arange(turned.size), side="right") - 1
    since = np.abs(turned - turned[back[np.maximum(at, 0)]]) if back.size else np.full(turned.size, np.nan)
    return np.where(at >= 0, since, np.nan)


def _binned(channel: Channel, term: Term, over: Over, lacking: Array, made: Array) -> Panel | None:
    x, way = over.x[: channel.size], over.way[: channel.size]
    counts = (channel.weight[: channel.size] >= 0.5) & np.isfinite(x)
    if not counts.any():
        return None
    low, high = (0.0, over.turn) if over.turn else np.quantile(x[counts], [OUTLIERS, 1.0 - OUTLIERS])
    if over.reach is not None:
        low, high = max(low, -over.reach), min(high, over.reach)
    spring = np.zeros(x.size) if over.spring is None else over.spring[: channel.size]
    edges = np.linspace(low, max(high, low + 1e-12), BINS + 1)
    index = np.where(counts, np.digitize(x, edges) - 1, -1)
    lines = (
        (MEASURED, _means(spring + lacking * way, index)),
        (AS_DESCRIBED, _means(spring, index)),
        (EXTENDED, _means(spring + made * way, index)),
    )
    along = " along the motion" if (way != 1.0).any() else ""
    centres = (edges[:-1] + edges[1:]) / 2
    title = f"{_begun(named(term.mechanism, term.location))}: torque over {over.what}"
    return Panel(title, over.x_label, f"{channel.name.lower()}{along} [N m]", over.what, centres, lines)


def _begun(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}"


def _means(values: Array, index: NDArray[np.int64]) -> Array:
    known = (index >= 0) & (index < BINS) & np.isfinite(values)
    count = np.bincount(index[known], minlength=BINS)
    total = np.bincount(index[known], values[known], BINS)
    return np.where(count >= FEWEST_ROWS, total / np.maximum(count, 1), np.nan)
