"""Diagnoses: a recording comes in, a verdict with its nearest cases goes out, a person confirms or corrects it.

The queue has those that need a person, where an answer teaches the library most first. A retrieval stores nothing.
"""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response, status
from pydantic import BaseModel, Field
from sqlalchemy import select
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
from app.http.errors import Unprocessable
from app.http.headers import chosen, location, self_contained
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Operator, ReadingLimit, Viewer
from app.http.uploads import TheUpload, multipart_body
from app.recordings.intake import RecordingMetadata, decoded, hear, read_metadata, take_in
from app.recordings.neighbours import NeighbourQuery, RetrievalAnswer, neighbours_of, neighbours_of_stored
from app.report.diagnosis_view import diagnosis_html
from app.service import Reading, TheService
from casebase.diagnoses import DiagnosisFilter, get_diagnosis, list_diagnoses, revise_diagnosis
from casebase.errors import ConflictError
from casebase.queue import reason_of, waiting
from casebase.store.models import StoredDiagnosis

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
    """Diagnose a recording: part `file` with the sound, part `metadata` (JSON) with what is known of it.

    A part `telemetry` beside it, with `channels` where its columns are not told by their names and units, says the
    motion: its angle is measured, so it wins over what the metadata say.
    """
    file, service = upload.file("file"), once.service
    metadata, log, content = upload.recording(RecordingMetadata, service.settings.metadata_bytes)
    kept = once.replay(*content)
    if kept is not None:
        return kept
    intake = take_in(service.library, file.path, file.name, file.media_type, metadata, log=log).fitted(service.library)

    def work(session: Session) -> Made:
        diagnosis = intake.diagnose(service.library, session)
        service.metrics.diagnoses.labels(diagnosis.verdict, diagnosis.label or "").inc()
        return Made(DiagnosisAnswer.of(diagnosis), location(request, "diagnosis", diagnosis_id=diagnosis.id))

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


class WaitingAnswer(BaseModel):
    """A diagnosis that needs a person."""

    place: int = Field(ge=1, description="in the queue, from 1")
    reason: Literal["not_in_library", "ambiguous", "fault"] = Field(
        description="unlike every known kind, not decided, or a likely fault that nobody has confirmed"
    )
    diagnosis: DiagnosisAnswer


class QueueAnswer(BaseModel):
    """A page of the queue. What is answered leaves it."""

    count: int = Field(ge=0, description="how many need a person")
    items: list[WaitingAnswer]
    next_cursor: str | None


@router.get("/queue")
def queue(_: Viewer, service: TheService, session: Reading, limit: Limit = 50, cursor: Cursor = None) -> QueueAnswer:
    """The diagnoses that need a person: `PATCH /diagnoses/{id}` answers one, and it is gone from here.

    First stands where the library knows least. An answer may change the order of the others, so whoever answers while
    reading asks for the first page again.
    """
    ids = list(waiting(session, service.fleet.naming(session)))
    if cursor is not None and cursor not in ids:
        raise ConflictError("the diagnosis of this cursor does not wait any more: ask again without a cursor")
    first = 0 if cursor is None else ids.index(cursor) + 1
    wanted = ids[first : first + limit]
    rows = {row.id: row for row in session.scalars(select(StoredDiagnosis).where(StoredDiagnosis.id.in_(wanted)))}
    items = [
        WaitingAnswer(place=place, reason=reason_of(rows[each].verdict), diagnosis=DiagnosisAnswer.of(rows[each]))
        for place, each in enumerate(wanted, start=first + 1)
    ]
    return QueueAnswer(count=len(ids), items=items, next_cursor=wanted[-1] if first + limit < len(ids) else None)


@router.post("/retrievals", openapi_extra=multipart_body(RecordingMetadata, query=NeighbourQuery))
def retrieve(_: Viewer, upload: TheUpload, service: TheService) -> RetrievalAnswer:
    """Find the nearest cases of a recording, and why they are near. Nothing is stored.

    Part `file` with the sound and part `metadata` (JSON) with what is known of it, as for a diagnosis; or
    `recording_id` or `case_id` in the part `query` for what is stored already, and then without the
    cases of the same sound.
    """
    upload.only("file", "metadata", "query")
    limit = service.settings.metadata_bytes
    query: NeighbourQuery = read_metadata(upload.text("query", limit), NeighbourQuery, "query")
    sent = {"file", "metadata"} & {*upload.files, *upload.fields}
    if query.recording_id or query.case_id:
        if sent:
            raise Unprocessable(f"The query names what is stored, so leave out {' and '.join(sorted(sent))}.")
        return neighbours_of_stored(service.library, query)
    if "file" not in upload.files:
        raise Unprocessable(
            "There is no recording: send one in the part 'file', or name a `recording_id` or `case_id` in the part "
            "'query'."
        )
    file = upload.file("file")
    metadata = read_metadata(upload.text("metadata", limit), RecordingMetadata)
    recording = decoded(file.path, metadata)
    heard = hear(service.library, recording, file.name, file.media_type, metadata)
    return neighbours_of(service.library, heard, query)
