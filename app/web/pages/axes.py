"""Axes: descriptions with their revisions, their gearboxes, and what was done to them; robots with their joints."""

from datetime import datetime
from typing import Annotated
from urllib.parse import quote
from zoneinfo import ZoneInfo

import tomli_w
from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.axes import check_known
from app.http.errors import Unprocessable
from app.report.standing_words import state_badge, why
from app.service import Reading, Service, TheService
from app.web.page import FromOurPage, PageOperator, PageViewer, lead, newest, render
from casebase.alarms import rules
from casebase.axes import get_axis, list_axes
from casebase.description import check_choice, check_name
from casebase.errors import NotFoundError
from casebase.gearboxes import EXCHANGE, KINDS, NOTE, places_of
from casebase.store import audit, revisions
from casebase.store.models import (
    AxisRevision,
    MaintenanceMark,
    RobotRevision,
    StoredInvestigation,
    StoredRecording,
    now,
)
from sim.robot.foreign import kept_robot
from sim.robot.robot import Robot

robots = APIRouter(prefix="/robots")
router = APIRouter(prefix="/axes")
SECTION = "/axes"
LISTED = 10


@router.get("")
def axis_list(request: Request, session: Reading, principal: PageViewer) -> Response:
    """Every axis and robot at its current revision, and axes that only recordings name."""
    rows = list_axes(session)
    known = {row.name for row in rows}
    named = session.scalars(select(StoredRecording.axis).where(StoredRecording.axis.is_not(None)).distinct()).all()
    context = {
        "rows": rows,
        "undescribed": sorted(str(name) for name in named if name not in known),
        "robots": revisions.current(session, RobotRevision),
    }
    return render(request, "axes.html", context, principal=principal, section=SECTION)


@router.get("/{name}")
def axis(request: Request, session: Reading, service: TheService, principal: PageViewer, name: str) -> Response:
    """One axis: its gearboxes in service, notes on all of them, description and revisions."""
    check_known(session, name)
    history = revisions.history(session, AxisRevision, name)
    marks = session.scalars(select(MaintenanceMark).where(MaintenanceMark.axis == name).order_by(MaintenanceMark.at))
    at, zone = now(), service.settings.time_zone
    fleet = service.fleet.gearboxes(session, at, service.settings.silent_after, name)
    context = {
        "name": name,
        "history": list(reversed(history)),
        "toml": tomli_w.dumps(dict(history[-1].document)) if history else None,
        "gearboxes": [
            (row, state_badge(row.standing, at), why(row.standing, zone)) for row in fleet if row.standing is not None
        ],
        "marks": marks.all(),
        "investigations": newest(session, LISTED, StoredInvestigation.axis == name),
        "listed": LISTED,
    }
    return render(request, "axis.html", context, principal=principal, section=SECTION)


@router.post("/{name}/marks", dependencies=[FromOurPage])
def add_mark(
    service: TheService,
    principal: PageOperator,
    name: str,
    text: Annotated[str, Form()],
    at: Annotated[str, Form()],
    gearbox: Annotated[str, Form()] = "",
    kind: Annotated[str, Form()] = NOTE,
    successor: Annotated[str, Form()] = "",
    back: Annotated[str | None, Form()] = None,
) -> Response:
    """Note what was done to an axis or a gearbox of it, at the site's time."""
    try:
        when = datetime.fromisoformat(at).replace(tzinfo=ZoneInfo(service.settings.time_zone))
    except ValueError:
        raise Unprocessable(f"The time must look like 2026-11-20T14:03, got {at!r}.") from None
    if not text.strip():
        raise Unprocessable("Say what was done.")
    check_name("name of the axis", name)
    if gearbox.strip():
        check_name("gearbox", gearbox.strip())
    check_choice("kind", kind, KINDS)
    if kind != NOTE and when > now():
        raise Unprocessable("What was done is noted when it is done: its time must not lie in the future.")
    if successor.strip():
        check_name("name of the new gearbox", successor.strip())
        if kind != EXCHANGE:
            raise Unprocessable("Only an exchange has a new gearbox: choose Exchange, or leave its name empty.")
    with service.library.transaction(principal.actor) as session:
        check_known(session, name)
        mark = MaintenanceMark(
            axis=name,
            gearbox=gearbox.strip() or None,
            at=when,
            kind=kind,
            successor=successor.strip() or None,
            text=text.strip(),
            created_by=principal.actor,
        )
        session.add(mark)
        session.flush()
        audit.record(session, "mark.added", ("mark", mark.id), after=_said(mark))
        _review(session, mark)
    return _back(service, name, back)


def _review(session: Session, mark: MaintenanceMark) -> None:
    """Hold the rules against the gearboxes that a mark is of: a repair and an exchange end what was said of them."""
    for axis, gearbox in places_of(session, mark):
        rules.review(session, axis, gearbox)


@router.post("/{name}/marks/{mark_id}/remove", dependencies=[FromOurPage])
def remove_mark(
    service: TheService,
    principal: PageOperator,
    name: str,
    mark_id: str,
    back: Annotated[str | None, Form()] = None,
) -> Response:
    """Take a note back; the audit log keeps what it said."""
    with service.library.transaction(principal.actor) as session:
        mark = session.get(MaintenanceMark, mark_id)
        if mark is None or mark.axis != name:
            raise NotFoundError(f"no such note of axis {name!r}; it may have been removed already")
        audit.record(session, "mark.removed", ("mark", mark.id), before=_said(mark))
        session.delete(mark)
        session.flush()
        _review(session, mark)
    return _back(service, name, back)


def _said(mark: MaintenanceMark) -> dict[str, object]:
    said = {"axis": mark.axis, "gearbox": mark.gearbox, "at": mark.at.isoformat(), "text": mark.text}
    return {**said, "kind": mark.kind, "successor": mark.successor}


def _back(service: Service, name: str, gearbox: str | None) -> Response:
    """Lead to the page of the gearbox whose form it was, empty where it is not named, or to that of the axis."""
    page = f"/axes/{quote(name, safe='')}"
    if gearbox is not None:
        page += f"/gearboxes/{quote(gearbox, safe='')}".rstrip("/")
    return lead(service, page)


@router.get("/{name}/axis.toml")
def axis_toml(session: Reading, _: PageViewer, name: str) -> Response:
    """The description as a file."""
    text = tomli_w.dumps(dict(get_axis(session, name).document))
    headers = {"Content-Disposition": 'attachment; filename="axis.toml"'}
    return Response(text, media_type="application/toml", headers=headers)


@robots.get("/{name}")
def robot(request: Request, session: Reading, principal: PageViewer, name: str) -> Response:
    """One robot: its joints, revisions and investigations."""
    history = revisions.history(session, RobotRevision, name)
    investigations = newest(session, LISTED, StoredInvestigation.robot == name)
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


def joints_of(robot: Robot) -> list[dict[str, object]]:
    """Return the logged joints of a robot, in the log's order: range and largest speed of the URDF, and the drive."""
    rows: list[dict[str, object]] = []
    for joint in robot.joints:
        low, high, speed = robot.urdf.limits.get(joint.name, (None, None, None))
        unit = "m" if joint.name in robot.urdf.prismatic else "rad"
        axis = joint.axis if joint.described else None
        rows.append({"name": joint.name, "unit": unit, "low": low, "high": high, "speed": speed, "axis": axis})
    return rows


@robots.get("/{name}/robot.toml")
def robot_toml(session: Reading, _: PageViewer, name: str) -> Response:
    """The description as a file."""
    document = {**revisions.get(session, RobotRevision, name).document, "urdf": "robot.urdf"}
    headers = {"Content-Disposition": 'attachment; filename="robot.toml"'}
    return Response(tomli_w.dumps(document), media_type="application/toml", headers=headers)


@robots.get("/{name}/robot.urdf")
def robot_urdf(session: Reading, _: PageViewer, name: str) -> Response:
    """Links and joints as a file."""
    headers = {"Content-Disposition": 'attachment; filename="robot.urdf"'}
    return Response(revisions.get(session, RobotRevision, name).urdf, media_type="application/xml", headers=headers)
