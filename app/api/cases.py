"""Cases: what the library knows; added, changed and retired by admins; and how well it does as a whole."""

from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, Field, ValidationError
from sqlalchemy.orm import Session

from app.documents import (
    AuditAnswer,
    CaseAnswer,
    CaseChange,
    CaseFromDiagnosis,
    Cursor,
    EvaluationAnswer,
    Filter,
    Identifier,
    Limit,
    OriginFilter,
    PageFound,
    PageOf,
    page_found,
    page_of,
)
from app.http.errors import IfMatchRequired, Stale, validation_problem
from app.http.headers import IfNoneMatch, has_already, location, not_modified
from app.http.idempotency import Made, Once, OnlyOnce
from app.http.security import Admin, Viewer
from app.http.uploads import MaybeUpload, Upload, multipart_body
from app.recordings.intake import CaseMetadata, take_in
from app.service import Reading, Service, TheService
from casebase.review import Competence, Finding, Hole, review
from casebase.search.case_filter import CaseFilter
from casebase.store.counter import library_version
from casebase.store.fields import Verified
from casebase.store.models import Case
from signals.reading.text import text_of

router = APIRouter(tags=["cases"])
StateFilter = Annotated[
    Literal["proposed", "confirmed", "retired"] | None,
    Query(description="only in this state; all but retired if left out"),
]
VerifiedFilter = Annotated[Verified | None, Query(description="only those verified in this way")]
IfMatch = Annotated[str | None, Header(max_length=100, description="the ETag that the change is based on")]


@router.get("/cases")
def list_cases(
    _: Viewer,
    session: Reading,
    service: TheService,
    label: Filter = None,
    origin: OriginFilter = None,
    axis: Filter = None,
    gearbox: Filter = None,
    state: StateFilter = None,
    verification: VerifiedFilter = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> PageFound[CaseAnswer]:
    """Cases, newest first; retired ones only with `state=retired`."""
    wanted = CaseFilter(label=label, origin=origin, axis=axis, gearbox=gearbox, state=state, verification=verification)
    page = service.library.retrieve.cases(session, wanted, limit=limit, cursor=cursor)
    return page_found(session, axis, page_of(page, CaseAnswer.model_validate))


@router.post(
    "/cases",
    status_code=status.HTTP_201_CREATED,
    response_model=CaseAnswer,
    responses={200: {"model": CaseAnswer, "description": "the case that is there already"}},
    openapi_extra=multipart_body(CaseMetadata, CaseFromDiagnosis),
)
async def add_case(_: Admin, upload: MaybeUpload, once: OnlyOnce, request: Request) -> Response:
    """Add a labelled recording (multipart), or make a case of a diagnosis (JSON).

    The same bytes with the same description are one recording. The same sound, whatever its container, rate or gain, is
    one case: with the same label and gearbox it is answered as it is there (200), with another one refused (409).
    """
    if upload is None:
        body = await request.body()
        return await run_in_threadpool(_from_diagnosis, once, request, body)
    return await run_in_threadpool(_from_recording, once, request, upload)


def _from_recording(once: Once, request: Request, upload: Upload) -> Response:
    file, service = upload.file("file"), once.service
    metadata, log, content = upload.recording(CaseMetadata, service.settings.metadata_bytes)
    kept = once.replay(*content)
    if kept is not None:
        return kept
    intake = take_in(service.library, file.path, file.name, file.media_type, metadata, log=log)
    labelling = metadata.labelling()

    def work(session: Session) -> Made:
        before = library_version(session)
        row = intake.store(service.library, session)
        return _made(request, service.library.retain.case(session, row, labelling), before)

    return once.run(work, *content)


def _from_diagnosis(once: Once, request: Request, body: bytes) -> Response:
    try:
        asked = CaseFromDiagnosis.model_validate_json(text_of(body))
    except ValidationError as error:
        raise validation_problem(error.errors(include_url=False), "The body") from None
    library = once.service.library

    def work(session: Session) -> Made:
        before = library_version(session)
        case = library.retain.diagnosis(
            session,
            asked.diagnosis_id,
            label=asked.label,
            verified_by=asked.verified_by,
            verification=asked.verification,
        )
        return _made(request, case, before)

    return once.run(work, asked.model_dump())


def _made(request: Request, case: Case, before: int) -> Made:
    """Return the case, made or as it was there already, by the library's version before."""
    code = status.HTTP_201_CREATED if case.library_version > before else status.HTTP_200_OK
    return Made(
        CaseAnswer.model_validate(case),
        location(request, "get_case", case_id=case.id),
        {"ETag": etag(case)},
        status=code,
    )


@router.get("/cases/{case_id}", response_model=CaseAnswer, responses={304: {"description": "as the client has it"}})
def get_case(
    _: Viewer,
    session: Reading,
    service: TheService,
    case_id: Identifier,
    response: Response,
    if_none_match: IfNoneMatch = None,
) -> CaseAnswer | Response:
    """One case, retired ones too, with its ETag."""
    case = service.library.retrieve.case(session, case_id)
    if has_already(if_none_match, etag(case)):
        return not_modified({"ETag": etag(case)})
    response.headers["ETag"] = etag(case)
    return CaseAnswer.model_validate(case)


@router.get("/cases/{case_id}/history")
def case_history(_: Viewer, session: Reading, service: TheService, case_id: Identifier) -> PageOf[AuditAnswer]:
    """All that happened to a case, oldest first."""
    items = [AuditAnswer.model_validate(row) for row in service.library.retrieve.history(session, case_id)]
    return PageOf(items=items, next_cursor=None)


@router.patch("/cases/{case_id}")
def change_case(
    admin: Admin,
    service: TheService,
    request: Request,
    case_id: Identifier,
    change: CaseChange,
    response: Response,
    if_match: IfMatch = None,
) -> CaseAnswer:
    """Change a case. With `If-Match` only if nobody else has changed it in the meantime."""
    changes = change.model_dump()
    with service.library.transaction(admin.actor, request.scope["request_id"]) as session:
        case = service.library.revise.case(session, case_id, changes, expected_version=expected(service, if_match))
    response.headers["ETag"] = etag(case)
    return CaseAnswer.model_validate(case)


@router.delete("/cases/{case_id}")
def retire_case(
    admin: Admin,
    service: TheService,
    request: Request,
    case_id: Identifier,
    response: Response,
    if_match: IfMatch = None,
) -> CaseAnswer:
    """Take a case out of every search. It stays readable, and `PATCH {"state": "confirmed"}` brings it back."""
    with service.library.transaction(admin.actor, request.scope["request_id"]) as session:
        case = service.library.revise.retire(session, case_id, expected_version=expected(service, if_match))
    response.headers["ETag"] = etag(case)
    return CaseAnswer.model_validate(case)


def etag(case: Case) -> str:
    return f'"{case.version}"'


def expected(service: Service, if_match: str | None) -> int | None:
    """Return the version that a change is based on; None means any.

    Raises:
        IfMatchRequired: if none is given and the installation wants one.
        Stale: if what is given is no ETag of ours.
    """
    if if_match is None:
        if service.settings.require_if_match:
            raise IfMatchRequired("Send the case's ETag (from GET) as If-Match, or `If-Match: *` to change it anyhow.")
        return None
    if if_match.strip() == "*":
        return None
    version = if_match.strip().removeprefix('"').removesuffix('"')
    if not (version.isascii() and version.isdigit() and len(version) < 10):
        raise Stale(f"If-Match {if_match!r} is not an ETag of this case; GET it again and use the ETag it comes with.")
    return int(version)


class ReviewAnswer(BaseModel):
    """What a look through the library found."""

    cases: int
    looked_at: int = Field(description="cases held against all others: all of them in a library of up to 10,000")
    redundant: list[Finding]
    contradictory: list[Finding]
    suspect: list[Finding]
    far: list[Finding]
    uncovered: list[Hole]
    competence: Competence
    plan: dict[str, object] = Field(description="what `POST /simulations` takes: counts, and campaigns hole by hole")


@router.get("/library/evaluation", tags=["library"])
def evaluation(
    _: Viewer,
    session: Reading,
    service: TheService,
    group: Annotated[Literal["gearbox", "axis", "case"], Query(description="what is left out together")] = "gearbox",
    origin: Annotated[
        Literal["measured", "simulated", "both"], Query(description="cases that answers are given from")
    ] = "both",
) -> EvaluationAnswer:
    """Leave out one gearbox at a time and diagnose it from the others; kept until the library changes."""
    return EvaluationAnswer.model_validate(service.evaluation(session, group, origin).to_document())


@router.get("/library/review", tags=["library"])
def get_review(_: Viewer, session: Reading, service: TheService) -> ReviewAnswer:
    """Redundant, contradictory, suspect and far cases, and what is missing.

    `plan` holds what `POST /simulations` takes: the counts of all holes together, and `campaigns` hole by hole.
    """
    return ReviewAnswer.model_validate(review(session, service.library.reuse.reasoner(session)).to_document())
