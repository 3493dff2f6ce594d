"""An axis with mechanisms from sliders: simulated in the limited process, and kept for who moves a slider back.

A light wheel in a stiff mesh takes thousands of steps for each one of the sound, and who moves a slider is not made to
know.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.recordings.views import Kept, spectrum
from signals.crest import CrestTrace, crest_trace
from signals.reading.limited_pool import LimitedPool, refusals_as
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.errors import SimulationError
from sim.experiment.scenario import travel_rad
from sim.experiment.virtual_measurement import TELEMETRY_RATE_HZ
from sim.mechanisms import Backlash, KinematicError, ToothDamage
from sim.mechanisms.catalogue import mechanism_of, with_mechanism
from sim.mechanisms.mechanism import Mechanism

LIMITS: Mapping[str, float] = {"seconds": 40.0, "cpu_seconds": 15.0, "memory_bytes": 2 << 30}
"""A gearbox takes a tenth of a second."""
GIVEN_UP = (
    "the simulation was given up ({}): a very light wheel in a stiff mesh, or very strong damping, needs steps too "
    "small to try here; bring the description's inertias, stiffness and friction nearer to those of a gearbox"
)
RESOLUTION_HZ = 4.0
Line = tuple[NDArray[np.float64], NDArray[np.float64]]
"""x and y of the same length."""
RUNS = LimitedPool(1, "app.web.simulator_worker")


@dataclass(frozen=True)
class Slider:
    """One number to move: name in the query, words, unit, range, and where it stands at the description."""

    name: str
    words: str
    unit: str
    low: float
    high: float
    start: float


def sliders(axis: Axis) -> tuple[Slider, ...]:
    """Return the sliders of an axis with a gear; one whose start is large reaches twice as far."""
    last = axis.stages[-1]
    gear = f"of the {last.name} gear"
    gap_rad = max(last.backlash_rad, _described(axis, Backlash).get("gap_rad", 0.0))
    depth_rad = _described(axis, ToothDamage).get("depth_rad", 0.0)
    error = _described(axis, KinematicError)
    order = error.get("order", last.driver_teeth or 2.0)
    return (
        _slider("gap_mrad", f"Backlash (play) {gear}", "mrad", 3.0, 1e3 * gap_rad),
        _slider("notch_mrad", f"Tooth damage (notch) {gear}, depth", "mrad", 3.0, 1e3 * depth_rad),
        _slider("error_mrad", f"Transmission error {gear}", "mrad", 0.3, 1e3 * error.get("amplitude_rad", 0.0)),
        _slider("order", "Order of this error", "per turn of its pinion", 50.0, order, low=0.5),
        _slider("friction", "Dry friction of motor and load", "times the data sheet", 5.0, 1.0),
    )


def _slider(name: str, words: str, unit: str, high: float, start: float, low: float = 0.0) -> Slider:
    start = float(f"{start:.6g}")
    return Slider(name, words, unit, low, max(high, 2 * start), start)


def _described(axis: Axis, kind: type[Mechanism]) -> Mapping[str, float]:
    """Return the values of the first such mechanism that the description has at its last gear; none without one."""
    found = [mechanism_of(entry) for entry in axis.mechanisms if entry.name == kind.name]
    return next((one.values for one in found if one.placed(axis) == axis.stages[-1].name), {})


def moved(axis: Axis, values: Mapping[str, float]) -> Axis:
    """Return an axis with what the sliders say; what stands at the description stays as it is.

    Args:
        values: of all sliders, by name.
    """
    off = {one.name: values[one.name] for one in sliders(axis) if values[one.name] != one.start}
    last = axis.stages[-1]
    if "gap_mrad" in off:
        axis = replace(axis, stages=(*axis.stages[:-1], replace(last, backlash_rad=0.0)))
        axis = _with(axis, Backlash, gap_rad=1e-3 * off["gap_mrad"])
    if "notch_mrad" in off:
        place = {} if _described(axis, ToothDamage) else {"angle_rad": travel_rad(axis.motion) / 2 % (2 * np.pi)}
        axis = _with(axis, ToothDamage, depth_rad=1e-3 * off["notch_mrad"], **place)
    if "error_mrad" in off or "order" in off:
        axis = _with(axis, KinematicError, amplitude_rad=1e-3 * values["error_mrad"], order=values["order"])
    if "friction" in off:
        motor = replace(axis.motor, coulomb_friction_n_m=axis.motor.coulomb_friction_n_m * off["friction"])
        load = replace(axis.load, coulomb_friction_n_m=axis.load.coulomb_friction_n_m * off["friction"])
        axis = replace(axis, motor=motor, load=load)
    return axis


def _with(axis: Axis, kind: type[Mechanism], **values: float) -> Axis:
    """Put a mechanism at the last gear in place of the described one, whose other values it keeps."""
    last, known = axis.stages[-1].name, _described(axis, kind)
    others = [entry for entry in axis.mechanisms if entry.name != kind.name or mechanism_of(entry).placed(axis) != last]
    return with_mechanism(replace(axis, mechanisms=tuple(others)), kind(last, {**known, **values}))


@dataclass(frozen=True, eq=False)
class Run:
    """What a run gives, and what is drawn of it.

    Args:
        time_s, torque_n_m, speed_rad_s: motor torque and speed of the output, as a drive records them, shape (n,).
        sound: at `SAMPLE_RATE_HZ`, in full scales.
    """

    time_s: NDArray[np.float64]
    torque_n_m: NDArray[np.float64]
    speed_rad_s: NDArray[np.float64]
    sound: NDArray[np.float32]

    @cached_property
    def crest(self) -> CrestTrace:
        """Crest factor over time, by the one definition of docs/paper.md."""
        return crest_trace(self.sound, SAMPLE_RATE_HZ)

    @cached_property
    def spectrum(self) -> Line:
        """Frequency [Hz] and level of the averaged power spectrum [dB re 1²]."""
        found = spectrum(Recording(self.sound, SAMPLE_RATE_HZ), RESOLUTION_HZ)
        return np.array(found.frequency_hz), np.array(found.level_db)


KEPT: Kept[Run] = Kept(32 << 20, lambda run: 24 * run.time_s.size + run.sound.nbytes)
"""About sixty runs: who moves a slider back sees and hears the same at once."""


def simulate(axis: Axis, duration_s: float) -> Run:
    """Return a run of an axis along its motion [s]; the same axis sounds the same.

    Raises:
        SimulationError: if it cannot be simulated, or not within the limits.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    asked = {"axis": axis.to_mapping(), "duration_s": duration_s}
    return KEPT.get(json.dumps(asked, sort_keys=True), lambda: _performed(asked))


def _performed(asked: Mapping[str, Any]) -> Run:
    largest = round(8 * asked["duration_s"] * (SAMPLE_RATE_HZ + 3 * TELEMETRY_RATE_HZ))
    with refusals_as(SimulationError, GIVEN_UP):
        content, rows = RUNS.perform("app.web.simulator_worker:task", asked, LIMITS, largest)
    values = np.frombuffer(content, dtype=np.float32)
    time_s, torque_n_m, speed_rad_s = values[: 3 * rows].astype(np.float64).reshape(3, rows)
    return Run(time_s, torque_n_m, speed_rad_s, values[3 * rows :])
