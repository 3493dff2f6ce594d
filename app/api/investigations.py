"""Investigations: what the model of an axis or a robot gets wrong, by measured data."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response, status
from pydantic import BaseModel, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.api.robots import BINARY, robot_of
from app.documents import Answer, AxisAnswer, Cursor, Identifier, Limit, PageOf, RobotAnswer, page_of
from app.http.errors import Unprocessable
from app.http.headers import chosen, location
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Operator, Viewer
from app.http.uploads import TheUpload, Upload
from app.investigations import (
    Measured,
    Question,
    accept,
    compared,
    document_of,
    get_investigation,
    state_of,
    submit,
    take_in,
    take_in_robot,
)
from app.jobs.job import Job
from app.report.self_contained import self_contained
from app.service import Reading, Service, TheService
from casebase.axes import get_axis
from casebase.diagnoses import get_diagnosis
from casebase.store.models import RobotRevision, StoredInvestigation
from casebase.store.pagination import page
from signals.columns.table_kinds import table_kinds
from sim.description.axis import Axis
from sim.description.axis_document import parse_axis, read_axis
from sim.investigation.report.comparison import Row, Value

router = APIRouter(tags=["investigations"])
PARTS = (
    "axis",
    "telemetry",
    "sound",
    "as_new",
    "sound_offset_s",
    "channels",
    "robot",
    "urdf",
    "diagnosis",
)
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
        job = submit(session, service.jobs, question)
        answer = InvestigationJob(**vars(job), investigation_id=job.id)
        return Made(answer, location(request, "get_job", job_id=job.id), status=status.HTTP_202_ACCEPTED)

    return once.run(work, *content)


def asked_of(service: Service, upload: Upload) -> tuple[tuple[object, ...], Callable[[], Question]]:
    """Return what a form asks for, an investigation of an axis or of a robot: all that makes it the same as another
    request, and what takes it in.

    Raises:
        Unprocessable: if parts are missing or do not go together.
        AxisError: if the description of the axis or robot is wrong.
    """
    hashes = [(name, file.sha256) for name in PARTS for file in upload.all_of(name)]
    telemetry, sounds, as_new = (
        tuple(Measured(file.path, file.name) for file in upload.all_of(name))
        for name in ("telemetry", "sound", "as_new")
    )
    channels = upload.text("channels", service.settings.document_bytes).strip()
    mapped = [channels] if channels else []
    if {"robot", "urdf"} & {*upload.files, *upload.fields}:
        _refuse_sound(upload)
        robot = robot_of(service, upload)
        urdf = upload.file("urdf").name if "urdf" in upload.files else f"{robot.name}.urdf"
        take = partial(take_in_robot, service.library, robot, urdf, telemetry, channels)
        return (robot.document, robot.urdf, hashes, *mapped), take
    diagnosed = upload.fields.get("diagnosis", "").strip() or None
    if diagnosed is not None:
        sounds = (_recorded(service, upload, diagnosed),)
    axis = axis_of(service, upload)
    offset = offset_of(upload)
    take = partial(take_in, service.library, axis, telemetry, sounds, offset, as_new, channels, diagnosed)
    return (axis.to_mapping(), hashes, offset, *mapped, *([diagnosed] if diagnosed else [])), take


def _recorded(service: Service, upload: Upload, diagnosis_id: str) -> Measured:
    """Return the recording of a diagnosis as a sound; its axis is meant where the form has none."""
    if "sound" in upload.files:
        raise Unprocessable(
            "The parts 'diagnosis' and 'sound' do not go together: the diagnosis' recording is the sound."
        )
    with service.library.reading() as session:
        row = get_diagnosis(session, diagnosis_id).recording
    if row.erased_at is not None:
        raise Unprocessable(f"The recording of diagnosis {diagnosis_id} was erased; send a sound instead.")
    if row.axis and "axis" not in upload.files:
        upload.fields.setdefault("axis", row.axis)
    return Measured(service.library.retrieve.audio_path(row), row.file_name, row.channel)


def _refuse_sound(upload: Upload) -> None:
    if besides := sorted({"sound", "as_new", "sound_offset_s", "diagnosis"} & {*upload.files, *upload.fields}):
        raise Unprocessable(
            f"The part {besides[0]!r} does not go with a robot: sound is investigated with the axis of the joint that "
            "is heard; leave it out, or send 'axis' instead of 'robot'."
        )


def axis_of(service: Service, upload: Upload) -> Axis:
    """Return the axis of a request: TOML, JSON, or the name of a stored one.

    Raises:
        Unprocessable: if it is missing.
        AxisError: if the description is wrong or none of these.
    """
    if len(upload.all_of("axis")) > 1:
        raise Unprocessable("The form has the part 'axis' twice; one axis is investigated at a time, or a robot.")
    text = upload.text("axis", service.settings.document_bytes).strip()
    if not text:
        raise Unprocessable(
            "The form needs the part 'axis': an axis.toml, the same as JSON, or a stored axis' name; or, of a whole "
            "robot, the parts 'robot' (with 'urdf', or a stored one's name) and 'telemetry'."
        )
    if not any(mark in text for mark in "{=\n"):
        with service.library.reading() as session:
            return read_axis(get_axis(session, text).document)
    return read_axis(parse_axis(text))


def offset_of(upload: Upload) -> float:
    """Return the start of the sounds of a request after that of the telemetry [s].

    Raises:
        Unprocessable: if it is no number.
    """
    text = upload.fields.get("sound_offset_s", "")
    try:
        value = float(text or 0.0)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise Unprocessable(f"sound_offset_s must be a number of seconds, got {text[:40]!r}.")
    return value


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
