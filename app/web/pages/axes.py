"""Axes: descriptions with their revisions, the trend of each gearbox, maintenance marks."""

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated
from urllib.parse import quote
from zoneinfo import ZoneInfo

import tomli_w
from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response
from sqlalchemy import exists, select
from sqlalchemy.orm import Session

from app.errors import Unprocessable
from app.service import Reading, Service, TheService
from app.web.charts import Chart
from app.web.features import features_of
from app.web.session import FromOurPage, PageOperator, PageViewer
from app.web.templating import render
from app.web.trend import BASELINE, FEATURE, trend, when
from app.web.words import VERDICTS, investigation_headline
from casebase import audit, revisions
from casebase.axes import get_axis, is_axis, list_axes, unknown_axis
from casebase.description import check_name
from casebase.errors import NotFoundError
from casebase.models import (
    AxisRevision,
    Case,
    MaintenanceMark,
    RobotRevision,
    StoredDiagnosis,
    StoredInvestigation,
    StoredRecording,
)
from casebase.origins import SIMULATED, measured

router = APIRouter(prefix="/axes")
SECTION = "/axes"
LISTED, DRAWN = 10, 2000


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
def axis(request: Request, session: Reading, principal: PageViewer, name: str) -> Response:
    """One axis: trends, marks, description and revisions."""
    check_known(session, name)
    history = revisions.history(session, AxisRevision, name)
    marks = session.scalars(select(MaintenanceMark).where(MaintenanceMark.axis == name).order_by(MaintenanceMark.at))
    all_marks = list(marks)
    context = {
        "name": name,
        "history": list(reversed(history)),
        "toml": tomli_w.dumps(dict(history[-1].document)) if history else None,
        "trends": trends(session, name, all_marks),
        "marks": all_marks,
        "baseline": BASELINE,
        "diagnoses": diagnoses_of(session, name),
        "investigations": investigations_of(session, name),
        "listed": LISTED,
        "verdicts": VERDICTS,
    }
    return render(request, "axis.html", context, principal=principal, section=SECTION)


def check_known(session: Session, name: str) -> None:
    """Refuse the name of an axis that nothing knows.

    Raises:
        NotFoundError: naming those that are described.
    """
    if not is_axis(session, name):
        raise NotFoundError(unknown_axis(session, name))


def diagnoses_of(session: Session, axis: str) -> Sequence[StoredDiagnosis]:
    """Return the newest diagnoses of recordings of an axis."""
    statement = select(StoredDiagnosis).join(StoredDiagnosis.recording).where(StoredRecording.axis == axis)
    return session.scalars(statement.order_by(StoredDiagnosis.id.desc()).limit(LISTED)).all()


def investigations_of(session: Session, axis: str) -> list[tuple[StoredInvestigation, str | None]]:
    """Return the newest investigations of an axis, with what each found."""
    statement = select(StoredInvestigation).where(StoredInvestigation.axis == axis)
    rows = session.scalars(statement.order_by(StoredInvestigation.id.desc()).limit(LISTED))
    return [(row, investigation_headline(row.document) if row.document else None) for row in rows]


def trends(session: Session, axis: str, marks: list[MaintenanceMark]) -> list[tuple[str, Chart]]:
    """Return one chart per gearbox: crest factor over time of what was measured, its baseline, what was done to it."""
    statement = select(StoredRecording).where(StoredRecording.axis == axis, StoredRecording.usable)
    by_gearbox: dict[str, list[tuple[datetime, float]]] = {}
    generated = exists().where(Case.recording_id == StoredRecording.id, Case.origin == SIMULATED)
    statement = statement.where(StoredRecording.gearbox.is_not(None), ~generated)
    rows = session.scalars(statement.order_by(StoredRecording.id).limit(DRAWN)).all()
    for row in measured(session, rows):
        value = features_of(session, row.id).get(FEATURE)
        if row.gearbox is not None and value is not None:
            by_gearbox.setdefault(row.gearbox, []).append((when(row), value))
    drawn = [
        (gearbox, trend(f"Crest factor of gearbox {gearbox}", points, _texts(marks, gearbox)))
        for gearbox, points in sorted(by_gearbox.items())
    ]
    return [(gearbox, chart) for gearbox, chart in drawn if chart is not None]


def _texts(marks: list[MaintenanceMark], gearbox: str) -> list[tuple[datetime, str]]:
    return [(mark.at, mark.text) for mark in marks if mark.gearbox in (None, gearbox)]


@router.post("/{name}/marks", dependencies=[FromOurPage])
def add_mark(
    service: TheService,
    principal: PageOperator,
    name: str,
    text: Annotated[str, Form()],
    at: Annotated[str, Form()],
    gearbox: Annotated[str, Form()] = "",
) -> Response:
    """Note what was done to an axis, at the site's time."""
    try:
        when = datetime.fromisoformat(at).replace(tzinfo=ZoneInfo(service.settings.time_zone))
    except ValueError:
        raise Unprocessable(f"The time must look like 2026-11-20T14:03, got {at!r}.") from None
    if not text.strip():
        raise Unprocessable("Say what was done.")
    check_name("name of the axis", name)
    if gearbox.strip():
        check_name("gearbox", gearbox.strip())
    with service.library.transaction(principal.actor) as session:
        check_known(session, name)
        mark = MaintenanceMark(
            axis=name, gearbox=gearbox.strip() or None, at=when, text=text.strip(), created_by=principal.actor
        )
        session.add(mark)
        session.flush()
        audit.record(session, "mark.added", ("mark", mark.id), after=_said(mark))
    return _back(service, name)


@router.post("/{name}/marks/{mark_id}/remove", dependencies=[FromOurPage])
def remove_mark(service: TheService, principal: PageOperator, name: str, mark_id: str) -> Response:
    """Take a note back; the audit log keeps what it said."""
    with service.library.transaction(principal.actor) as session:
        mark = session.get(MaintenanceMark, mark_id)
        if mark is None or mark.axis != name:
            raise NotFoundError(f"no such note of axis {name!r}; it may have been removed already")
        audit.record(session, "mark.removed", ("mark", mark.id), before=_said(mark))
        session.delete(mark)
    return _back(service, name)


def _said(mark: MaintenanceMark) -> dict[str, object]:
    return {"axis": mark.axis, "gearbox": mark.gearbox, "at": mark.at.isoformat(), "text": mark.text}


def _back(service: Service, name: str) -> Response:
    return RedirectResponse(f"{service.settings.root_path.rstrip('/')}/axes/{quote(name, safe='')}", status_code=303)


@router.get("/{name}/axis.toml")
def axis_toml(session: Reading, _: PageViewer, name: str) -> Response:
    """The description as a file."""
    text = tomli_w.dumps(dict(get_axis(session, name).document))
    headers = {"Content-Disposition": 'attachment; filename="axis.toml"'}
    return Response(text, media_type="application/toml", headers=headers)
