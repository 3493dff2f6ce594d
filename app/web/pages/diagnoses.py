"""Diagnoses: the list, a new one, one of them, what a person says of it; which are to be checked; steps taken back."""

import json
from collections import Counter
from shlex import quote
from typing import Annotated, Literal

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from sqlalchemy import select

from app.api.steps import told as told_step
from app.http.errors import Forbidden, Unprocessable
from app.http.headers import self_contained
from app.http.security import ReadingLimit, Role, known
from app.investigations import investigations_from
from app.recordings.intake import RecordingMetadata
from app.report.diagnosis_view import diagnosis_html, view_of
from app.report.standing_words import named_words
from app.report.words import how_sure, investigation_headline, verdict_of, verdict_word
from app.service import Reading, Service, TheService
from app.web import forms
from app.web.page import (
    RECORDED,
    ROWS,
    FromOurPage,
    Message,
    PageAdmin,
    PageOperator,
    PageViewer,
    SignInNeeded,
    Visitor,
    below_root,
    demo_ids,
    lead,
    listing,
    render,
)
from casebase.axes import find_axis
from casebase.cycle.retain import is_undone
from casebase.diagnoses import DiagnosisFilter, diagnoses_of, get_diagnosis, list_diagnoses, revise_diagnosis
from casebase.errors import NotFoundError
from casebase.queue import place_in, proposed, waiting
from casebase.steps import last_step, newest_of, step_name, undo
from casebase.store.models import Case, StoredDiagnosis, StoredRecording

router = APIRouter()
LONGEST_VERIFICATION = 500


@router.get("/")
def front(request: Request, session: Reading, service: TheService, principal: Visitor) -> Response:
    """The demonstration for whoever is new, the fleet for whoever is signed in and has heard something."""
    demo = demo_ids(session)
    others = list_diagnoses(session, DiagnosisFilter(), limit=2).items
    new_here = demo is not None and all(row.id == demo[0] for row in others)
    if demo is not None and (principal is None or new_here):
        return shown(request, session, service, get_diagnosis(session, demo[0]), demo=True)
    if principal is None:
        raise SignInNeeded("/")
    return lead(service, "/fleet")


@router.get("/diagnoses")
def listed(
    request: Request,
    session: Reading,
    _: PageViewer,
    verdict: Literal["", "diagnosed", "ambiguous", "not_in_library", "unusable"] = "",
) -> Response:
    """The list, newest first."""
    wanted = diagnoses_of(DiagnosisFilter(verdict=verdict or None))
    columns = {**RECORDED, "label": StoredDiagnosis.label, "review": StoredDiagnosis.state}
    found = listing(request, session, wanted, **columns)
    context = {"list": found, "word": verdict_word, "how_sure": how_sure}
    return render(request, "diagnoses.html", context, section="/diagnoses")


@router.get("/diagnoses/new")
def upload_page(request: Request, session: Reading, service: TheService, _: PageOperator) -> Response:
    """The form for those who do not drop, and the table of many recordings."""
    return render(request, "upload.html", forms.import_choices(service, session), section="/diagnoses")


@router.post("/diagnoses/new")
def upload(principal: PageOperator, upload: forms.OurUpload, service: TheService) -> Response:
    """Take a recording in and diagnose it."""
    upload.only("file", "csrf", "recorded_at", *forms.SAID)
    intake, _ = forms.taken_in(service, upload, forms.told(upload.fields, "recorded_at"), RecordingMetadata)
    intake = intake.fitted(service.library)
    with service.library.transaction(principal.actor) as session:
        diagnosis = intake.diagnose(service.library, session)
        identity = diagnosis.id
    service.metrics.diagnoses.labels(diagnosis.verdict, diagnosis.label or "").inc()
    return lead(service, f"/diagnoses/{identity}")


@router.get("/diagnoses/{diagnosis_id}", dependencies=[ReadingLimit])
def one(
    request: Request,
    session: Reading,
    service: TheService,
    principal: Visitor,
    diagnosis_id: str,
    axis: Literal["hz", "orders"] = "hz",
) -> Response:
    """One diagnosis with all that speaks for it."""
    demo = demo_ids(session)
    is_demo = demo is not None and demo[0] == diagnosis_id
    if principal is None and not is_demo:
        raise SignInNeeded(below_root(request))
    row = get_diagnosis(session, diagnosis_id)
    return shown(request, session, service, row, demo=is_demo, orders=axis == "orders")


def shown(
    request: Request,
    session: Reading,
    service: Service,
    row: StoredDiagnosis,
    *,
    demo: bool = False,
    orders: bool = False,
) -> Response:
    """Return the page of a diagnosis."""
    told = {name: getattr(row.recording, name) for name in ("axis", "gearbox", "speed_rad_s", "payload_kg_m2")}
    metadata = {name: value for name, value in told.items() if value is not None}
    base = str(request.base_url).rstrip("/")
    curl = (
        'curl -H "Authorization: Bearer $GEARCASE_KEY" \\\n'
        f"  -F {file_argument(row.recording.file_name)} \\\n"
        f"  -F {quote(f'metadata={json.dumps(metadata)}')} \\\n"
        f"  {base}/api/v1/diagnoses\n\n"
        f'curl -H "Authorization: Bearer $GEARCASE_KEY" {base}/api/v1/diagnoses/{row.id}'
    )
    context = view_of(session, service, row, orders=orders)
    labels = forms.choices(label for label, _ in service.counts(session))
    context |= {"demo": demo, "orders": orders, "curl": curl, "labels": labels}
    kept = session.scalars(select(Case).where(Case.diagnosis_id == row.id).order_by(Case.id)).all()
    context["kept"] = [case for case in kept if not is_undone(session, case)]
    before = StoredRecording.sound_id == row.recording.sound_id, StoredDiagnosis.id < row.id
    context["same"] = session.scalar(select(StoredDiagnosis).join(StoredRecording).where(*before).limit(1))
    context["investigations"] = [
        (each, investigation_headline(each.document) if each.document else each.error or each.state)
        for each in investigations_from(session, row.id)
    ]
    context["described"] = row.recording.axis is None or find_axis(session, row.recording.axis) is not None
    subjects = [("diagnosis", row.id), *(("case", case.id) for case in kept)]
    principal = known(request)
    step = told_step(session, forms.number_of(request, "step")) if principal else None
    here = step is not None and step.path == f"/diagnoses/{row.id}"
    queued = principal is not None and bool(request.query_params.get("queue"))
    naming = service.fleet.naming(session) if queued else {}
    context |= {
        "last": last_step(session, subjects),
        "step": None if here else step,
        "place": place_in(list(waiting(session, naming, faults_first=True)), row.id) if queued else None,
    }
    notices = (Message(step.words),) if step is not None and here else ()
    return render(request, "diagnosis.html", context, section="/diagnoses", messages=notices)


def file_argument(name: str) -> str:
    """Return what tells curl to send a file, whatever its name, as it stands in a shell.

    >>> print(file_argument("axis 4, monday.wav"))
    'file=@"axis 4, monday.wav"'
    """
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return quote(f'file=@"{escaped}"')


@router.post("/diagnoses/{diagnosis_id}/revise", dependencies=[FromOurPage])
def revise(
    service: TheService,
    principal: PageOperator,
    diagnosis_id: str,
    verdict: Annotated[str, Form()],
    label: forms.LabelGiven,
    verified_by: Annotated[str, Form()] = "",
    verification: Annotated[forms.Verified, Form()] = "",
    keep: Annotated[str, Form()] = "",
    queue: Annotated[str, Form()] = "",
) -> Response:
    """Confirm, correct or reject, and keep it as a case if wanted; whoever came from the queue goes on to the next."""
    if len(verified_by) > LONGEST_VERIFICATION:
        raise Unprocessable(f"How it was verified may have {LONGEST_VERIFICATION} characters, not {len(verified_by)}.")
    verdict, _, named = verdict.partition(" ")  # the button of a label of which it is undecided names it
    keeping = bool(keep) and verdict in ("confirmed", "corrected")
    if keeping:
        forms.may_keep(principal)
        forms.said_how(verification)
    right = (named or label()) if verdict == "corrected" else None
    name = step_name()
    place = place_in(queue_of(service), diagnosis_id) if queue else None
    with service.library.transaction(principal.actor, name) as session:
        revise_diagnosis(
            session,
            diagnosis_id,
            verdict,
            label=right,
            verified_by=verified_by.strip() or None,
            verification=verification or None,
        )
        if keeping:
            service.library.retain.diagnosis(session, diagnosis_id)
        session.flush()
        step = newest_of(session, name)
    if place is None:
        return lead(service, f"/diagnoses/{diagnosis_id}?step={step}")
    left = queue_of(service)
    after = place.after if place.after in left else next(iter(left), None)
    return lead(service, f"/diagnoses/{after}?queue=1&step={step}" if after else f"/queue?step={step}")


def queue_of(service: Service) -> list[str]:
    """Return the ids of the diagnoses that need a person, likely faults first."""
    with service.library.reading() as session:
        return list(waiting(session, service.fleet.naming(session), faults_first=True))


@router.post("/diagnoses/{diagnosis_id}/retain", dependencies=[FromOurPage])
def retain(
    service: TheService, principal: PageAdmin, diagnosis_id: str, verification: Annotated[forms.Verified, Form()] = ""
) -> Response:
    """Make a case of it."""
    with service.library.transaction(principal.actor, step_name()) as session:
        forms.said_how(verification or get_diagnosis(session, diagnosis_id).verification)
        case = service.library.retain.diagnosis(session, diagnosis_id, verification=verification or None)
    return lead(service, f"/cases/{case.id}?kept=1")


@router.get("/diagnoses/{diagnosis_id}/report.html", dependencies=[ReadingLimit])
def report_html(session: Reading, service: TheService, _: PageViewer, diagnosis_id: str) -> Response:
    """One file that needs no network."""
    page = diagnosis_html(session, service, get_diagnosis(session, diagnosis_id))
    disposition = f'attachment; filename="diagnosis-{diagnosis_id}.html"'
    return self_contained(page, **{"Content-Disposition": disposition})


@router.get("/queue")
def queue(request: Request, service: TheService, session: Reading, _: PageViewer) -> Response:
    """The diagnoses that need a person: likely faults, then what is undecided, then what is unknown."""
    naming = service.fleet.naming(session)
    found = waiting(session, naming, faults_first=True)
    shown = list(found)[:ROWS]
    given = session.scalars(select(StoredDiagnosis).where(StoredDiagnosis.id.in_(shown)))
    rows = sorted(given, key=lambda row: shown.index(row.id))
    answers = [verdict_of(row.document) for row in rows]
    context: dict[str, object] = {
        "kinds": Counter(each.headline.partition(":")[0] for each in answers),
        "rows": [(row, each, naming.get(row.recording_id)) for row, each in zip(rows, answers, strict=True)],
        "named_words": lambda fault: named_words(fault, service.settings.time_zone),
        "count": len(found),
        "proposed": proposed(session),
        "step": told_step(session, forms.number_of(request, "step")),
        "how_sure": how_sure,
    }
    return render(request, "queue.html", context, section="/diagnoses")


@router.post("/steps/undo", dependencies=[FromOurPage])
def take_back(
    service: TheService,
    principal: PageOperator,
    step: Annotated[int, Form(ge=1, le=forms.LARGEST_NUMBER)],
    queue: Annotated[str, Form()] = "",
) -> Response:
    """Take a step back and show what it was about."""
    with service.library.transaction(principal.actor) as session:
        what = told_step(session, step)
        if what is None:
            raise NotFoundError("this step was taken back already, or never was")
        if what.by_admin and not principal.role.may(Role.ADMIN):
            raise Forbidden(f"Cases are changed by admins; you are signed in with the role {principal.role}.")
        undo(session, step)
    shown = "undone=1&queue=1" if queue and what.path.startswith("/diagnoses/") else "undone=1"
    return lead(service, f"{what.path}?{shown}")
