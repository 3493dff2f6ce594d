"""Diagnoses: a recording comes in, a verdict with its nearest cases goes out, a person confirms or corrects it."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response, status
from sqlalchemy.orm import Session

from app.documents import (
    Cursor,
    DiagnosisAnswer,
    DiagnosisChange,
    Filter,
    Identifier,
    Limit,
    PageFound,
    page_found,
    page_of,
)
from app.http.concurrency_limiter import ReadingLimit
from app.http.headers import chosen
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Operator, Viewer
from app.http.uploads import TheUpload, multipart_body
from app.recordings.intake import take_in
from app.recordings.metadata import RecordingMetadata, read_metadata
from app.report.diagnosis_view import diagnosis_html
from app.report.self_contained import self_contained
from app.service import Reading, TheService
from casebase.diagnoses import DiagnosisFilter, get_diagnosis, list_diagnoses, revise_diagnosis

router = APIRouter(tags=["diagnoses"])
VerdictFilter = Annotated[
    Literal["diagnosed", "ambiguous", "not_in_library", "unusable"] | None, Query(description="only with this verdict")
]
RevisionFilter = Annotated[
    Literal["open", "confirmed", "corrected", "rejected"] | None,
    Query(description="only those of which a person said this; open: nobody has said anything"),
]
HTML, JSON = "text/html", "application/json"


@router.post(
    "/diagnoses",
    status_code=status.HTTP_201_CREATED,
    response_model=DiagnosisAnswer,
    openapi_extra=multipart_body(RecordingMetadata),
)
def diagnose(_: Operator, upload: TheUpload, once: OnlyOnce, request: Request) -> Response:
    """Diagnose a recording: part `file` with the sound, part `metadata` (JSON) with what is known of it."""
    file, service = upload.file("file"), once.service
    upload.only("file", "metadata")
    metadata = read_metadata(upload.text("metadata", service.settings.metadata_bytes), RecordingMetadata)
    content = (file.sha256, metadata.description())
    kept = once.replay(*content)
    if kept is not None:
        return kept
    intake = take_in(service.library, file.path, file.name, file.media_type, metadata)

    def work(session: Session) -> Made:
        diagnosis = intake.diagnose(service.library, session)
        service.metrics.diagnoses.labels(diagnosis.verdict, diagnosis.label or "").inc()
        location = str(request.url_for("diagnosis", diagnosis_id=diagnosis.id).path)
        return Made(DiagnosisAnswer.of(diagnosis), location)

    return once.run(work, *content)


@router.get("/diagnoses")
def diagnoses(
    _: Viewer,
    session: Reading,
    verdict: VerdictFilter = None,
    label: Filter = None,
    state: RevisionFilter = None,
    axis: Filter = None,
    gearbox: Filter = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> PageFound[DiagnosisAnswer]:
    """Diagnoses, newest first."""
    wanted = DiagnosisFilter(verdict=verdict, label=label, state=state, axis=axis, gearbox=gearbox)
    page = page_of(list_diagnoses(session, wanted, limit=limit, cursor=cursor), DiagnosisAnswer.of)
    return page_found(session, axis, page)


@router.get("/diagnoses/{diagnosis_id}")
def diagnosis(_: Viewer, session: Reading, diagnosis_id: Identifier) -> DiagnosisAnswer:
    """One diagnosis as it was given, and what became of it."""
    return DiagnosisAnswer.of(get_diagnosis(session, diagnosis_id))


@router.get(
    "/diagnoses/{diagnosis_id}/report",
    response_model=DiagnosisAnswer,
    responses={200: {"content": {HTML: {}}}},
    dependencies=[ReadingLimit],
)
def report(_: Viewer, session: Reading, service: TheService, diagnosis_id: Identifier, request: Request) -> Response:
    """The diagnosis to read and to file: one HTML page that works offline, or JSON, by `Accept`."""
    row = get_diagnosis(session, diagnosis_id)
    answer = DiagnosisAnswer.of(row)
    if chosen(request.headers.get("accept"), (HTML, JSON)) == JSON:
        return Response(answer.model_dump_json(), media_type=JSON, headers={"Vary": "Accept"})
    page = diagnosis_html(session, service, row)
    return self_contained(page, Vary="Accept")


@router.patch("/diagnoses/{diagnosis_id}")
def revise(
    operator: Operator, service: TheService, request: Request, diagnosis_id: Identifier, change: DiagnosisChange
) -> DiagnosisAnswer:
    """Say what a person found: confirmed, corrected (with the right label) or rejected."""
    with service.library.transaction(operator.actor, request.scope["request_id"]) as session:
        row = revise_diagnosis(
            session,
            diagnosis_id,
            change.verdict,
            label=change.label,
            verified_by=change.verified_by,
            verification=change.verification,
            note=change.note,
        )
        return DiagnosisAnswer.of(row)
