"""Robots: descriptions of all their joints with their URDF, revision by revision."""

from typing import Annotated

from fastapi import APIRouter, Path, Request, Response, status
from sqlalchemy.orm import Session

from app.api.axes import AfterName, AfterRevision, Revision
from app.documents import Limit, PageOf, RobotAnswer, page_of
from app.http.errors import TooLarge, Unprocessable
from app.http.headers import location
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Viewer
from app.http.uploads import TheUpload, Upload
from app.investigations import add_robot
from app.service import Reading, Service
from casebase.store import revisions
from casebase.store.models import RobotRevision
from sim.robot.foreign import ForeignRobot, check_foreign, foreign_robot
from sim.robot.robot import LARGEST_URDF_BYTES

router = APIRouter(tags=["robots"])

Name = Annotated[str, Path(min_length=1, max_length=200, pattern=r"^[^\x00]*$", description="name of the robot")]
XML = "application/xml"
PARTS = ("robot", "urdf", "axis")
BINARY = {"type": "string", "format": "binary"}
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


def robot_of(service: Service, upload: Upload) -> ForeignRobot:
    """Return the robot of a request: described there, or stored under the name that it gives.

    Raises:
        Unprocessable: if a part is missing, or is one too many.
        NotFoundError: if no robot of that name is stored.
        SimulationError: if the description is wrong.
    """
    text = upload.text("robot", service.settings.document_bytes).strip()
    if not text:
        raise Unprocessable("The part 'urdf' belongs to a robot: send its robot.toml, or the same as JSON, as 'robot'.")
    if upload.fields.get("axis", "").strip():
        raise Unprocessable(
            "The parts 'axis' and 'robot' are one too many: send the axis alone, or the robot. An axis of one of its "
            "joints comes as a file, under the name that the joint gives, or as a table in the robot's description."
        )
    if any(mark in text for mark in "{=\n"):
        return described_robot(service, upload)
    if besides := sorted({"urdf", "axis"} & {*upload.files}):
        raise Unprocessable(
            f"The part {besides[0]!r} goes with a description, and 'robot' is the name of a stored robot, which has "
            "its own: leave one of them out."
        )
    with service.library.reading() as session:
        row = revisions.get(session, RobotRevision, text)
        return foreign_robot(row.document, row.urdf)


def described_robot(service: Service, upload: Upload) -> ForeignRobot:
    """Return the robot that the parts of a request describe.

    Raises:
        Unprocessable: if a part is missing.
        SimulationError: if the description is wrong.
    """
    limit = service.settings.document_bytes
    text = upload.text("robot", limit).strip()
    if not text:
        raise Unprocessable("The form needs the part 'robot': a robot.toml, or the same as JSON.")
    urdf = upload.file("urdf")
    if urdf.size > LARGEST_URDF_BYTES:
        raise TooLarge(f"The part 'urdf' has {urdf.size} bytes; it may have {LARGEST_URDF_BYTES}.")
    return check_foreign(text, urdf.path.read_bytes(), upload.texts("axis", limit))
