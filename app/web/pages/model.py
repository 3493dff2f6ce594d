"""Try a model: parameters of an axis on sliders, simulated again at once and held against a recording."""

import math
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from numpy.typing import NDArray
from scipy import signal
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.service import Reading, TheService
from app.web.charts import Chart
from app.web.recorded import analysed, decoded
from app.web.session import PageViewer
from app.web.svg import Series
from app.web.templating import render
from casebase.axes import get_axis
from casebase.models import StoredRecording
from casebase.signals.crest import crest_factor, root_mean_square
from casebase.signals.recording import Recording
from sim.axis import Axis, MechanismEntry, read_axis
from sim.scenario import Scenario, with_motion
from sim.sound import SAMPLE_RATE_HZ, Microphone, Mode
from sim.specimen import Specimen

router = APIRouter(prefix="/axes")
SHOWN_S = 8.0
RESOLUTION_HZ = 4.0
DEFAULT_MODES = (Mode(320.0, 0.04, 1.0), Mode(900.0, 0.03, 0.6), Mode(1700.0, 0.03, 0.4))


@dataclass(frozen=True)
class Slider:
    """One parameter to try: name in the query, words, unit, range, step and start."""

    name: str
    words: str
    unit: str
    low: float
    high: float
    step: float
    start: float


SLIDERS = (
    Slider("stiffness", "Stiffness of the last mesh, times the data sheet", "1", 0.3, 3.0, 0.05, 1.0),
    Slider("damping", "Damping of the meshes, times the data sheet", "1", 0.2, 5.0, 0.1, 1.0),
    Slider("error", "Transmission error, times as new", "1", 0.0, 6.0, 0.1, 1.0),
    Slider("gap_mrad", "Play of the last mesh", "mrad", 0.0, 3.0, 0.05, 0.0),
    Slider("notch_mrad", "Depth of a notch in the last gear", "mrad", 0.0, 3.0, 0.05, 0.0),
    Slider("rubbing_db", "Rubbing noise", "dB", -40.0, 20.0, 1.0, -10.0),
    Slider("ambient_db", "Ambient noise", "dB", -60.0, 0.0, 1.0, -30.0),
)


@router.get("/{name}/try")
def try_parameters(
    request: Request,
    session: Reading,
    service: TheService,
    principal: PageViewer,
    name: str,
    recording: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """Simulate the axis with the parameters of the query, beside a measured recording of it."""
    axis = read_axis(get_axis(session, name).document)
    values = {slider.name: _value(request, slider) for slider in SLIDERS}
    rows = _recordings(session, name)
    row = next((one for one in rows if one.id == recording), rows[0] if rows else None)
    measured = decoded(service, row) if row else None
    period_s = analysed(measured, row).motion.period_s if measured and row else None
    began = perf_counter()
    simulated = simulate(axis, values, row, period_s)
    took_ms = 1000 * (perf_counter() - began)
    spectra = [("simulated", simulated)] + ([("measured", measured)] if measured else [])
    context = {
        "name": name,
        "sliders": [(slider, values[slider.name]) for slider in SLIDERS],
        "recordings": rows,
        "chosen": row,
        "spectrum": _spectra(spectra),
        "table": [(words, _crest(sound), _low_crest(sound)) for words, sound in spectra],
        "took_ms": took_ms,
    }
    return render(request, "try.html", context, principal=principal, section="/axes")


def _value(request: Request, slider: Slider) -> float:
    try:
        value = float(request.query_params.get(slider.name, slider.start))
    except ValueError:
        return slider.start
    return min(max(value, slider.low), slider.high) if math.isfinite(value) else slider.start


def _recordings(session: Session, axis: str) -> list[StoredRecording]:
    statement = select(StoredRecording).where(StoredRecording.axis == axis, StoredRecording.usable)
    return list(session.scalars(statement.order_by(StoredRecording.id.desc()).limit(50)))


def simulate(axis: Axis, values: dict[str, float], row: StoredRecording | None, period_s: float | None) -> Recording:
    """Return the sound of the axis with these parameters, moved as in the recording where that is known."""
    if row is not None and row.speed_rad_s:
        axis = with_motion(axis, load_speed_rad_s=row.speed_rad_s)
    if period_s:
        axis = with_motion(axis, period_s=period_s)
    last = axis.stages[-1].name
    entries = list(axis.mechanisms)
    if values["gap_mrad"] > 0:
        entries.append(MechanismEntry("backlash", last, {"gap_rad": values["gap_mrad"] * 1e-3}))
    if values["notch_mrad"] > 0:
        parameters = {"depth_rad": values["notch_mrad"] * 1e-3, "angle_rad": 0.0, "flank": 1.0}
        entries.append(MechanismEntry("tooth_damage", last, parameters))
    stiffness = axis.stiffness()[-1]
    if stiffness is not None:
        stage = replace(axis.stages[-1], stiffness_n_m_per_rad=stiffness * values["stiffness"])
        axis = replace(axis, stages=(*axis.stages[:-1], stage))
    scenario = Scenario(
        axis=replace(axis, mechanisms=tuple(entries)),
        payload_kg_m2=(row.payload_kg_m2 if row is not None else None) or axis.load.inertia_kg_m2,
        specimen=Specimen(seed=1, error=values["error"], damping=values["damping"]),
        microphone=Microphone(
            modes=DEFAULT_MODES,
            gain=1e-3,
            rubbing_n_m=10 ** (values["rubbing_db"] / 20),
            ambient_n_m=10 ** (values["ambient_db"] / 20),
        ),
        duration_s=SHOWN_S,
    )
    return Recording(samples=scenario.perform(), sample_rate_hz=SAMPLE_RATE_HZ, channel=0, channels=1)


def _spectra(sounds: list[tuple[str, Recording]]) -> Chart:
    series = [Series(words, *_levels(sound)) for words, sound in sounds]
    return Chart("Spectrum", tuple(series), "frequency [Hz]", "level, rms [dB re own RMS²]")


def _levels(sound: Recording) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies [Hz] and levels against the sound's own RMS [dB]: an uncalibrated gain drops out."""
    size = min(sound.samples.size, round(sound.sample_rate_hz / RESOLUTION_HZ))
    frequency, power = signal.welch(sound.samples, sound.sample_rate_hz, nperseg=size, scaling="spectrum")
    own = max(root_mean_square(sound.samples) ** 2, 1e-30)
    return frequency, 10 * np.log10(np.maximum(power, 1e-30) / own)


def _crest(sound: Recording) -> float:
    return crest_factor(sound.samples)


def _low_crest(sound: Recording) -> float:
    low = signal.sosfiltfilt(signal.butter(4, 200.0, fs=sound.sample_rate_hz, output="sos"), sound.samples)
    return crest_factor(low.astype(np.float32))
