"""What page and report show of sound: loudness with the standstills, strokes folded, lines while cruising, orders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from signals.analysis import ANALYSIS_RATE_HZ
from signals.band import Band
from signals.motion import HOP_HZ, loudness_db
from sim.chain.model import Array
from sim.investigation.acoustic.baseline_comparison import USUAL_DB, growth_curves
from sim.investigation.acoustic.evidence import AcousticResult
from sim.investigation.acoustic.faults import impacts, over_around
from sim.investigation.acoustic.operating_states import Course, course_of
from sim.investigation.acoustic.order_spectrum import TRANSFORM, gamma_limit, mesh_orders
from sim.investigation.report.panels import SOUND, Panel
from sim.mechanisms import BearingDefect, StructuralResonance
from sim.mechanisms.catalogue import kind_of

if TYPE_CHECKING:
    from sim.investigation.results import Investigation

SHOWN_S, SHOWN_HZ = 20.0, 1500.0
MEAN_HOPS = 4
SHOWN_ORDER = 32.0
REACHED = "what noise reaches"


def sound_panels(listened: AcousticResult) -> tuple[list[Panel], list[Panel]]:
    """Panels of what was heard and of where it was looked for faults, of the first recording."""
    course = listened.courses[0]
    overlay = [_loudness(course)]
    if course.cruises:
        overlay.append(_lines(course))
    overlay += _growth(listened)
    folded = course.analysis.folded(Band.LOW)
    if folded is None:
        return overlay, []
    if not course.repeats:
        return overlay, [_impacts(course)]
    title = "Average stroke of the motion, below 200 Hz"
    lines = (("around one end", folded.forward_db), ("around the other end", folded.backward_db))
    labels = ("time from the standstill [s]", "over what noise reaches [dB]")
    low = float(min(np.nanmin(folded.forward_db), np.nanmin(folded.backward_db)))
    return overlay, [
        Panel(title, *labels, "stroke", folded.offset_s, lines, (low, 0.0), ((0.0, "standstill"),), REACHED)
    ]


def sound_candidates(listened: AcousticResult) -> list[tuple[str, str]]:
    """What was weighed and not named, and why."""
    weighed = ((name, kind_of(name).sound) for name, _ in listened.rejected)
    return [(name, sound.rejected) for name, sound in weighed if sound]


def along_path(result: Investigation) -> list[Panel]:
    """The envelope of a sound beside telemetry over the path of the motor, where bearings show; with its findings."""
    if result.data_check is None or not result.sounds:
        return []
    axis = result.axis
    heard = course_of(axis, result.sounds[0], result.data_check.measurement, result.sound_offset_s).orders
    if heard is None:
        return []
    shown = heard.orders < SHOWN_ORDER
    centre, highest = heard.orders[shown], heard.along.max(axis=0)[shown]
    lines = ((SOUND, 10.0 * np.log10(np.maximum(highest, 1e-3))),)
    bearings = [e.value for f in result.findings for e in f.parameters if f.mechanism == BearingDefect.name]
    teeth = tuple((k * order, "teeth") for order in mesh_orders(axis) for k in (1, 2) if k * order < SHOWN_ORDER)
    found = tuple((k * order, "bearing") for order in bearings for k in (1, 2, 3) if k * order < SHOWN_ORDER)
    labels = ("times per turn of the motor", "over its surroundings [dB]")
    noise = (-10.0, 10.0 * float(np.log10(gamma_limit(heard.averages, heard.orders.size))))
    return [
        Panel(
            "Impacts in the sound, by order",
            *labels,
            "order",
            centre,
            lines,
            noise,
            tuple(sorted((*found, *teeth))),
            REACHED,
        )
    ]


def _loudness(course: Course) -> Panel:
    level = loudness_db(course.analysis.samples, ANALYSIS_RATE_HZ)
    count = int(min(level.size, SHOWN_S * HOP_HZ)) // MEAN_HOPS * MEAN_HOPS
    mean = np.asarray(level[:count].reshape(-1, MEAN_HOPS).mean(axis=1), dtype=np.float64)
    time: Array = np.asarray((np.arange(mean.size) + 0.5) * MEAN_HOPS / HOP_HZ, dtype=np.float64)
    marks = tuple((t, "standstill") for t in course.analysis.motion.reversal_times_s if t <= SHOWN_S)
    lines = ((SOUND, mean),)
    return Panel("Loudness", "time [s]", "level [dB re full scale]", "time", time, lines, markers=marks)


def _impacts(course: Course) -> Panel:
    """What stands out of the second around it, where the motion does not repeat."""
    over = over_around(course.analysis.envelope(Band.LOW))
    count = int(min(over.size, SHOWN_S * HOP_HZ)) // MEAN_HOPS * MEAN_HOPS
    highest = over[:count].reshape(-1, MEAN_HOPS).max(axis=1)
    time: Array = np.asarray((np.arange(highest.size) + 0.5) * MEAN_HOPS / HOP_HZ, dtype=np.float64)
    found = impacts(course)
    times = () if found is None or found.times_s is None else found.times_s
    marks = [(t, "standstill") for t in course.analysis.motion.reversal_times_s if t <= SHOWN_S]
    marks += [(float(t), "impact") for t in times if t <= SHOWN_S]
    title, labels = "Impacts below 200 Hz", ("time [s]", "over the sound around [dB]")
    return Panel(title, *labels, "time", time, ((SOUND, highest),), markers=tuple(sorted(marks)))


def _lines(course: Course) -> Panel:
    """Strongest of about every Hz of the mean spectrum over its surroundings; what noise reaches is a band."""
    power = course.spectra.mean(axis=0)
    step = round(TRANSFORM / ANALYSIS_RATE_HZ)
    count = int(SHOWN_HZ * TRANSFORM / ANALYSIS_RATE_HZ) // step
    highest = np.asarray(power[: count * step].reshape(count, step).max(axis=1), dtype=np.float64)
    frequency: Array = (np.arange(count, dtype=np.float64) + 0.5) * step * ANALYSIS_RATE_HZ / TRANSFORM
    limit = 10.0 * float(np.log10(gamma_limit(len(course.cruises), TRANSFORM / 16.0)))
    lines = ((SOUND, 10.0 * np.log10(np.maximum(highest, 1e-3))),)
    labels = ("frequency [Hz]", "over its surroundings [dB]")
    return Panel(
        "Lines while cruising", *labels, "frequency", frequency, lines, (-10.0, limit), _teeth(course), REACHED
    )


def _growth(listened: AcousticResult) -> list[Panel]:
    """Where the first recording is louder than as new, with what was found; none where nothing was compared."""
    frequency, lines = growth_curves(listened.courses[0], listened.as_new)
    if not lines:
        return []
    pitches = [h.parameters["frequency_hz"][0] for h in listened.heard if h.mechanism == StructuralResonance.name]
    teeth = [one for one in _teeth(listened.courses[0]) if one[0] > frequency[0]]
    marks = tuple(sorted([*((pitch, "rings") for pitch in pitches), *teeth]))
    labels = ("frequency [Hz]", "louder than as new [dB]")
    title, usual = "Louder than as new, over the surroundings", (-USUAL_DB, USUAL_DB)
    return [Panel(title, *labels, "frequency", frequency, lines, usual, marks, "from day to day")]


def _teeth(course: Course) -> tuple[tuple[float, str], ...]:
    if course.speed is None:
        return ()
    found = [(k * order * course.speed, f"teeth {order:.3g}, {k}x") for order in course.mesh_orders for k in (1, 2)]
    return tuple(one for one in found if one[0] < SHOWN_HZ)
