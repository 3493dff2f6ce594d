"""Try a model: parameters of an axis on sliders, simulated again at once and held against a recording."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from numpy.typing import NDArray
from sqlalchemy import exists, select
from sqlalchemy.orm import Session

from app import views
from app.errors import Unprocessable
from app.gate import Looking
from app.service import Service, TheService
from app.web.charts import Chart
from app.web.session import PageViewer
from app.web.svg import Band, Series
from app.web.templating import quantity, render
from app.web.trial import Trial, besides, built, simulate, starts
from casebase.axes import get_axis
from casebase.description import condition_of
from casebase.errors import NotFoundError
from casebase.models import Case, StoredRecording
from casebase.origins import SIMULATED, simulated
from casebase.signals.analysis import Analysis
from casebase.signals.crest import crest_factor, root_mean_square
from casebase.signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.discrepancy.report.formatting import named, words_of
from sim.mechanisms.mechanism import Mechanism

router = APIRouter(prefix="/axes")
RESOLUTION_HZ = 4.0
SHOWN_RECORDINGS = 50
LEVEL = "level, rms [dB re own RMS²]"


@dataclass(frozen=True)
class Slider:
    """One parameter to try: name in the query, words, unit, range, step (None: any) and start."""

    name: str
    words: str
    unit: str
    low: float
    high: float
    step: float | None
    start: float


SLIDERS = (
    Slider("stiffness", "Stiffness of the last mesh, times the data sheet", "1", 0.3, 3.0, 0.05, 1.0),
    Slider("damping", "Damping of the meshes, times the data sheet", "1", 0.2, 5.0, 0.1, 1.0),
    Slider("error", "Transmission error, times that of a new gear", "1", 0.0, 6.0, 0.1, 1.0),
    Slider("gap_mrad", "Backlash (play) of the last mesh", "mrad", 0.0, 3.0, None, 0.0),
    Slider("notch_mrad", "Tooth damage (notch) of the last gear, depth", "mrad", 0.0, 3.0, None, 0.0),
    Slider("rubbing_db", "Rubbing noise", "dB", -40.0, 20.0, 1.0, -10.0),
    Slider("ambient_db", "Ambient noise", "dB", -60.0, 0.0, 1.0, -30.0),
)


@router.get("/{name}/try", dependencies=[Looking])
def try_parameters(
    request: Request,
    service: TheService,
    principal: PageViewer,
    name: str,
    recording: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """Simulate the axis with the parameters of the query, beside a recording of it: measured, or a simulated case."""
    with service.library.reading() as session:
        axis = read_axis(get_axis(session, name).document)
        rows, known = _recordings(session, name)
    if not axis.stages:
        raise Unprocessable(
            f"The axis {name!r} has no gear stage, so it has no teeth whose sound could be simulated. Describe its "
            "gears in [[stages]] and add it again: POST /api/v1/axes."
        )
    sliders = _sliders(axis)
    values = {slider.name: _value(request, slider) for slider in sliders}
    row = _chosen(rows, recording, name)
    origins = {one.id: "simulated case" if one.id in known else "measured" for one in rows}
    compared = compared_of(service, row, origins[row.id]) if row else None
    began = perf_counter()
    payload, speed = (row.payload_kg_m2, row.speed_rad_s) if row else (None, None)
    samples = simulate(Trial(axis, values, payload, speed, compared.period_s if compared else None))
    tried = heard("simulated now", Recording(samples, SAMPLE_RATE_HZ, channel=0, channels=1))
    took_ms = 1000 * (perf_counter() - began)
    sounds = [tried, compared] if compared else [tried]
    context = {
        "name": name,
        "sliders": [(slider, values[slider.name]) for slider in sliders],
        "besides": [mechanism_words(built(entry)) for entry in besides(axis)],
        "recordings": rows,
        "chosen": row,
        "spectrum": _spectra(sounds),
        "origins": origins,
        "difference": _difference(tried, compared) if compared else None,
        "sounds": sounds,
        "took_ms": took_ms,
    }
    return render(request, "try.html", context, principal=principal, section="/axes")


def _sliders(axis: Axis) -> list[Slider]:
    """Return the sliders, from what the revision has on; one that could not show it reaches twice as far."""
    begin = starts(axis)
    return [
        replace(one, start=begin[one.name], high=max(one.high, 2 * begin[one.name])) if one.name in begin else one
        for one in SLIDERS
    ]


def _chosen(rows: Sequence[StoredRecording], wanted: str, axis: str) -> StoredRecording | None:
    if not wanted:
        return rows[0] if rows else None
    for row in rows:
        if row.id == wanted:
            return row
    raise NotFoundError(f"none of the newest {SHOWN_RECORDINGS} recordings of the axis {axis!r} has the id {wanted!r}")


def mechanism_words(mechanism: Mechanism) -> str:
    """Say what a mechanism is, where it is and how large.

    >>> from sim.mechanisms import Backlash
    >>> print(mechanism_words(Backlash("transfer", {"gap_rad": 0.001})))
    backlash (play) at transfer (gap 0.001\xa0rad)
    """
    unit = next(one.unit for one in mechanism.parameters if one.name == mechanism.size)
    size = quantity(mechanism[mechanism.size], unit)
    return f"{named(mechanism.name, mechanism.location)} ({words_of(mechanism.size)} {size})"


def _value(request: Request, slider: Slider) -> float:
    try:
        value = float(request.query_params.get(slider.name, slider.start))
    except ValueError:
        return slider.start
    return min(max(value, slider.low), slider.high) if math.isfinite(value) else slider.start


def _recordings(session: Session, axis: str) -> tuple[list[StoredRecording], frozenset[str]]:
    """Return the recordings of an axis, measured ones first, the newest first of each; and ids of the simulated."""
    statement = select(StoredRecording).where(
        StoredRecording.axis == axis, StoredRecording.usable, StoredRecording.erased_at.is_(None)
    )
    generated = exists().where(Case.recording_id == StoredRecording.id, Case.origin == SIMULATED)
    rows = session.scalars(statement.order_by(generated, StoredRecording.id.desc()).limit(SHOWN_RECORDINGS)).all()
    known = simulated(session, rows)
    return sorted(rows, key=lambda row: row.id in known), known


@dataclass(frozen=True)
class Heard:
    """What is compared of a sound: levels [dB re own RMS²] over frequency [Hz], crest factors, period of the motion."""

    words: str
    frequency_hz: NDArray[np.float64]
    level_db: NDArray[np.float64]
    crest_factor: float
    crest_factor_low: float
    period_s: float | None = None


def heard(words: str, sound: Recording) -> Heard:
    """Return what is compared of a sound; levels are against its own RMS, so that an uncalibrated gain drops out."""
    size = min(sound.samples.size, round(sound.sample_rate_hz / RESOLUTION_HZ))
    from scipy import signal  # slow to import

    frequency, power = signal.welch(sound.samples, sound.sample_rate_hz, nperseg=size, scaling="spectrum")
    own = max(root_mean_square(sound.samples) ** 2, 1e-30)
    low = signal.sosfiltfilt(signal.butter(4, 200.0, fs=sound.sample_rate_hz, output="sos"), sound.samples)
    level = 10 * np.log10(np.maximum(power, 1e-30) / own)
    return Heard(words, frequency, level, crest_factor(sound.samples), crest_factor(low.astype(np.float32)))


def compared_of(service: Service, row: StoredRecording, words: str) -> Heard:
    """Return what is compared of a recording; a recording never changes, so it is looked at once."""
    path, description = service.library.retrieve.audio_path(row), json.dumps(row.description, sort_keys=True)
    return replace(_looked_at(path, row.channel, description), words=words)


@lru_cache(maxsize=64)
def _looked_at(path: Path, channel: int, description: str) -> Heard:
    recording = views.decoded(path, channel)
    analysis = Analysis(recording, condition_of(json.loads(description)))
    return replace(heard("", recording), period_s=analysis.motion.period_s)


def _spectra(sounds: Sequence[Heard]) -> Chart:
    series = [Series(sound.words, sound.frequency_hz, sound.level_db) for sound in sounds]
    return Chart("Spectrum", tuple(series), "frequency [Hz]", LEVEL)


def _difference(tried: Heard, compared: Heard) -> Chart:
    """What is too loud (above 0) or too quiet in the simulation, as far as both reach."""
    frequency = tried.frequency_hz[tried.frequency_hz <= compared.frequency_hz[-1]]
    level = tried.level_db[: frequency.size] - np.interp(frequency, compared.frequency_hz, compared.level_db)
    return Chart(
        "What is left",
        (Series(f"{tried.words} less {compared.words}", frequency, level),),
        "frequency [Hz]",
        "difference [dB]",
        bands=(Band("within 3 dB", -3.0, 3.0),),
    )
