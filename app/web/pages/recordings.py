"""Plots and sound of a recording, for pages; the demo recording is open to anybody."""

import re
from typing import Annotated, Literal

from fastapi import APIRouter, Form, Header, Query, Request, Response
from fastapi.responses import JSONResponse, RedirectResponse
from sqlalchemy.orm import Session

from app.api import recordings as api
from app.http.errors import Unprocessable
from app.http.security import ReadingLimit, Role
from app.recordings import views
from app.report import charts
from app.report.recorded import PlotName, chart_of, spectrogram_png
from app.service import Reading, TheService
from app.web.page import FromOurPage, PageAdmin, SignInNeeded, Visitor, below_root, demo_ids, lead, root_of
from casebase.errors import NotFoundError
from casebase.store import erasing

router = APIRouter(prefix="/recordings/{recording_id}")
demonstration = APIRouter()
PAGE_OF_OURS = re.compile(r"/(cases|diagnoses)/[0-9a-f]{32}")


def allowed(session: Session, principal: Visitor, request: Request, recording_id: str) -> None:
    """Let viewers see everything and anybody the demonstration.

    Raises:
        SignInNeeded: otherwise.
    """
    if principal is not None and principal.role.may(Role.VIEWER):
        return
    demo = demo_ids(session)
    if demo is None or demo[1] != recording_id:
        raise SignInNeeded(below_root(request))


@demonstration.get("/demonstration.wav")
def demonstration_wav(session: Reading, service: TheService, _: Visitor) -> Response:
    """The recording of the demonstration, under a name that examples can use."""
    demo = demo_ids(session)
    if demo is None:
        raise NotFoundError("this library has no demonstration; `gearcase starter` makes one")
    return RedirectResponse(f"{root_of(service)}/recordings/{demo[1]}/sound", status_code=302)


@router.get("/plots/{name}", dependencies=[ReadingLimit])
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
    row = service.library.retrieve.recording(session, recording_id)
    return JSONResponse(chart_of(name, session, service, row, points).document(), headers=api.UNTIL_ERASED)


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
    return api.file_answer(service, service.library.retrieve.recording(session, recording_id), byte_range, None)


@router.post("/erase", dependencies=[FromOurPage])
def erase(
    service: TheService,
    principal: PageAdmin,
    recording_id: str,
    sure: Annotated[Literal["yes"], Form()],
    back: Annotated[str, Form()],
) -> Response:
    """Erase the audio and lead back to the page of the case or diagnosis that asked for it."""
    if not PAGE_OF_OURS.fullmatch(back):
        raise Unprocessable("The form must say which page to go back to: /cases/ID or /diagnoses/ID.")
    with service.library.transaction(principal.actor) as session:
        erasing.erase(service.library, session, recording_id)
    views.forget()
    return lead(service, back)


@router.get("/spectrogram.png", dependencies=[ReadingLimit])
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
    row = service.library.retrieve.recording(session, recording_id)
    image = spectrogram_png(service, row, dark=theme == "dark")
    return Response(image, headers=api.UNTIL_ERASED, media_type="image/png")
