"""Axes: descriptions with their revisions, and what was done to them; the fleet and each gearbox; robots."""

from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from operator import attrgetter
from typing import Annotated, Any, Literal
from urllib.parse import quote
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import tomli_w
from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import JSONResponse, Response
from markupsafe import Markup
from pydantic import BeforeValidator
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.axes import check_known
from app.fleet import Gearbox, natural
from app.http.errors import Unprocessable
from app.report.charts import Window, charts_of
from app.report.formatting import term
from app.report.standing_words import Counted, day, evidence_words, next_steps, state_badge, state_of, trend_words, why
from app.service import Reading, Service, TheService
from app.web.forms import Fields
from app.web.page import (
    ROWS,
    FromOurPage,
    Headlined,
    PageOperator,
    PageViewer,
    lead,
    listing,
    newest,
    render,
    waiting_page,
)
from casebase.alarms import rules
from casebase.axes import axis_names, get_axis, is_axis, near_names, unknown_axis
from casebase.description import check_choice, check_name
from casebase.errors import NotFoundError
from casebase.gearbox_state import Standing, standing
from casebase.gearboxes import EXCHANGE, KINDS, NOTE, History, gearbox_names, places_of
from casebase.labels import BASELINES
from casebase.reasoning.trend import Trend, trend_of
from casebase.store import audit, revisions
from casebase.store.models import (
    AxisRevision,
    MaintenanceMark,
    RobotRevision,
    StoredDiagnosis,
    StoredInvestigation,
    StoredRecording,
    now,
)
from sim.robot.foreign import kept_robot

robots = APIRouter(prefix="/robots")
router = APIRouter(prefix="/axes")
fleet_router = APIRouter()
Moment = Annotated[datetime | None, BeforeValidator(lambda text: text or None)]
Word = Annotated[str, Query(max_length=200, pattern=r"^[^\x00]*$")]
SECTION = "/axes"
LISTED = 10
OVER_IT = 3
"""Gearboxes that are laid over one: there is no fifth colour."""


@router.get("")
def axis_list(request: Request, session: Reading, _: PageViewer) -> Response:
    """Every axis and robot at its current revision, and axes that only recordings name."""
    robots = session.scalars(select(RobotRevision.name).distinct())
    known = [*((False, name) for name in axis_names(session)), *((True, name) for name in robots)]
    by_name = sorted(known, key=lambda one: natural(one[1]))
    found = listing(request, session, by_name, name=lambda one: one[1], robots_first=lambda one: not one[0])
    shown = [name for _, name in found.rows]
    known_as: dict[tuple[bool, str], object] = {
        **{(False, row.name): row for row in revisions.current(session, AxisRevision, names=shown)},
        **{(True, row.name): row for row in revisions.current(session, RobotRevision, names=shown)},
    }
    context = {"list": found, "rows": [(*one, known_as.get(one)) for one in found.rows]}
    return render(request, "axes.html", context, section=SECTION)


@fleet_router.get("/names/{kind}")
def names(
    session: Reading,
    _: PageViewer,
    kind: Literal["axis", "gearbox"],
    search: Word = "",
    axis: Word = "",
    near: Word = "",
    also: Annotated[list[Word] | None, Query()] = None,
) -> list[str]:
    """Names that hold a text, of axes or of the gearboxes of an axis, for whoever begins to write one.

    Args:
        near: a name, of which those are wanted that it may be a misspelling of, of these and of `also`.
    """
    if near:
        known = [*(also or ()), *(axis_names(session) if kind == "axis" else gearbox_names(session, most=5000))]
        return [] if near in known else near_names(near, known)
    if kind == "gearbox":
        return list(gearbox_names(session, axis or None, search, ROWS))
    return [name for name in axis_names(session) if search.lower() in name.lower()][:ROWS]


@router.get("/{name}")
def axis(request: Request, session: Reading, service: TheService, _: PageViewer, name: str) -> Response:
    """One axis: its gearboxes in service, notes on all of them, description and revisions."""
    check_known(session, name)
    marks = session.scalars(select(MaintenanceMark).where(MaintenanceMark.axis == name).order_by(MaintenanceMark.at))
    fleet = service.fleet.gearboxes(session, now(), service.settings.silent_after, name)
    context = {
        **described(session, AxisRevision, name, StoredInvestigation.axis),
        "gearboxes": in_words(session, service, [row for row in fleet[:ROWS] if row.standing is not None]),
        "has_more": len(fleet) > ROWS,
        "marks": marks.all(),
    }
    return render(request, "axis.html", context, section=SECTION)


def described(session: Session, kind: type[revisions.Revision], name: str, subject: Any) -> dict[str, Any]:
    """Return what the page of an axis or a robot says of its revisions, the newest first, and of its investigations."""
    investigations, history = newest(session, LISTED, subject == name), revisions.history(session, kind, name)
    toml = tomli_w.dumps(dict(history[-1].document)) if history else None
    said = {"name": name, "history": list(reversed(history)), "toml": toml}
    return {**said, "investigations": investigations, "listed": LISTED}


@router.post("/{name}/marks", dependencies=[FromOurPage])
def add_mark(service: TheService, principal: PageOperator, name: str, fields: Fields) -> Response:
    """Note what was done to an axis or a gearbox of it, at a time in the browser's zone or else the site's."""
    text, at, gearbox, successor = (fields.get(each, "") for each in ("text", "at", "gearbox", "successor"))
    kind, zone = fields.get("kind", NOTE), fields.get("zone", "")[:100]
    try:
        when = datetime.fromisoformat(at).replace(tzinfo=ZoneInfo(zone or service.settings.time_zone))
    except (ValueError, ZoneInfoNotFoundError):
        raise Unprocessable(f"The time must look like 2026-11-20T14:03, got {at!r} {zone}.") from None
    if not text:
        raise Unprocessable("Say what was done.")
    check_name("name of the axis", name)
    if gearbox:
        check_name("gearbox", gearbox)
    check_choice("kind", kind, KINDS)
    if kind != NOTE and when > now():
        raise Unprocessable("What was done is noted when it is done: its time must not lie in the future.")
    if successor:
        check_name("name of the new gearbox", successor)
        if kind != EXCHANGE:
            raise Unprocessable("Only an exchange has a new gearbox: choose Exchange, or leave its name empty.")
    with service.library.transaction(principal.actor) as session:
        check_known(session, name)
        mark = MaintenanceMark(axis=name, gearbox=gearbox or None, at=when, kind=kind, successor=successor or None)
        mark.text, mark.created_by = text, principal.actor
        session.add(mark)
        session.flush()
        audit.record(session, "mark.added", ("mark", mark.id), after=_said(mark))
        _review(session, mark)
    return _back(service, name, fields.get("back"))


def _review(session: Session, mark: MaintenanceMark) -> None:
    """Hold the rules against the gearboxes that a mark is of: a repair and an exchange end what was said of them."""
    for axis, gearbox in places_of(session, mark):
        rules.review(session, axis, gearbox)


@router.post("/{name}/marks/{mark_id}/remove", dependencies=[FromOurPage])
def remove_mark(service: TheService, principal: PageOperator, name: str, mark_id: str, fields: Fields) -> Response:
    """Take a note back; the audit log keeps what it said."""
    with service.library.transaction(principal.actor) as session:
        mark = session.get(MaintenanceMark, mark_id)
        if mark is None or mark.axis != name:
            raise NotFoundError(f"no such note of axis {name!r}; it may have been removed already")
        audit.record(session, "mark.removed", ("mark", mark.id), before=_said(mark))
        session.delete(mark)
        session.flush()
        _review(session, mark)
    return _back(service, name, fields.get("back"))


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
def robot(request: Request, session: Reading, _: PageViewer, name: str) -> Response:
    """One robot: its joints, revisions and investigations."""
    context = described(session, RobotRevision, name, StoredInvestigation.robot)
    history = context["history"]
    if not history and not context["investigations"]:
        raise NotFoundError(
            f"no robot is known as {name!r}; the page of axes and robots lists those that are described"
        )
    robot = kept_robot(history[0].document, history[0].urdf.encode()) if history else None
    return render(request, "robot_description.html", {**context, "robot": robot}, section=SECTION)


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


FLEET = "/fleet"
ORDERS = {
    "gearbox": attrgetter("name"),
    "last_change": attrgetter("unchanged"),
    "last_recording": attrgetter("unheard"),
}
SAID_BY = ("fault", "hypotheses", "labels", "quality", "remarks", "novelty", "recording", "provenance", "evidence")
"""Parts of a diagnosis that are needed to say in short what it says and asks for."""


@fleet_router.get("/fleet")
def fleet(
    request: Request, session: Reading, service: TheService, _: PageViewer, state: Counted | None = None
) -> Response:
    """The gearboxes with their states, the worst first: all of them or those in one state, a page of them."""
    begun = service.fleet_soon(session)
    if begun is not None:
        words = "Every gearbox with its state, the worst first."
        basis = "all recordings, once after each start of the service"
        return waiting_page(request, begun, title="Fleet", words=words, basis=basis, section=FLEET)
    known = service.fleet.gearboxes(session, now(), service.settings.silent_after)
    counts = Counter(state_of(row.standing) for row in known)
    found = listing(request, session, [row for row in known if state in (None, state_of(row.standing))], **ORDERS)
    context = {
        "rows": in_words(session, service, found.rows),
        "counts": [(str(each), term(each, "gearboxes"), count) for each, count in counts.items()],
        "states": [(str(each), term(each, "gearboxes")) for each in counts],
        "state": state,
        "list": found,
        "day": lambda value: day(value, service.settings.time_zone),
    }
    return render(request, "fleet.html", context, section=FLEET)


def in_words(
    session: Session, service: Service, gearboxes: Sequence[Gearbox]
) -> list[tuple[Gearbox, Markup, str, str]]:
    """Return each gearbox with its state, why it is in it and how sure that is, and what to do now."""
    at, zone = now(), service.settings.time_zone
    return [
        (row, state_badge(row.standing, at), why(row.standing, zone, one), next_steps(row.standing, one)[0])
        for row, one in zip(gearboxes, diagnoses_of(session, [row.standing for row in gearboxes]), strict=True)
    ]


def window_of(
    session: Reading,
    service: TheService,
    _: PageViewer,
    name: str,
    since: Annotated[Moment, Query(alias="from")] = None,
    until: Annotated[Moment, Query(alias="to")] = None,
    others: Annotated[list[Word] | None, Query(alias="with")] = None,
) -> Window:
    """Dependency: what the address says of a trend; a day alone is the whole day at the site."""
    zone = ZoneInfo(service.settings.time_zone)
    first = since and (since if since.tzinfo else since.replace(tzinfo=zone))
    last = until and (until if until.tzinfo else until.replace(tzinfo=zone, hour=23, minute=59, second=59))
    beside = {one: service.fleet.place(session, name, one) for one in (others or ())[:OVER_IT]}
    return Window(first, last, {one: known.trend for one, known in beside.items() if known and known.trend})


TheWindow = Annotated[Window, Depends(window_of)]


@fleet_router.get("/axes/{name}/gearboxes")
@fleet_router.get("/axes/{name}/gearboxes/{gearbox:path}")
def gearbox_page(
    request: Request,
    session: Reading,
    service: TheService,
    _: PageViewer,
    window: TheWindow,
    name: str,
    gearbox: str = "",
    history: Annotated[int, Query(ge=0)] = 0,
    before: Annotated[str, Query(max_length=32)] = "",
    chart: Annotated[int | None, Query(ge=0)] = None,
) -> Response:
    """One gearbox: its state, its trend, what was heard of it and what was done to it.

    Args:
        history: which of the gearboxes that had this name, from 1; the last one where 0.
        before: the newest recordings before this one.
        chart: of the trend, whose numbers are wanted instead of the page.
    """
    known = service.fleet.place(session, name, gearbox or None)
    found = known.histories if known else ()
    if known is None or not found or history > len(found):
        if not is_axis(session, name):
            raise NotFoundError(unknown_axis(session, name))
        raise NotFoundError(f"no gearbox {gearbox!r} is known at axis {name!r}")
    shown = found[history - 1 if history else -1]
    trend = known.trend if shown.until is None else trend_of(session, shown)
    charts = charts_of(trend, shown, sizes_of(session, shown), window) if trend else []
    if chart is not None and chart < len(charts):
        return JSONResponse(charts[chart].document())
    at, zone = now(), service.settings.time_zone
    stands = standing(shown, trend, at, service.settings.silent_after) if shown.until is None else None
    heard = list(reversed(shown.heard))
    first = next((k + 1 for k, one in enumerate(heard) if one.recording_id == before), 0)
    page = heard[first : first + ROWS]
    document = diagnoses_of(session, [stands])[0]
    context = {
        "name": name,
        "gearbox": gearbox or None,
        "shown": shown,
        "others": [one for one in found if one.number != shown.number],
        "standing": stands,
        "badge": state_badge(stands, at) if stands else None,
        "why": why(stands, zone, document) if stands else None,
        "steps": next_steps(stands, document) if stands else (),
        "changed": trend_words(trend, zone),
        "at_once": question_of(shown, trend, zone),
        "evidence": evidence_words(trend) if trend else None,
        "charts": charts,
        "window": window,
        "query": request.url.query,
        "neighbours": [one for one in gearbox_names(session, name, most=ROWS) if one != gearbox] if trend else (),
        "heard": page,
        "older": page[-1].recording_id if first + ROWS < len(heard) else None,
        "investigations": investigations_of(session, shown),
        "day": lambda value: day(value, zone),
    }
    return render(request, "gearbox.html", context, section=FLEET)


def question_of(history: History, trend: Trend | None, zone: str) -> tuple[str, str] | None:
    """Return the day of a change at once, in words and as its form has the time; None where there is nothing to ask."""
    at_once = None if trend is None or history.until is not None else trend.at_once
    if at_once is None:
        return None
    return day(at_once.at, zone), f"{at_once.at.astimezone(ZoneInfo(zone)):%Y-%m-%dT%H:%M}"


def diagnoses_of(session: Session, standings: Sequence[Standing | None]) -> list[dict[str, Any] | None]:
    """Return for each gearbox the parts of the diagnosis that shows its state."""
    shown = [one.recording.diagnosis_id if one and one.recording else None for one in standings]
    ids = [each for each in shown if each]
    columns = (StoredDiagnosis.id, StoredDiagnosis.verdict, StoredDiagnosis.label, StoredDiagnosis.probability)
    parts = [StoredDiagnosis.document[name] for name in SAID_BY]  # a document is long
    rows = session.execute(select(*columns, *parts).where(StoredDiagnosis.id.in_(ids))) if ids else ()
    names = ("verdict", "label", "probability", *SAID_BY)
    documents = {identity: dict(zip(names, found, strict=True)) for identity, *found in rows}
    return [documents.get(each or "") for each in shown]


def sizes_of(session: Session, history: History) -> dict[str, dict[str, float]]:
    """Return the size of the fault that the diagnosis of a recording gives, by the recording's id."""
    size = StoredDiagnosis.document["severity"]
    rows = session.execute(
        select(StoredDiagnosis.recording_id, size)
        .join(StoredDiagnosis.recording)
        .where(StoredRecording.axis == history.axis, StoredRecording.gearbox == history.gearbox)
        .where(StoredDiagnosis.label.not_in(BASELINES))  # what is good has no size, and its document is long
        .order_by(StoredDiagnosis.id)
    )
    return {recording_id: found for recording_id, found in rows if found}


def investigations_of(session: Session, history: History) -> list[Headlined]:
    """Return the newest investigations of the axis while the gearbox was in it, with what each found."""
    while_in_it = [StoredInvestigation.axis == history.axis]
    while_in_it += [StoredInvestigation.created_at >= history.since] if history.since else []
    while_in_it += [StoredInvestigation.created_at < history.until] if history.until else []
    return newest(session, 10, *while_in_it)
