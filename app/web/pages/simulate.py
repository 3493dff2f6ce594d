"""Simulate: an axis with mechanisms from sliders, drawn and heard beside the one that is described."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any
from urllib.parse import urlencode

import numpy as np
from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.responses import Response
from numpy.typing import NDArray

from app.api.recordings import asked_range
from app.http.errors import Unprocessable
from app.http.security import ReadingLimit
from app.recordings.intake import RecordingMetadata, hear
from app.recordings.views import Kept, spectrum
from app.report.charts import Chart
from app.report.svg import Series
from app.report.words import certainty, verdict_of
from app.service import Service, TheService
from app.simulated.generation import wav
from app.web.page import PageViewer, render
from casebase.axes import find_axis, get_axis, list_axes
from casebase.diagnoses import provenance
from signals.crest import CrestTrace, crest_trace, peak, root_mean_square
from signals.reading.limited_pool import LimitedPool, refusals_as
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.errors import SimulationError
from sim.experiment.paper_axis import PAPER_AXIS
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
        _slider("gap_mrad", f"Backlash {gear}", "mrad", 3.0, 1e3 * gap_rad),
        _slider("notch_mrad", f"Tooth damage {gear}, depth", "mrad", 3.0, 1e3 * depth_rad),
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


KEPT: Kept[Run] = Kept(16 << 20, lambda run: 24 * run.time_s.size + run.sound.nbytes)
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


router = APIRouter(prefix="/simulate", dependencies=[ReadingLimit])
SHOWN, DIAGNOSED = (2, 2.0, 8.0), (4, 10.0, 24.0)
"""Cycles of the motion, but at least and at most so long [s], that are drawn and heard, and that are diagnosed."""
TIME = "time [s]"
PEAK = 0.2
"""Of the described axis, in full scales: what is louder is still heard as it is."""


@dataclass(frozen=True)
class SliderSettings:
    """An axis and where its sliders stand.

    Args:
        values: of all sliders, by name.
    """

    axis: Axis
    sliders: tuple[Slider, ...]
    values: Mapping[str, float]

    @property
    def described(self) -> "SliderSettings":
        """The same axis with all sliders at its description."""
        return replace(self, values={one.name: one.start for one in self.sliders})

    @property
    def query(self) -> str:
        return urlencode({"axis": self.axis.name, **self.values})

    def run(self, length: tuple[int, float, float] = SHOWN) -> Run:
        cycles, least_s, most_s = length
        return simulate(moved(self.axis, self.values), min(max(cycles * self.axis.motion.period_s, least_s), most_s))


def asked(request: Request, service: TheService, _: PageViewer, axis: Annotated[str, Query()] = "") -> SliderSettings:
    """Dependency: what the query asks for; by default the axis of the paper, whether it is stored or not.

    Raises:
        NotFoundError: if no axis has the name.
        Unprocessable: if it has no gear.
    """
    name = axis or PAPER_AXIS.name
    with service.library.reading() as session:
        is_not_stored = name == PAPER_AXIS.name and find_axis(session, name) is None
        known = PAPER_AXIS if is_not_stored else read_axis(get_axis(session, name).document)
    if not known.stages:
        raise Unprocessable(
            f"The axis {name!r} has no gear stage, so it has no teeth whose sound could be simulated. Describe its "
            "gears in [[stages]] and add it again: POST /api/v1/axes."
        )
    made = sliders(known)
    return SliderSettings(known, made, {one.name: _value(request.query_params.get(one.name), one) for one in made})


TheAsked = Annotated[SliderSettings, Depends(asked)]


def _value(text: str | None, slider: Slider) -> float:
    try:
        value = float(text or slider.start)
    except ValueError:
        return slider.start
    return min(max(value, slider.low), slider.high) if math.isfinite(value) else slider.start


@router.get("")
def simulate_axis(
    request: Request, service: TheService, _: PageViewer, wanted: TheAsked, diagnose: bool = False
) -> Response:
    """Draw the axis as it is set beside the axis as it is described; diagnose its sound if asked for."""
    with service.library.reading() as session:
        names = [row.name for row in list_axes(session) if row.document.get("stages")]
    words = "as described" if wanted.axis.mechanisms else "healthy, as described"
    runs = {"as set": wanted.run(), words: wanted.described.run()}
    context = {
        "axis": wanted.axis,
        "axes": sorted({PAPER_AXIS.name, *names}),
        "sliders": [(one, wanted.values[one.name]) for one in wanted.sliders],
        "described": words,
        "charts": charts(runs),
        "numbers": [
            ("Crest factor below 200 Hz", [run.crest.largest for run in runs.values()]),
            ("Effective value, rms", [root_mean_square(run.sound) for run in runs.values()]),
            ("Peak", [peak(run.sound) for run in runs.values()]),
        ],
        "sounds": [wanted.described.query, wanted.query],
        "diagnosis": diagnosed(service, wanted) if diagnose else None,
    }
    return render(request, "simulator.html", context, section=router.prefix)


def charts(runs: Mapping[str, Run]) -> tuple[Chart, ...]:
    """Draw the axis as it is set solid, and the described one dashed over it."""

    def drawn(title: str, x_label: str, y_label: str, of: Callable[[Run], Line]) -> Chart:
        lines = zip(runs, map(of, runs.values()), (1, 2), strict=True)
        return Chart(title, tuple(Series(name, x, y, style) for name, (x, y), style in lines), x_label, y_label)

    own, other = runs.values()
    more = own.torque_n_m - np.interp(own.time_s, other.time_s, other.torque_n_m)
    less = Series("as set, less the described one", own.time_s, more)
    return (
        drawn("Torque of the motor", TIME, "torque [N m]", lambda run: (run.time_s, run.torque_n_m)),
        Chart("Difference of the torque", (less,), TIME, "difference [N m]"),
        drawn("Speed of the output", TIME, "speed [rad/s]", lambda run: (run.time_s, run.speed_rad_s)),
        drawn(
            "Crest factor below 200 Hz", TIME, "crest factor [1]", lambda run: (run.crest.middle_s, run.crest.values)
        ),
        drawn("Spectrum of the sound", "frequency [Hz]", "level, rms [dB re 1²]", lambda run: run.spectrum),
    )


@router.get("/sound.wav")
def sound(
    wanted: TheAsked, byte_range: Annotated[str | None, Header(alias="Range", max_length=100)] = None
) -> Response:
    """The sound, whole or one range of it; the described one and the one that is set are louder by the same factor."""
    louder = PEAK / max(peak(wanted.described.run().sound), 1e-9)
    content = wav(np.clip(louder * wanted.run().sound, -1.0, 1.0))
    start, end, code, headers = asked_range(byte_range, len(content))
    return Response(content[start:end], code, headers, "audio/wav")


def diagnosed(service: Service, wanted: SliderSettings) -> Mapping[str, object]:
    """Return what the library says of the sound of a longer run of the same motion; nothing is stored."""
    axis = wanted.axis
    recording = Recording(wanted.run(DIAGNOSED).sound, SAMPLE_RATE_HZ)
    told = RecordingMetadata(
        axis=axis.name,
        speed_rad_s=axis.motion.load_speed_rad_s,
        payload_kg_m2=axis.load.inertia_kg_m2 or None,
    )
    heard = hear(service.library, recording, "simulated.wav", "audio/wav", told, axis)
    with service.library.reading() as session:
        reasoner = service.library.reuse.reasoner(session)
        found = reasoner.diagnose(heard.extraction, axis=axis.name)
        known = {"severity": None, "detection_limit": {}, "provenance": provenance(reasoner, axis.name)}
    document = {**found.to_document(), **known, "recording": {"duration_s": recording.duration_s}}
    return {
        "verdict": verdict_of(document),
        "label": found.label,
        "sure": certainty(document),
        "neighbours": found.neighbours,
        "duration_s": recording.duration_s,
    }
