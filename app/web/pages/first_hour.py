"""The first hour on one's own axis: describe it, record it, simulate its cases, see how well the library does there."""

from collections.abc import Mapping
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import Response

from app.api.jobs import SimulationRequest, campaign_of
from app.api.steps import told as told_step
from app.axes import TEMPLATES, check_known
from app.background_cache import Pending
from app.http.errors import Unprocessable
from app.recordings.intake import RecordingMetadata
from app.report.disturbed import Flag, flags_of
from app.report.words import verdict_of
from app.service import Reading, Service, TheJobs, TheService
from app.simulated.generation import KIND as GENERATION
from app.web import forms
from app.web.first_hour import Hour, axis_cases, obstacles
from app.web.page import FromOurPage, Message, PageAdmin, PageOperator, PageViewer, lead, render
from casebase.axes import find_axis, list_axes
from casebase.diagnoses import revise_diagnosis
from casebase.search.axis_cases import Taken, gearboxes_known, newest_recordings
from casebase.steps import newest_of, step_name

router = APIRouter()
SECTION = "/axes"
SHOWN = 8
USUAL = 20
"""Simulated cases of each label, as on the page that simulates cases."""


@router.get("/first-hour")
def begin(request: Request, session: Reading, _: PageViewer) -> Response:
    """Which axis: a described one, a new one, or a copy of one."""
    context = {"axes": [row.name for row in list_axes(session)], "templates": TEMPLATES}
    return render(request, "begin.html", context, section=SECTION)


@router.get("/axes/{name}/first-hour")
def first_hour(
    request: Request,
    session: Reading,
    service: TheService,
    jobs: TheJobs,
    _: PageViewer,
    name: str,
    recorded: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """The steps, which are done, the one next thing to do, and what each step came to."""
    check_known(session, name)
    axis, cases = find_axis(session, name), axis_cases(service, session).get(name, {})
    known = any(each.measured or each.simulated for each in cases.values())
    found = service.evaluation_of_axis(session, name) if known else None
    evaluation = None if isinstance(found, Pending) else found
    taken, job = newest_recordings(session, name, SHOWN), jobs.newest_of_axis(GENERATION, name)
    gearboxes = service.counted(session, "gearboxes", lambda: gearboxes_known(session))
    hour = Hour(axis, cases, taken, job, evaluation, gearboxes)
    context = {
        "hour": hour,
        "name": name,
        "waiting": found if isinstance(found, Pending) else None,
        "recordings": [(one, checked(one), said(one)) for one in hour.taken],
        "choices": forms.choices(label for label, _ in service.counts(session)),
        "usual": USUAL,
        "most": forms.MOST_AT_ONCE,
        "step": told_step(session, forms.number_of(request, "step")),
    }
    newest = next((one for one in hour.taken if one.diagnosis and one.diagnosis.id == recorded), None)
    messages = (message(newest),) if newest else ()
    return render(request, "first_hour.html", context, section=SECTION, messages=messages)


def checked(taken: Taken) -> tuple[Flag, ...]:
    """Return what weakens a recording: no notes, which change nothing."""
    stored = [flag for flag in taken.recording.quality if isinstance(flag, Mapping)]
    found = flags_of(stored, taken.recording.duration_s)
    return tuple(flag for flag in found if flag.severity != "note")


def said(taken: Taken) -> str:
    """Say in a few words what the library answers of a recording."""
    return verdict_of(taken.diagnosis.document).headline if taken.diagnosis else "Not diagnosed yet"


def message(taken: Taken) -> Message:
    """Say what the check found in a recording that was just sent."""
    poor = ", ".join(flag.name for flag in checked(taken))
    if not taken.recording.usable:
        return Message(f"The recording cannot be used ({poor}), so it is no case of the library.", "bad")
    if poor:
        return Message(f"{taken.recording.file_name} is disturbed: {poor}. What to avoid stands below.", "warn")
    return Message(f"{taken.recording.file_name} is a good recording. The library's answer: {said(taken)}.")


@router.post("/axes/{name}/first-hour/recordings")
def record(principal: PageOperator, upload: forms.OurUpload, service: TheService, name: str) -> Response:
    """Take a recording of the axis in and diagnose it; keep it as a case where it is said what the gearbox has."""
    upload.only("file", "csrf", "recorded_at", "label", "verification", *forms.SAID)
    label = upload.fields.get("label", "")
    verification = upload.fields.get("verification") or None
    with service.library.reading() as session:
        check_known(session, name)
    if label:
        forms.may_keep(principal)
        forms.said_how(verification)
        label = forms.label_of(service, upload)
    fields = {**forms.told(upload.fields, "recorded_at"), "axis": name}
    intake, _ = forms.taken_in(service, upload, fields, RecordingMetadata)
    intake, step = intake.fitted(service.library), step_name()
    with service.library.transaction(principal.actor, step) as session:
        diagnosis = intake.diagnose(service.library, session)
        identity, verdict = diagnosis.id, diagnosis.verdict
        if label and verdict != "unusable":
            as_said = "confirmed" if diagnosis.label == label else "corrected"
            revise_diagnosis(session, identity, as_said, label=label, verification=verification)
            service.library.retain.diagnosis(session, identity)
        session.flush()
        taken = newest_of(session, step)
    service.metrics.diagnoses.labels(verdict, diagnosis.label or "").inc()
    return _to_page(service, name, f"?recorded={identity}{f'&step={taken}' if taken else ''}")


@router.post("/axes/{name}/first-hour/simulations", dependencies=[FromOurPage])
def simulate(
    service: TheService,
    jobs: TheJobs,
    principal: PageAdmin,
    name: str,
    per_label: Annotated[int, Form(ge=1, le=forms.MOST_AT_ONCE)],
) -> Response:
    """Have the cases of the axis simulated, as many of each label."""
    with service.library.reading() as session:
        check_known(session, name)
        offered = [label for label, why in obstacles(find_axis(session, name)).items() if why is None]
    if not offered:
        raise Unprocessable(f"The axis {name!r} lacks what a simulation needs: see its first step.")
    wanted = SimulationRequest(axis=name, counts=dict.fromkeys(offered, per_label))
    jobs.submit(GENERATION, campaign_of(service, wanted).to_document(), submitted_by=principal.actor)
    return _to_page(service, name, "#simulate")


def _to_page(service: Service, name: str, rest: str) -> Response:
    return lead(service, f"/axes/{quote(name, safe='')}/first-hour{rest}")
