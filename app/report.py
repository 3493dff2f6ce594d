"""The report of a diagnosis: one HTML file with its plots in it, to read without network and to file."""

import base64
import hashlib
from dataclasses import replace
from functools import cache
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup
from sqlalchemy.orm import Session

from app import views
from app.documents import DiagnosisAnswer
from app.service import Service
from app.web import charts
from app.web.pages.recordings import event_times
from app.web.templating import instant, percent, quantity
from app.web.words import name_of, verdict_of
from casebase.description import condition_of
from casebase.models import StoredDiagnosis
from casebase.signals.analysis import Analysis

STYLE = (Path(__file__).parent / "web" / "static" / "gearcase.css").read_text("utf-8")
STYLE_SHA256 = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
CONTENT_SECURITY_POLICY = (
    f"default-src 'none'; img-src data:; style-src 'sha256-{STYLE_SHA256}'; base-uri 'none'; frame-ancestors 'none'"
)
CREST_WINDOW_S = 1.0
COLUMNS = 800


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("app", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters.update(quantity=quantity, percent=percent, name_of=name_of)
    return environment.get_template("report.html")


def report_page(service: Service, session: Session, row: StoredDiagnosis, answer: DiagnosisAnswer) -> str:
    """Return the report of a diagnosis as HTML.

    Raises:
        NotFoundError: if the audio is missing from the data folder.
    """
    stored = row.recording
    recording = views.decoded(service.library.audio_path(stored), stored.channel)
    recording = replace(recording, unit=stored.unit)
    analysis = Analysis(recording, condition_of(stored.description))
    picture = base64.b64encode(views.spectrogram_png(recording, COLUMNS)).decode()
    return _template().render(
        diagnosis=answer,
        verdict=verdict_of(row.document),
        recording=stored,
        given=instant(row.created_at, service.settings.time_zone),
        taken=instant(stored.recorded_at, service.settings.time_zone),
        style=Markup(STYLE),  # noqa: S704 - our own style sheet, whose hash stands in the policy
        plots=[
            charts.waveform(recording, analysis, event_times(session, stored)).svg(),
            charts.crest_trace(recording, CREST_WINDOW_S).svg(),
            charts.level_trace(recording, CREST_WINDOW_S).svg(),
            charts.spectrum(recording, ()).svg(),
        ],
        spectrogram=f"data:image/png;base64,{picture}",
    )
