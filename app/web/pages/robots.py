"""Robots: descriptions with their joints, revisions and investigations."""

from dataclasses import dataclass

import tomli_w
from fastapi import APIRouter, Request
from fastapi.responses import Response
from sqlalchemy.orm import Session

from app.service import Reading
from app.web.headlines import Headlined, headlined, light
from app.web.pages.axes import LISTED, SECTION
from app.web.session import PageViewer
from app.web.templating import render
from casebase.errors import NotFoundError
from casebase.store import revisions
from casebase.store.models import RobotRevision, StoredInvestigation
from sim.description.axis import Axis
from sim.robot.foreign import kept_robot
from sim.robot.robot import Robot

router = APIRouter(prefix="/robots")


@dataclass(frozen=True)
class JointRow:
    """A joint as its description has it: range and largest speed of the URDF, None where it has none; its drive."""

    name: str
    unit: str
    low: float | None
    high: float | None
    speed: float | None
    axis: Axis | None


@router.get("/{name}")
def robot(request: Request, session: Reading, principal: PageViewer, name: str) -> Response:
    """One robot: its joints, revisions and investigations."""
    history = revisions.history(session, RobotRevision, name)
    investigations = investigations_of(session, name)
    if not history and not investigations:
        raise NotFoundError(
            f"no robot is known as {name!r}; the page of axes and robots lists those that are described"
        )
    described = kept_robot(history[-1].document, history[-1].urdf.encode()) if history else None
    context = {
        "name": name,
        "history": list(reversed(history)),
        "robot": described,
        "joints": joints_of(described) if described else [],
        "toml": tomli_w.dumps(dict(history[-1].document)) if history else None,
        "investigations": investigations,
        "listed": LISTED,
    }
    return render(request, "robot_description.html", context, principal=principal, section=SECTION)


def joints_of(robot: Robot) -> list[JointRow]:
    """Return the logged joints of a robot, in the log's order."""
    rows = []
    for joint in robot.joints:
        low, high, speed = robot.urdf.limits.get(joint.name, (None, None, None))
        unit = "m" if joint.name in robot.urdf.prismatic else "rad"
        rows.append(JointRow(joint.name, unit, low, high, speed, joint.axis if joint.described else None))
    return rows


def investigations_of(session: Session, name: str) -> list[Headlined]:
    """Return the newest investigations of a robot, with what each found."""
    statement = light().where(StoredInvestigation.robot == name)
    return headlined(session, session.scalars(statement.order_by(StoredInvestigation.id.desc()).limit(LISTED)).all())


@router.get("/{name}/robot.toml")
def robot_toml(session: Reading, _: PageViewer, name: str) -> Response:
    """The description as a file."""
    document = {**revisions.get(session, RobotRevision, name).document, "urdf": "robot.urdf"}
    headers = {"Content-Disposition": 'attachment; filename="robot.toml"'}
    return Response(tomli_w.dumps(document), media_type="application/toml", headers=headers)


@router.get("/{name}/robot.urdf")
def robot_urdf(session: Reading, _: PageViewer, name: str) -> Response:
    """Links and joints as a file."""
    headers = {"Content-Disposition": 'attachment; filename="robot.urdf"'}
    return Response(revisions.get(session, RobotRevision, name).urdf, media_type="application/xml", headers=headers)
