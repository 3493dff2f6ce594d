"""A case laid over the plots of a recording, at equal loudness, because gains of microphones are not told."""

import math
from dataclasses import replace

from sqlalchemy.orm import Session

from app.errors import NotFound
from app.service import Service
from app.web.charts import Chart
from app.web.features import features_of
from app.web.recorded import PlotName, chart_of
from app.web.svg import Series
from casebase.errors import ErasedError
from casebase.models import Case, StoredRecording

TAKEN = {"waveform": 1, "crest": 1, "level": 1, "spectrum": 1, "orders": 1, "fold": 2}
"""How many lines of a case are laid over a plot; more would hide what they are compared with."""


def laid_over(
    chart: Chart, name: PlotName, session: Session, service: Service, own: StoredRecording, case: Case
) -> Chart:
    """Return the chart with the lines of a case added; as it was where the case has no such plot."""
    try:
        other = chart_of(name, session, service, case.recording)
    except (NotFound, ErasedError):
        return chart
    words = f"{case.label} case, {case.origin}"
    gain = loudness_ratio(session, own, case.recording)
    added = [
        Series(f"{words}: {one.name}", one.x, scale(name, gain) * one.y + offset_db(name, gain))
        for one in other.series[: TAKEN[name]]
    ]
    return replace(chart, series=(*chart.series, *added))


def loudness_ratio(session: Session, own: StoredRecording, other: StoredRecording) -> float:
    """Return by how much the other must be amplified to be as loud, in RMS; 1 where either is not known."""
    own_rms, other_rms = (features_of(session, row.id).get("rms") for row in (own, other))
    return own_rms / other_rms if own_rms and other_rms else 1.0


def scale(name: PlotName, gain: float) -> float:
    """Return what the gain does to the values of a plot by multiplication."""
    return gain if name in ("waveform", "level") else 1.0


def offset_db(name: PlotName, gain: float) -> float:
    """Return what the gain does to the values of a plot by addition [dB]."""
    return 20 * math.log10(gain) if name in ("spectrum", "orders") else 0.0
