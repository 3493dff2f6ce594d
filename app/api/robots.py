"""Robots: descriptions of all their joints with their URDF, revision by revision."""

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response, status
from sqlalchemy.orm import Session

from app.api.axes import AfterName, AfterRevision, Revision
from app.documents import Limit, PageOf, RobotAnswer, page_of
from app.http.headers import location
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Viewer
from app.http.uploads import BINARY, TheUpload
from app.investigation_request import described_robot
from app.investigations import add_robot
from app.service import Reading
from casebase.store import revisions
from casebase.store.models import RobotRevision

router = APIRouter(tags=["robots"])

Name = Annotated[str, Path(min_length=1, max_length=200, pattern=r"^[^\x00]*$", description="name of the robot")]
XML = "application/xml"
PARTS = ("robot", "urdf", "axis")
ROBOT_PARTS = {
    "robot": {"type": "string", "description": "robot.toml or the same as JSON, of all logged joints"},
    "urdf": {**BINARY, "description": "the robot's links and joints, as URDF"},
    "axis": {"type": "array", "items": BINARY, "description": "a file for each that a joint of the robot names"},
}
BODY = {
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


@router.get("/robots")
def list_robots(_: Viewer, session: Reading, limit: Limit = 50, cursor: AfterName = None) -> PageOf[RobotAnswer]:
    """The current revision of every robot, by name."""
    found = revisions.current_page(session, RobotRevision, limit=limit, cursor=cursor)
    return page_of(found, RobotAnswer.model_validate)


@router.get("/robots/{name}")
def get_robot(_: Viewer, session: Reading, name: Name, revision: Revision = None) -> RobotAnswer:
    """One revision of a robot, the current one by default."""
    return RobotAnswer.model_validate(revisions.get(session, RobotRevision, name, revision))


@router.get("/robots/{name}/urdf", response_class=Response, responses={200: {"content": {XML: {}}}})
def robot_urdf(_: Viewer, session: Reading, name: Name, revision: Revision = None) -> Response:
    """The links and joints of one revision, as URDF."""
    return Response(revisions.get(session, RobotRevision, name, revision).urdf, media_type=XML)


@router.get("/robots/{name}/revisions")
def robot_revisions(
    _: Viewer, session: Reading, name: Name, limit: Limit = 50, cursor: AfterRevision = None
) -> PageOf[RobotAnswer]:
    """The revisions of a robot, oldest first."""
    revisions.get(session, RobotRevision, name)
    found = revisions.history_page(session, RobotRevision, name, limit=limit, cursor=cursor)
    return page_of(found, RobotAnswer.model_validate)


@router.post("/robots", status_code=status.HTTP_201_CREATED, response_model=RobotAnswer, openapi_extra=BODY)
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
