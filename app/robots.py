"""Robots as a request names them: described in its parts, or stored here."""

from collections.abc import Mapping

from sqlalchemy.orm import Session

from app.http.errors import TooLarge, Unprocessable
from app.http.uploads import Upload
from app.service import Service
from casebase.store import revisions
from casebase.store.models import RobotRevision
from sim.robot.foreign import ForeignRobot, check_foreign, foreign_robot
from sim.robot.robot import LARGEST_URDF_BYTES

PARTS = ("robot", "urdf", "axis")
BINARY = {"type": "string", "format": "binary"}
ROBOT_PARTS = {
    "robot": {"type": "string", "description": "robot.toml or the same as JSON, of all logged joints"},
    "urdf": {**BINARY, "description": "the robot's links and joints, as URDF"},
    "axis": {"type": "array", "items": BINARY, "description": "a file for each that a joint of the robot names"},
}


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
        return stored_robot(session, text)


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


def stored_robot(session: Session, name: str, revision: int | None = None) -> ForeignRobot:
    """Return a robot that is stored; raises NotFoundError."""
    row = revisions.get(session, RobotRevision, name, revision)
    return foreign_robot(row.document, row.urdf)


def add_robot(
    session: Session,
    robot: ForeignRobot,
    *,
    document: Mapping[str, object] | None = None,
    note: str | None = None,
    investigation_id: str | None = None,
) -> RobotRevision:
    """Store a robot, or another `document` of it, as the next revision of its name; the same again is no new one."""
    content = {"document": dict(robot.document if document is None else document), "urdf": robot.urdf}
    return revisions.add(session, RobotRevision, robot.name, content, note=note, investigation_id=investigation_id)
