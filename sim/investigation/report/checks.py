"""What was checked of sensors and recordings before any physics, and what came of it, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim.investigation.report.formatting import angle, number, percent
from sim.mechanisms import Clipping, ElectricalHum, LostSamples

if TYPE_CHECKING:
    from sim.investigation.results import Investigation

COUNTS = 0.5  # weight from which a row does
ROWS = "rows that count"
FAULTS = (LostSamples, Clipping, ElectricalHum)


def checked(result: Investigation) -> list[tuple[str, str]]:
    """Every check and its result, also where all is well."""
    told = {f.mechanism: f.explanation for f in result.findings}
    faults = [(words, told.get(kind.name, well)) for kind in FAULTS for words, well in [kind.checked or ("", "")]]
    return [*_of_telemetry(result), *_of_sound(result), *faults]


def _of_telemetry(result: Investigation) -> list[tuple[str, str]]:
    if result.encoders:
        return [("channels", "motor angle, load angle; no torque")]
    if result.selection is None:
        return []
    m = result.selection.problem.measurement
    axis = result.axis
    channels = ["motor torque", "motor angle", *(["load angle"] if m.load_angle is not None else [])]
    fast = float(np.std(np.diff(m.torque))) / math.sqrt(2.0)
    travel, top = float(np.ptp(m.angle)) / axis.ratio, float(np.abs(m.speed).max()) / axis.ratio
    moved = angle(travel) if axis.stages else f"{number(travel)} rad"
    trusted, counts = m.valid >= COUNTS, m.weight >= COUNTS
    long = f"{number(m.samples / m.rate_hz)} s at {number(m.rate_hz)} even rows per second"
    rows = (
        f"{_share(counts)}; {_share(~trusted)} left out at the start, or because values there are lost or cut, "
        f"{_share(trusted & ~counts)} at standstill or with rattling teeth"
    )
    return [
        ("channels", f"{', '.join(channels)}; {long}"),
        ("units, signs, order of the channels", "torque, angle and ratio agree with the description"),
        (ROWS, rows),
        ("torque from row to row", f"{number(fast)} N m rms: the noise of the channel is at least that"),
        ("travel of the load", f"{moved}, at up to {number(top)} rad/s"),
    ]  # fmt: skip


def _share(rows: NDArray[np.bool_]) -> str:
    return percent(float(rows.mean()), 1)


def _of_sound(result: Investigation) -> list[tuple[str, str]]:
    rows = [
        (f"sound {place}", f"{number(one.duration_s)} s at {one.sample_rate_hz:.0f} samples per second")
        for place, one in enumerate(result.sounds, start=1)
    ]
    listened = result.acoustic
    for place, course in enumerate(listened.as_new if listened else (), start=1):
        one = course.analysis.recording
        rows.append(
            (f"sound as new {place}", f"{number(one.duration_s)} s at {one.sample_rate_hz:.0f} samples per second")
        )
    for place, course in enumerate(listened.courses if listened else (), start=1):
        ends, motion = len(course.analysis.motion.reversal_times_s), "repeats" if course.repeats else "does not repeat"
        speed = "known from the lines of its teeth" if course.speed else "not known"
        rows.append(
            (
                f"motion heard in sound {place}",
                f"{ends} standstills, {len(course.cruises)} stretches at even speed; it {motion}; its speed is {speed}",
            )
        )
    return rows
