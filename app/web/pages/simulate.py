"""Simulate: an axis with mechanisms from sliders, drawn and heard beside the one that is described."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated
from urllib.parse import urlencode

import numpy as np
from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.responses import Response

from app.api.recordings import asked_range
from app.http.errors import Unprocessable
from app.http.security import ReadingLimit
from app.recordings.intake import hear
from app.recordings.metadata import RecordingMetadata
from app.report.charts import Chart
from app.report.svg import Series
from app.report.words import certainty, verdict_of
from app.service import Service, TheService
from app.simulated.generation import wav
from app.web.page import PageViewer, render
from app.web.simulator import Line, Run, Slider, moved, simulate, sliders
from casebase.axes import find_axis, get_axis, list_axes
from casebase.diagnoses import provenance
from signals.crest import peak, root_mean_square
from signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.paper_axis import PAPER_AXIS

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
    request: Request, service: TheService, principal: PageViewer, wanted: TheAsked, diagnose: bool = False
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
    return render(request, "simulator.html", context, principal=principal, section=router.prefix)


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
    start, end = asked_range(byte_range, len(content))
    if end - start == len(content):
        return Response(content, headers={"Accept-Ranges": "bytes"}, media_type="audio/wav")
    headers = {"Accept-Ranges": "bytes", "Content-Range": f"bytes {start}-{end - 1}/{len(content)}"}
    return Response(content[start:end], 206, headers, "audio/wav")


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
