"""Axes and robots: descriptions of drives, and of all joints of a robot with its URDF, revision by revision."""

from typing import Annotated

import tomli_w
from fastapi import APIRouter, Depends, Path, Query, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from sqlalchemy.orm import Session

from app.axes import axis_schema
from app.documents import CONTINUES, AxisAnswer, Limit, PageOf, RobotAnswer, page_of
from app.http.errors import UnsupportedMedia
from app.http.headers import location
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Viewer
from app.http.uploads import BINARY, TheUpload
from app.investigation_request import described_robot
from app.investigations import add_robot
from app.service import Reading, TheService
from casebase import axes
from casebase.store import revisions
from casebase.store.models import AxisRevision, RobotRevision
from sim.description.axis_document import parse_axis, read_axis

router = APIRouter(tags=["axes"])

Name = Annotated[str, Path(min_length=1, max_length=200, pattern=r"^[^\x00]*$", description="name of the axis")]
Revision = Annotated[int | None, Query(ge=1, le=2**31 - 1, description="which revision; the current one by default")]
AfterName = Annotated[str | None, Query(min_length=1, max_length=200, pattern=r"^[^\x00]*$", description=CONTINUES)]
AfterRevision = Annotated[int | None, Query(ge=1, le=2**31 - 1, description=CONTINUES)]
EXAMPLE = {
    "schema": "gearcase-axis/1",
    "name": "axis-a",
    "motor": {"inertia_kg_m2": 0.006, "coulomb_friction_n_m": 0.4},
    "stages": [
        {"name": "transfer", "driver_teeth": 12, "driven_teeth": 96, "inertia_kg_m2": 0.02},
        {"name": "output", "driver_teeth": 12, "driven_teeth": 150},
    ],
    "transmission": {"stiffness_n_m_per_rad": 1.0e5},
    "load": {"inertia_kg_m2": 40.0},
}
TOML = tomli_w.dumps(EXAMPLE)
BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {"schema": axis_schema(), "example": EXAMPLE},
            "application/toml": {"schema": {"type": "string", "description": "the same as TOML"}, "example": TOML},
        },
    }
}


@router.get("/axes")
def list_axes(_: Viewer, session: Reading, limit: Limit = 50, cursor: AfterName = None) -> PageOf[AxisAnswer]:
    """The current revision of every axis, by name."""
    return page_of(revisions.current_page(session, AxisRevision, limit=limit, cursor=cursor), AxisAnswer.model_validate)


@router.get("/axes/{name}")
def get_axis(_: Viewer, session: Reading, name: Name, revision: Revision = None) -> AxisAnswer:
    """One revision of an axis, the current one by default."""
    return AxisAnswer.model_validate(axes.get_axis(session, name, revision))


@router.get("/axes/{name}/revisions")
def axis_revisions(
    _: Viewer, session: Reading, name: Name, limit: Limit = 50, cursor: AfterRevision = None
) -> PageOf[AxisAnswer]:
    """The revisions of an axis, oldest first."""
    axes.get_axis(session, name)
    return page_of(
        revisions.history_page(session, AxisRevision, name, limit=limit, cursor=cursor), AxisAnswer.model_validate
    )


@router.delete("/axes/{name}", status_code=status.HTTP_204_NO_CONTENT)
def remove_axis(admin: Admin, service: TheService, request: Request, name: Name) -> None:
    """Remove an axis with all its revisions. One that a recording or an investigation names stays (409)."""
    with service.library.transaction(admin.actor, request.scope["request_id"]) as session:
        axes.remove_axis(session, name)


async def axis_body(request: Request) -> dict[str, object]:
    """The description sent, as TOML text or as JSON."""
    kind = request.headers.get("content-type", "").split(";")[0].strip().lower()
    if kind not in ("application/toml", "application/json"):
        raise UnsupportedMedia(f"Send application/json or application/toml; this is {kind or 'without content type'}.")
    return await run_in_threadpool(parse_axis, await request.body())


@router.post("/axes", status_code=status.HTTP_201_CREATED, response_model=AxisAnswer, openapi_extra=BODY)
def add_axis(
    _: Admin, document: Annotated[dict[str, object], Depends(axis_body)], once: OnlyOnce, request: Request
) -> Response:
    """Store an axis description (see `axis.toml`); a changed one is the next revision, the same one is not."""
    described = read_axis(document)

    def work(session: Session) -> Made:
        row = axes.add_axis(session, described.name, described.to_mapping())
        return Made(AxisAnswer.model_validate(row), location(request, "get_axis", name=row.name))

    return once.run(work, document)


robots = APIRouter(tags=["robots"])

RobotName = Annotated[str, Path(min_length=1, max_length=200, pattern=r"^[^\x00]*$", description="name of the robot")]
XML = "application/xml"
PARTS = ("robot", "urdf", "axis")
ROBOT_PARTS = {
    "robot": {"type": "string", "description": "robot.toml or the same as JSON, of all logged joints"},
    "urdf": {**BINARY, "description": "the robot's links and joints, as URDF"},
    "axis": {"type": "array", "items": BINARY, "description": "a file for each that a joint of the robot names"},
}
ROBOT_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["robot", "urdf"],
                    "additionalProperties": False,
                    "properties": ROBOT_PARTS,
                }
            }
        },
    }
}


@robots.get("/robots")
def list_robots(_: Viewer, session: Reading, limit: Limit = 50, cursor: AfterName = None) -> PageOf[RobotAnswer]:
    """The current revision of every robot, by name."""
    found = revisions.current_page(session, RobotRevision, limit=limit, cursor=cursor)
    return page_of(found, RobotAnswer.model_validate)


@robots.get("/robots/{name}")
def get_robot(_: Viewer, session: Reading, name: RobotName, revision: Revision = None) -> RobotAnswer:
    """One revision of a robot, the current one by default."""
    return RobotAnswer.model_validate(revisions.get(session, RobotRevision, name, revision))


@robots.get("/robots/{name}/urdf", response_class=Response, responses={200: {"content": {XML: {}}}})
def robot_urdf(_: Viewer, session: Reading, name: RobotName, revision: Revision = None) -> Response:
    """The links and joints of one revision, as URDF."""
    return Response(revisions.get(session, RobotRevision, name, revision).urdf, media_type=XML)


@robots.get("/robots/{name}/revisions")
def robot_revisions(
    _: Viewer, session: Reading, name: RobotName, limit: Limit = 50, cursor: AfterRevision = None
) -> PageOf[RobotAnswer]:
    """The revisions of a robot, oldest first."""
    revisions.get(session, RobotRevision, name)
    found = revisions.history_page(session, RobotRevision, name, limit=limit, cursor=cursor)
    return page_of(found, RobotAnswer.model_validate)


@robots.post("/robots", status_code=status.HTTP_201_CREATED, response_model=RobotAnswer, openapi_extra=ROBOT_BODY)
def post_robot(_: Admin, upload: TheUpload, once: OnlyOnce, request: Request) -> Response:
    """Store a robot (see `robot.toml`) with its URDF and the axes of its joints; a changed one is the next revision,
    the same one is not.

    Of the URDF links and joints are kept. An investigation takes the robot by its name.
    """
    upload.only(*PARTS)
    robot = described_robot(once.service, upload)

    def work(session: Session) -> Made:
        row = add_robot(session, robot)
        return Made(RobotAnswer.model_validate(row), location(request, "get_robot", name=row.name))

    return once.run(work, robot.document, robot.urdf)
