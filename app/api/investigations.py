"""Investigations: what the model of an axis or a robot gets wrong, by measured data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response, status
from pydantic import BaseModel, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.documents import Answer, AxisAnswer, Cursor, Identifier, Limit, PageOf, RobotAnswer, page_of
from app.http.headers import chosen, location, self_contained
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Operator, Viewer
from app.http.uploads import BINARY, TheUpload
from app.investigation_request import PARTS, asked_of
from app.investigations import (
    accept,
    compared,
    document_of,
    get_investigation,
    state_of,
    submit,
)
from app.jobs.job import Job
from app.service import Reading, Service, TheService
from casebase.store.models import RobotRevision, StoredInvestigation
from casebase.store.pagination import page
from signals.columns.table_kinds import table_kinds
from sim.investigation.report.comparison import Row, Value

router = APIRouter(tags=["investigations"])
HTML, JSON = "text/html", "application/json"
BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "anyOf": [
                        {"required": ["axis"]},
                        {"required": ["robot", "telemetry"]},
                        {"required": ["diagnosis"]},
                    ],
                    "additionalProperties": False,
                    "properties": {
                        "axis": {
                            "type": "string",
                            "description": "axis.toml, the same as JSON, or a stored axis' name; with a robot a file "
                            "for each that its joints name",
                        },
                        "robot": {
                            "type": "string",
                            "description": "instead of an axis: robot.toml or the same as JSON, of all logged joints, "
                            "or a stored robot's name",
                        },
                        "urdf": {**BINARY, "description": "links and joints of a robot that is not stored, as URDF"},
                        "telemetry": {
                            "type": "array",
                            "items": BINARY,
                            "description": f"{table_kinds()}, columns known by name and unit; several "
                            "recordings of the same axis are taken together, of several logs of a robot the last is "
                            "investigated",
                        },
                        "sound": {
                            "type": "array",
                            "items": BINARY,
                            "description": "any audio file that is read, the first with the first telemetry and so on; "
                            "without telemetry, several of the same axis",
                        },
                        "as_new": {
                            "type": "array",
                            "items": BINARY,
                            "description": "sound of the same motion from when the axis was new, which sound without "
                            "telemetry is compared with: errors of teeth and resonances",
                        },
                        "channels": {
                            "type": "string",
                            "description": "channel map, TOML or the same as JSON: which columns of the telemetry are "
                            "which channels, in what units; of a robot with lists, one entry a joint",
                        },
                        "diagnosis": {
                            "type": "string",
                            "description": "instead of a sound: id of a diagnosis, whose recording is the sound, and "
                            "whose axis is meant where none is given",
                        },
                        "sound_offset_s": {
                            "type": "number",
                            "description": "telemetry's time at its sound's start, the same for all",
                        },
                    },
                }
            }
        },
    }
}


@dataclass(frozen=True)
class InvestigationJob(Job):
    """The job; the investigation has the same id."""

    investigation_id: str


class InvestigationAnswer(
    Answer, of=StoredInvestigation, without=("job_id", "axis_document", "inputs", "document", "report")
):
    """An investigation in a list."""

    robot: str | None = Field(description="instead of an axis, where all joints of a robot are investigated")
    diagnosis_id: str | None = Field(description="the diagnosis from which it was started, whose recording is heard")


class NamedCause(BaseModel):
    """A cause that the model misses."""

    model_config = {"extra": "allow"}
    mechanism: str
    location: str | None
    probability: float = Field(ge=0, le=1)


class InvestigationDocument(BaseModel):
    """What was found; see the contract of `gearcase investigate --json`."""

    model_config = {"extra": "allow"}
    verdict: str
    findings: list[NamedCause]


class ComparisonAnswer(BaseModel):
    """Two investigations of one axis or robot, the earlier first."""

    before: str
    after: str
    other_description: bool = Field(description="whether they were held against different descriptions")
    findings: Sequence[Row]
    values: Sequence[Value]


@router.post(
    "/investigations", status_code=status.HTTP_202_ACCEPTED, response_model=InvestigationJob, openapi_extra=BODY
)
def investigate(_: Operator, upload: TheUpload, once: OnlyOnce, request: Request) -> Response:
    """Ask what the model of an axis or a robot misses. Answers the job.

    Of an axis: parts `axis`, and `telemetry`, `sound` or both. Of a robot: `robot` and `telemetry`, with `urdf` and an
    `axis` file for each that a joint names where the robot is not a stored one; `channels` where the columns do not
    name or count the joints, or are currents.

    Instead of `sound`, `diagnosis`: the recording of a diagnosis, and its axis where none is given.

    `telemetry` and `sound` may come several times: recordings of one axis, whose evidence is taken together. The k-th
    sound belongs to the k-th telemetry; the document then has `recordings`, each with what it says by itself. Sound
    without telemetry is compared with `as_new`, sound of the same motion from when the axis was new. Logs whose columns
    are not told by their names and units come with a channel map, `channels`; the refusal of one has its lines.
    """
    upload.only(*PARTS)
    service = once.service
    content, take = asked_of(service, upload)
    kept = once.replay(*content)
    if kept is not None:
        return kept
    question = take()

    def work(session: Session) -> Made:
        job = submit(service.library, session, service.jobs, question)
        answer = InvestigationJob(**vars(job), investigation_id=job.id)
        return Made(answer, location(request, "get_job", job_id=job.id), status=status.HTTP_202_ACCEPTED)

    return once.run(work, *content)


@router.get("/investigations")
def list_investigations(
    _: Viewer, session: Reading, service: TheService, limit: Limit = 50, cursor: Cursor = None
) -> PageOf[InvestigationAnswer]:
    """Investigations, newest first."""

    def answer(row: StoredInvestigation) -> InvestigationAnswer:
        shown = InvestigationAnswer.model_validate(row)
        return shown.model_copy(update={"state": state_of(row, lambda: service.jobs)})

    rows = page(session, select(StoredInvestigation), StoredInvestigation.id, limit=limit, cursor=cursor)
    return page_of(rows, answer)


@router.get("/investigations/{investigation_id}")
def investigation(
    _: Viewer, session: Reading, service: TheService, investigation_id: Identifier
) -> InvestigationDocument:
    """What was found; 409 with the state while the job runs or when it failed."""
    return InvestigationDocument.model_validate(_document(service, get_investigation(session, investigation_id)))


@router.get(
    "/investigations/{investigation_id}/report",
    response_model=InvestigationDocument,
    responses={200: {"content": {HTML: {}}}},
)
def investigation_report(
    _: Viewer, session: Reading, service: TheService, investigation_id: Identifier, request: Request
) -> Response:
    """The report: one HTML file that needs no network, or the document as JSON, by `Accept`."""
    row = get_investigation(session, investigation_id)
    document = InvestigationDocument.model_validate(_document(service, row))
    if chosen(request.headers.get("accept"), (HTML, JSON)) == JSON:
        return Response(document.model_dump_json(), media_type=JSON, headers={"Vary": "Accept"})
    return self_contained(row.report or "", "'self'", Vary="Accept")


@router.get("/investigations/{investigation_id}/comparison")
def compare_investigations(
    _: Viewer,
    session: Reading,
    investigation_id: Identifier,
    other: Annotated[str, Query(alias="with", max_length=32, description="id of another one of the same axis")],
) -> ComparisonAnswer:
    """What came, what went and what has another size, between two finished investigations of one axis or robot."""
    found = compared(session, investigation_id, other)
    return ComparisonAnswer(
        before=found.before.id,
        after=found.after.id,
        other_description=found.other_description,
        findings=found.rows,
        values=found.values,
    )


def _document(service: Service, row: StoredInvestigation) -> Mapping[str, object]:
    return document_of(row, state_of(row, lambda: service.jobs))


@router.post(
    "/investigations/{investigation_id}/accept",
    status_code=status.HTTP_201_CREATED,
    response_model=AxisAnswer | RobotAnswer,
)
def accept_investigation(
    admin: Admin, service: TheService, once: OnlyOnce, request: Request, investigation_id: Identifier
) -> Response:
    """Store the extended axis or robot as its next revision; later simulations and investigations start from it."""

    def work(session: Session) -> Made:
        row = accept(service.library, session, get_investigation(session, investigation_id))
        if isinstance(row, RobotRevision):
            return Made(RobotAnswer.model_validate(row), location(request, "get_robot", name=row.name))
        return Made(AxisAnswer.model_validate(row), location(request, "get_axis", name=row.name))

    return once.run(work)
