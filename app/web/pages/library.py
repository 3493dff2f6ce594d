"""The library: cases in a table, coverage, one case with its history, several edited together; plots and sound.

The recording of the demonstration is open to anybody.
"""

import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Form, Header, Query, Request
from fastapi.responses import JSONResponse, RedirectResponse, Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.api import recordings as api
from app.api.steps import told as told_step
from app.background_cache import Pending
from app.http.errors import Conflict, Unprocessable
from app.http.security import Principal, ReadingLimit
from app.recordings import views
from app.recordings.intake import CaseMetadata
from app.report import charts
from app.report.formatting import name_of, sentence
from app.report.recorded import PlotName, chart_of, features_of, spectrogram_png
from app.service import Reading, Service, TheService
from app.web import forms
from app.web.first_hour import axis_cases
from app.web.page import (
    RECORDED,
    FromOurPage,
    Message,
    PageAdmin,
    PageViewer,
    SignInNeeded,
    Visitor,
    below_root,
    demo_ids,
    lead,
    listing,
    of_library,
    render,
    root_of,
    waiting_page,
)
from casebase.axes import find_axis, is_axis, unknown_axis
from casebase.errors import NotFoundError
from casebase.reasoning.evaluation import Evaluation
from casebase.search.axis_cases import LabelCases
from casebase.search.case_filter import CaseFilter, selected
from casebase.steps import last_step, newest_of, step_name
from casebase.store import erasing
from casebase.store.models import Case, StoredRecording
from casebase.teaching import teaching
from signals.features import catalogue

router = APIRouter()
SECTION = "/library"
TAUGHT = "Effect of this case on the library"
FILTERS = ("label", "origin", "axis", "gearbox", "state", "verification")


@router.get("/library")
def cases(request: Request, session: Reading, service: TheService, _: PageViewer) -> Response:
    """The cases, newest first, by label, axis, gearbox, origin and state."""
    asked: dict[str, Any] = {name: request.query_params.get(name) or None for name in FILTERS}
    wanted = CaseFilter(**asked)
    counts, evaluation = service.counts(session), service.evaluation_known(session)
    columns = {**RECORDED, "label": Case.label, "verified": Case.verification}
    context = {
        "list": listing(request, session, selected(wanted), **columns),
        "labels": [(one, name_of(one)) for one in sorted({label for label, _ in counts})],
        "counts": sorted(counts.items()),
        "total": sum(counts.values()),
        "right": evaluation.accuracy if evaluation and evaluation.cases else None,
        "choices": forms.choices(one for one, _ in counts),
        "step": told_step(session, forms.number_of(request, "step")),
    }
    messages: tuple[Message, ...] = ()
    if wanted.axis and not is_axis(session, wanted.axis):
        messages = (Message(sentence(unknown_axis(session, wanted.axis)), "warn"),)
    return render(request, "library.html", context, section=SECTION, messages=messages)


@router.post("/library/change", dependencies=[FromOurPage])
def change_several(
    service: TheService,
    principal: PageAdmin,
    action: Annotated[Literal["retire", "restore", "release", "label"], Form()],
    label: forms.LabelGiven,
    case_id: Annotated[list[str] | None, Form()] = None,
) -> Response:
    """Retire, restore, release or label all chosen cases together, or none of them."""
    chosen_ids = list(dict.fromkeys(case_id or []))
    if not chosen_ids:
        raise Unprocessable("No case was chosen: tick the cases first.")
    change = getattr(service.library.revise, "case" if action == "label" else action)
    given = [{"label": label()}] if action == "label" else []
    return _changed(service, principal, lambda session: [change(session, one, *given) for one in chosen_ids])


@router.post("/library/rename", dependencies=[FromOurPage])
def rename(service: TheService, principal: PageAdmin, old: Annotated[str, Form()], label: forms.LabelGiven) -> Response:
    """Give all cases of a label another one, retired ones too."""
    right = label()

    def change(session: Session) -> None:
        for one in session.scalars(select(Case.id).where(Case.label == old)).all():
            service.library.revise.case(session, one, {"label": right})

    return _changed(service, principal, change)


def _changed(service: Service, principal: Principal, change: Callable[[Session], object]) -> Response:
    name = step_name()
    with service.library.transaction(principal.actor, name) as session:
        change(session)
        session.flush()
        step = newest_of(session, name)
    return lead(service, f"/library?step={step or 0}")


@router.get("/library/add")
def add_page(request: Request, session: Reading, service: TheService, _: PageAdmin) -> Response:
    """The form of a new case."""
    context = forms.import_choices(service, session)
    return render(request, "add_case.html", context, section=SECTION)


@router.post("/library/add")
def add(principal: PageAdmin, upload: forms.OurUpload, service: TheService) -> Response:
    """Take a labelled recording in."""
    forms.said_how(upload.fields.get("verification"))
    fields = forms.told(upload.fields, "verified_by", "verification", "size_rad")
    fields["label"] = forms.label_of(service, upload)
    intake, metadata = forms.taken_in(service, upload, fields, CaseMetadata)
    with service.library.transaction(principal.actor, step_name()) as session:
        row = intake.store(service.library, session)
        case_id = service.library.retain.case(session, row, metadata.labelling()).id
    return lead(service, f"/cases/{case_id}?kept=1")


@router.get("/library/coverage")
def coverage(request: Request, session: Reading, service: TheService, _: PageViewer) -> Response:
    """How many cases there are of every label, per axis and origin, and where there are none."""
    known = axis_cases(service, session)
    labels = sorted({label for of in known.values() for label in of} | {"normal", "notch", "play"})
    axes = sorted(known, key=lambda axis: axis or "")
    rows = [(axis, label, known[axis].get(label, LabelCases())) for axis in axes for label in labels]
    found = listing(request, session, rows, axis=lambda row: row[0] or "", label=lambda row: name_of(row[1]))
    return render(request, "coverage.html", {"list": found}, section=SECTION)


@router.get("/cases/{case_id}/taught", dependencies=[ReadingLimit])
def taught(request: Request, session: Reading, service: TheService, _: PageViewer, case_id: str) -> Response:
    """What the library says of gearboxes that are held out, without this case and with it."""
    row = service.library.retrieve.case(session, case_id)
    if row.id not in service.library.retrieve.table(session).ids:
        raise Conflict(
            "This case does not count, so it teaches nothing: it is not in use, or its sound is a case already."
        )
    without = service.evaluation_soon(session, "both", without=row.id)
    having = service.evaluation_soon(session, "both")
    for one in (without, having):
        if isinstance(one, Pending):
            above, basis = (f"/cases/{row.id}", f"Case {row.label}"), of_library(service, session)
            return waiting_page(request, one, title=TAUGHT, words=row.recording.file_name, basis=basis, crumb=above)
    assert isinstance(without, Evaluation)
    assert isinstance(having, Evaluation)
    context = {"case": row, "taught": teaching(without, having, row.id)}
    return render(request, "taught.html", context, section=SECTION)


@router.get("/cases/{case_id}", dependencies=[ReadingLimit])
def case(request: Request, session: Reading, service: TheService, _: PageViewer, case_id: str) -> Response:
    """One case: what it sounds like, where it comes from, what happened to it."""
    row = service.library.retrieve.case(session, case_id)
    known, erased = catalogue(), row.recording.erased_at is not None
    features = [
        (name, value, known[name].unit, known[name].physics)
        for name, value in features_of(session, row.recording_id).items()
        if name in known
    ]
    context = {
        "case": row,
        "recording": row.recording,
        "waveform": None if erased else chart_of("waveform", session, service, row.recording),
        "spectrum": None if erased else chart_of("spectrum", session, service, row.recording),
        "features": features,
        "damage": forms.damage_of(row.label),
        "history": service.library.retrieve.history(session, case_id),
        "described": row.recording.axis is None or find_axis(session, row.recording.axis) is not None,
        "last": last_step(session, [("case", row.id)]),
    }
    notices = (Message("Kept as a case of the library."),) if request.query_params.get("kept") else ()
    return render(request, "case.html", context, section=SECTION, messages=notices)


recordings = APIRouter(prefix="/recordings/{recording_id}")
demonstration = APIRouter()
PAGE_OF_OURS = re.compile(r"/(cases|diagnoses)/[0-9a-f]{32}")


def recording_seen(
    request: Request, session: Reading, service: TheService, principal: Visitor, recording_id: str
) -> StoredRecording:
    """Dependency: a recording of the path, which viewers see; anybody sees that of the demonstration.

    Raises:
        SignInNeeded: for others.
    """
    if principal is None and recording_id not in (demo_ids(session) or ())[1:]:
        raise SignInNeeded(below_root(request))
    return service.library.retrieve.recording(session, recording_id)


TheRecording = Annotated[StoredRecording, Depends(recording_seen)]


@demonstration.get("/demonstration.wav")
def demonstration_wav(session: Reading, service: TheService, _: Visitor) -> Response:
    """The recording of the demonstration, under a name that examples can use."""
    demo = demo_ids(session)
    if demo is None:
        raise NotFoundError("this library has no demonstration; `gearcase starter` makes one")
    return RedirectResponse(f"{root_of(service)}/recordings/{demo[1]}/sound", status_code=302)


@recordings.get("/plots/{name}", dependencies=[ReadingLimit])
def plot(
    session: Reading,
    service: TheService,
    row: TheRecording,
    name: PlotName,
    points: Annotated[int, Query(ge=100, le=400_000)] = charts.SHOWN_POINTS,
) -> Response:
    """Numbers of one plot, for the interactive drawing."""
    return JSONResponse(chart_of(name, session, service, row, points).document(), headers=api.UNTIL_ERASED)


@recordings.get("/sound")
def sound(
    service: TheService,
    row: TheRecording,
    byte_range: Annotated[str | None, Header(alias="Range", max_length=100)] = None,
) -> Response:
    """The sound, whole or one range of it."""
    return api.file_answer(service, row, byte_range, None)


@recordings.post("/erase", dependencies=[FromOurPage])
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


@recordings.get("/spectrogram.png", dependencies=[ReadingLimit])
def spectrogram(
    service: TheService,
    row: TheRecording,
    theme: Literal["light", "dark"] = "light",
    top_hz: Annotated[float, Query(ge=0, le=1e6)] = 0.0,
) -> Response:
    """The spectrogram, drawn here because browsers resample sound."""
    image = spectrogram_png(service, row, dark=theme == "dark", top_hz=top_hz)
    return Response(image, headers=api.UNTIL_ERASED, media_type="image/png")
