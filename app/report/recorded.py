"""What the pages take from a stored recording: samples, analysis, features, what stood out, where its meshes lie."""

import json
import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any, Literal, TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.http.errors import NotFound
from app.recordings import views
from app.report import charts
from app.report.disturbed import stretches
from app.report.svg import Marker
from app.service import Service
from casebase.description import condition_of
from casebase.recordings import named_features
from casebase.store.models import Extractor, FeatureRow, StoredRecording
from signals.analysis import Analysis
from signals.features import EXTRACTOR_VERSION
from signals.recording import Recording
from signals.recording_quality.disturbances import Survey, survey

PlotName = Literal["waveform", "crest", "level", "spectrum", "orders", "fold"]
COLUMNS = 800
SHOWN = ("crest_factor_whole_record", "crest_factor_low_pass_200_hz_whole_record", "rms", "peak")
HELD = "features"

Stored = TypeVar("Stored", Extractor, FeatureRow)


def decoded(service: Service, row: StoredRecording) -> Recording:
    """Return the samples of a stored recording."""
    return replace(views.decoded(service.library.retrieve.audio_path(row), row.channel), unit=row.unit)


def surveyed(recording: Recording, row: StoredRecording) -> Survey:
    """Return what of it is analysed, and what is left out, under the condition that was told."""
    key = (row.file_sha256, row.channel, row.unit, json.dumps(row.description, sort_keys=True))
    return views.SURVEYED.get(key, lambda: survey(recording, condition_of(row.description)))


def _events(session: Session, row: StoredRecording) -> list[dict[str, Any]]:
    stored = stored_features(session, row.id)
    return [event for event in (stored.events if stored else []) if isinstance(event, dict)]


def event_times(session: Session, row: StoredRecording, kind: str | None = None) -> tuple[float, ...]:
    """Return when something of a kind stood out [s]; where nothing did, all impulses, notch and play, no reversals."""
    found = [event for event in _events(session, row) if event["kind"] != "reversal"]
    named = [event for event in found if event["kind"] == kind]
    return tuple(float(event["time_s"]) for event in named or found)


def strongest_events(session: Session, row: StoredRecording) -> dict[str, float]:
    """Return when the strongest event of each kind happens [s]."""
    ordered = sorted(_events(session, row), key=lambda event: event["strength_db"])
    return {str(event["kind"]): float(event["time_s"]) for event in ordered}


def order_markers(analysis: Analysis) -> tuple[Marker, ...]:
    """Return where meshes lie at the largest speed [Hz]; nothing without axis and speed."""
    speed, orders = analysis.condition.speed_rad_s, analysis.condition.mesh_orders
    if not speed:
        return ()
    return tuple(Marker(order * speed / (2 * math.pi), f"mesh {order:g}×") for order in orders)


def spectrogram_png(service: Service, row: StoredRecording, *, dark: bool = False, top_hz: float = 0.0) -> bytes:
    """Return the spectrogram as PNG with what is left out of the recording; drawn once for who looks next."""

    def drawn() -> bytes:
        recording = decoded(service, row)
        marked = [(each.start_s, each.end_s, each.text) for each in stretches(surveyed(recording, row))]
        return views.spectrogram_png(recording, COLUMNS, dark=dark, marked=marked, top_hz=top_hz)

    path, description = service.library.retrieve.audio_path(row), json.dumps(row.description, sort_keys=True)
    return views.kept((path, row.channel, row.unit, "marked spectrogram", description, dark, top_hz), drawn)


def chart_of(
    name: PlotName, session: Session, service: Service, row: StoredRecording, points: int = charts.SHOWN_POINTS
) -> charts.Chart:
    """Return one chart of a recording.

    Raises:
        NotFound: if this recording does not have it.
    """
    recording = decoded(service, row)
    if name == "level":
        return charts.level_trace(recording)
    found = surveyed(recording, row)
    analysis = found.analysis
    if name == "crest":
        return charts.crest_trace(found)
    if name == "waveform":
        return charts.waveform(found, event_times(session, row), points)
    if name == "fold":
        folded = charts.fold_charts(analysis)
        if folded is None:
            raise NotFound("No period of the motion was given or heard, so there is no average stroke.")
        return folded[0]
    speed = row.speed_rad_s
    if name == "orders" and not speed:
        raise NotFound("Orders need the speed of the axis, and none was given with this recording.")
    return charts.spectrum(
        recording, order_markers(analysis), speed / (2 * math.pi) if name == "orders" and speed else None
    )


def features_of(session: Session, recording_id: str) -> dict[str, float | None]:
    """Return the stored features of a recording; those that a page shows are unknown with an older extractor."""
    stored, extractor = stored_features(session, recording_id), _held(session, Extractor, EXTRACTOR_VERSION)
    if stored is None or extractor is None:
        return dict.fromkeys(SHOWN)
    return named_features(stored, extractor.names)


def stored_features(session: Session, recording_id: str) -> FeatureRow | None:
    """Return the features as they are stored; a page that asks for them several times reads them once."""
    return _held(session, FeatureRow, (recording_id, EXTRACTOR_VERSION))


def read_together(session: Session, recordings: Collection[str]) -> None:
    """Read the features of several recordings in one statement, before they are asked for one by one."""
    wanted = FeatureRow.recording_id.in_(recordings)
    rows = session.scalars(select(FeatureRow).where(wanted, FeatureRow.extractor_version == EXTRACTOR_VERSION)).all()
    session.info.setdefault(HELD, []).extend(rows)


def _held(session: Session, kind: type[Stored], key: str | tuple[str, str]) -> Stored | None:
    """Return a row, and keep hold of it: a session forgets what nobody holds, and reads it again."""
    row = session.get(kind, key)
    session.info.setdefault(HELD, []).append(row)
    return row
