"""Plots and sound of a recording, for pages; the demo recording is open to anybody."""

import math
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse
from sqlalchemy import select
from sqlalchemy.orm import Session

from app import views
from app.api import recordings as api
from app.errors import NotFound
from app.intake import DEMO
from app.security import Role
from app.service import Reading, Service, TheService
from app.web import charts
from app.web.recorded import CREST_WINDOW_S, analysed, decoded, event_times, order_markers
from app.web.session import SignInNeeded, Visitor
from casebase.models import Artifact, StoredRecording

router = APIRouter(prefix="/recordings/{recording_id}")

PlotName = Literal["waveform", "crest", "level", "spectrum", "orders", "fold"]


def demo_ids(session: Session) -> tuple[str, str] | None:
    """Return diagnosis and recording of the demonstration that came with the starter library, if there is one."""
    row = session.scalars(select(Artifact).where(Artifact.kind == DEMO, Artifact.active)).first()
    if row is None:
        return None
    return str(row.content["diagnosis_id"]), str(row.content["recording_id"])


def allowed(session: Session, principal: Visitor, request: Request, recording_id: str) -> None:
    """Let viewers see everything and anybody the demonstration.

    Raises:
        SignInNeeded: otherwise.
    """
    if principal is not None and principal.role.may(Role.VIEWER):
        return
    demo = demo_ids(session)
    if demo is None or demo[1] != recording_id:
        raise SignInNeeded(request.url.path)


def chart_of(
    name: PlotName, session: Session, service: Service, row: StoredRecording, points: int = charts.SHOWN_POINTS
) -> charts.Chart:
    """Return one chart of a recording.

    Raises:
        NotFound: if this recording does not have it.
    """
    recording = decoded(service, row)
    if name == "crest":
        return charts.crest_trace(recording, CREST_WINDOW_S)
    if name == "level":
        return charts.level_trace(recording, CREST_WINDOW_S)
    analysis = analysed(recording, row)
    if name == "waveform":
        return charts.waveform(recording, analysis, event_times(session, row), points)
    if name == "fold":
        folded = charts.fold_charts(analysis)
        if folded is None:
            raise NotFound("No motion was told or heard in this recording, so there is nothing to fold.")
        return folded[0]
    speed = row.speed_rad_s
    if name == "orders" and not speed:
        raise NotFound("Orders need the speed of the axis; it was not told with this recording.")
    return charts.spectrum(
        recording, order_markers(analysis), speed / (2 * math.pi) if name == "orders" and speed else None
    )


@router.get("/plots/{name}")
def plot(
    request: Request,
    session: Reading,
    service: TheService,
    principal: Visitor,
    recording_id: str,
    name: PlotName,
    points: Annotated[int, Query(ge=100, le=400_000)] = charts.SHOWN_POINTS,
) -> Response:
    """Numbers of one plot, for the interactive drawing."""
    allowed(session, principal, request, recording_id)
    row = service.library.recording(session, recording_id)
    return JSONResponse(chart_of(name, session, service, row, points).document(), headers=api.UNCHANGING)


@router.get("/sound")
def sound(
    request: Request,
    session: Reading,
    service: TheService,
    principal: Visitor,
    recording_id: str,
    byte_range: Annotated[str | None, Header(alias="Range", max_length=100)] = None,
) -> Response:
    """The sound, whole or one range of it."""
    allowed(session, principal, request, recording_id)
    return api.file_answer(service, service.library.recording(session, recording_id), byte_range, None)


@router.get("/spectrogram.png")
def spectrogram(
    request: Request,
    session: Reading,
    service: TheService,
    principal: Visitor,
    recording_id: str,
    theme: Literal["light", "dark"] = "light",
) -> Response:
    """The spectrogram, drawn here because browsers resample sound."""
    allowed(session, principal, request, recording_id)
    row = service.library.recording(session, recording_id)
    image = views.spectrogram_png(decoded(service, row), 800, dark=theme == "dark")
    return Response(image, headers=api.UNCHANGING, media_type="image/png")
