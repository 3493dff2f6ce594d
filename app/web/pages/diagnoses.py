"""Diagnoses: the list, a new one, one of them, what a person says of it, its report."""

import json
from shlex import quote
from typing import Annotated, Literal

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import RedirectResponse, Response
from sqlalchemy import select

from app.errors import Unprocessable
from app.gate import Looking
from app.intake import take_in
from app.investigations import investigations_from
from app.metadata import RecordingMetadata, read_metadata
from app.security import Principal, check_csrf
from app.service import Reading, Service, TheService
from app.uploads import TheUpload
from app.web.counted import counts_of
from app.web.diagnosis_view import view_of
from app.web.pages.recordings import demo_ids
from app.web.report import diagnosis_html, diagnosis_pdf
from app.web.session import FromOurPage, PageAdmin, PageOperator, PageViewer, SignInNeeded, Visitor, below_root
from app.web.templating import Message, render
from app.web.words import VERDICTS, how_sure, investigation_headline
from casebase.axes import find_axis
from casebase.diagnoses import DiagnosisFilter, get_diagnosis, list_diagnoses, revise_diagnosis
from casebase.models import Case, StoredDiagnosis

router = APIRouter()
FILTERS = (("", "All"), *VERDICTS.items())
LONGEST_VERIFICATION = 500
NUMBERS = {"speed_rad_s": "The largest speed of the output [rad/s]", "payload_kg_m2": "The payload [kg m²]"}


def root_of(service: Service) -> str:
    """Return the path under which a proxy serves us, without a slash at its end."""
    return service.settings.root_path.rstrip("/")


@router.get("/")
def front(request: Request, session: Reading, service: TheService, principal: Visitor) -> Response:
    """The demonstration for whoever is new, the fleet for whoever is signed in and has heard something."""
    demo = demo_ids(session)
    others = list_diagnoses(session, DiagnosisFilter(), limit=2).items
    new_here = demo is not None and all(row.id == demo[0] for row in others)
    if demo is not None and (principal is None or new_here):
        return shown(request, session, service, principal, get_diagnosis(session, demo[0]), demo=True)
    if principal is None:
        raise SignInNeeded("/")
    return RedirectResponse(f"{root_of(service)}/fleet", status_code=303)


@router.get("/diagnoses")
def listed(
    request: Request,
    session: Reading,
    principal: PageViewer,
    verdict: Literal["", "diagnosed", "ambiguous", "not_in_library", "unusable"] = "",
    cursor: str | None = None,
) -> Response:
    """The list, newest first."""
    page = list_diagnoses(session, DiagnosisFilter(verdict=verdict or None), cursor=cursor)
    context: dict[str, object] = {"rows": page.items, "next_cursor": page.next_cursor, "filters": FILTERS}
    context |= {"chosen": verdict, "verdicts": VERDICTS, "how_sure": how_sure}
    return render(request, "diagnoses.html", context, principal=principal, section="/diagnoses")


@router.get("/diagnoses/new")
def upload_page(request: Request, principal: PageOperator) -> Response:
    """The form for those who do not drop."""
    context = {"base_url": str(request.base_url).rstrip("/")}
    return render(request, "upload.html", context, principal=principal, section="/diagnoses")


@router.post("/diagnoses/new")
def upload(request: Request, principal: PageOperator, upload: TheUpload, service: TheService) -> Response:
    """Take a recording in and diagnose it."""
    check_csrf(request, upload.fields.get("csrf", ""))
    upload.only("file", "csrf", "axis", "gearbox", "recorded_at", *NUMBERS)
    metadata = read_metadata(json.dumps(told(upload.fields, "recorded_at")), RecordingMetadata)
    file = upload.file("file")
    intake = take_in(service.library, file.path, file.name, file.media_type, metadata)
    with service.library.transaction(principal.actor) as session:
        diagnosis = intake.diagnose(service.library, session)
        identity = diagnosis.id
    service.metrics.diagnoses.labels(diagnosis.verdict, diagnosis.label or "").inc()
    return RedirectResponse(f"{root_of(service)}/diagnoses/{identity}", status_code=303)


def told(fields: dict[str, str], *words: str) -> dict[str, object]:
    """Return what the form says, without what was left empty; numbers may have a decimal comma."""
    found: dict[str, object] = {}
    for name in ("axis", "gearbox", *words):
        if text := fields.get(name, "").strip():
            found[name] = text
    for name, label in NUMBERS.items():
        if text := fields.get(name, "").strip():
            found[name] = _number(label, text)
    return found


def _number(label: str, text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise Unprocessable(
            f"{label} must be a number such as 2.5, got {text!r}. Leave it empty if it is not known."
        ) from None


@router.get("/diagnoses/{diagnosis_id}", dependencies=[Looking])
def one(
    request: Request,
    session: Reading,
    service: TheService,
    principal: Visitor,
    diagnosis_id: str,
    axis: Literal["hz", "orders"] = "hz",
    overlay: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """One diagnosis with all that speaks for it."""
    demo = demo_ids(session)
    is_demo = demo is not None and demo[0] == diagnosis_id
    if principal is None and (overlay or not is_demo):
        raise SignInNeeded(below_root(request))
    row = get_diagnosis(session, diagnosis_id)
    return shown(request, session, service, principal, row, demo=is_demo, orders=axis == "orders", overlay=overlay)


def shown(
    request: Request,
    session: Reading,
    service: Service,
    principal: Principal | None,
    row: StoredDiagnosis,
    *,
    demo: bool = False,
    orders: bool = False,
    overlay: str = "",
) -> Response:
    """Return the page of a diagnosis, a case laid over its plots if asked for."""
    case = service.library.retrieve.case(session, overlay) if overlay else None
    metadata = {
        name: getattr(row.recording, name)
        for name in ("axis", "gearbox", "speed_rad_s", "payload_kg_m2")
        if getattr(row.recording, name) is not None
    }
    base = str(request.base_url).rstrip("/")
    curl = (
        'curl -H "Authorization: Bearer $GEARCASE_KEY" \\\n'
        f"  -F {file_argument(row.recording.file_name)} \\\n"
        f"  -F {quote(f'metadata={json.dumps(metadata)}')} \\\n"
        f"  {base}/api/v1/diagnoses\n\n"
        f'curl -H "Authorization: Bearer $GEARCASE_KEY" {base}/api/v1/diagnoses/{row.id}'
    )
    context = view_of(session, service, row, orders=orders, overlay=case).context()
    labels = sorted({label for label, _ in counts_of(service.library, session)})
    context |= {"demo": demo, "orders": orders, "curl": curl, "labels": labels, "overlay": case}
    context["kept"] = session.scalars(select(Case).where(Case.diagnosis_id == row.id).order_by(Case.id)).all()
    context["investigations"] = [
        (each, investigation_headline(each.document) if each.document else each.error or each.state)
        for each in investigations_from(session, row.id)
    ]
    context["described"] = row.recording.axis is None or find_axis(session, row.recording.axis) is not None
    notices = (Message("Your verdict is saved.", ""),) if request.query_params.get("done") else ()
    return render(request, "diagnosis.html", context, principal=principal, section="/diagnoses", messages=notices)


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
    label: Annotated[str, Form()] = "",
    verified_by: Annotated[str, Form()] = "",
) -> Response:
    """Confirm, correct, reject, or take that back."""
    with service.library.transaction(principal.actor) as session:
        right = label.strip() if verdict == "corrected" else None
        if len(verified_by) > LONGEST_VERIFICATION:
            raise Unprocessable(
                f"How it was verified may have {LONGEST_VERIFICATION} characters, not {len(verified_by)}."
            )
        revise_diagnosis(session, diagnosis_id, verdict, label=right or None, verified_by=verified_by.strip() or None)
    return RedirectResponse(f"{root_of(service)}/diagnoses/{diagnosis_id}?done=1#revise", status_code=303)


@router.post("/diagnoses/{diagnosis_id}/retain", dependencies=[FromOurPage])
def retain(service: TheService, principal: PageAdmin, diagnosis_id: str) -> Response:
    """Make a case of it."""
    with service.library.transaction(principal.actor) as session:
        case_id = service.library.retain.diagnosis(session, diagnosis_id).id
    return RedirectResponse(f"{root_of(service)}/cases/{case_id}", status_code=303)


@router.get("/diagnoses/{diagnosis_id}/report.html", dependencies=[Looking])
def report_html(session: Reading, service: TheService, _: PageViewer, diagnosis_id: str) -> Response:
    """One file that needs no network."""
    page = diagnosis_html(view_of(session, service, get_diagnosis(session, diagnosis_id)), service.settings.time_zone)
    return _download(page.encode(), "text/html; charset=utf-8", f"diagnosis-{diagnosis_id}.html")


@router.get("/diagnoses/{diagnosis_id}/report.pdf", dependencies=[Looking])
def report_pdf(session: Reading, service: TheService, _: PageViewer, diagnosis_id: str) -> Response:
    """The same on paper."""
    pages = diagnosis_pdf(view_of(session, service, get_diagnosis(session, diagnosis_id)), service.settings.time_zone)
    return _download(pages, "application/pdf", f"diagnosis-{diagnosis_id}.pdf")


def _download(content: bytes, media_type: str, name: str) -> Response:
    return Response(content, media_type=media_type, headers={"Content-Disposition": f'attachment; filename="{name}"'})
