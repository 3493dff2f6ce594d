"""Model versus measurement: ask, follow, read the story, accept a better model."""

from collections.abc import Mapping
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response
from sqlalchemy import func, select

from app.api.recordings import UNCHANGING
from app.http.errors import NotFound, Unprocessable
from app.http.headers import self_contained
from app.investigation_request import asked_of, axis_of, completed, given, offered
from app.investigations import PARTS, accept, comparable, compared, document_of, get_investigation, names_of, submit
from app.report.formatting import ENVIRONMENT, instant, style_sheet
from app.report.investigation_report import Part, Shown, box_shown, joints_of, of_robot, panels_of
from app.report.words import comparison_headline, finding_words, investigation_headline, likely_words, verdict_of
from app.service import Reading, TheJobs, TheService
from app.web.forms import OurUpload
from app.web.log_preview import log_preview, sound_preview
from app.web.page import FromOurPage, PageAdmin, PageOperator, PageViewer, headlined, lead, light, listing, render
from casebase.axes import list_axes
from casebase.diagnoses import get_diagnosis
from casebase.store import revisions
from casebase.store.models import AxisRevision, RobotRevision, StoredInvestigation
from signals.columns.table_kinds import TEXT, binary_endings, table_kinds
from signals.columns.units import units_of
from signals.telemetry import CHANNELS, TIME
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.errors import AxisError
from sim.investigation.report.box import box_of, box_of_robot, is_urgent, refused, rests_of_robot, unexplained_words
from sim.investigation.report.panels import SHOWS
from sim.investigation.unexplained import unexplained_of

router = APIRouter(prefix="/investigations")
SECTION = "/investigations"


@router.get("")
def investigation_list(request: Request, session: Reading, _: PageViewer) -> Response:
    """Investigations, newest first."""
    subject = func.coalesce(StoredInvestigation.robot, StoredInvestigation.axis)
    columns = {"axis_or_robot": subject, "state": StoredInvestigation.state, "by": StoredInvestigation.created_by}
    found = listing(request, session, light(), **columns)
    context = {"list": found, "rows": headlined(session, found.rows)}
    return render(request, "investigations.html", context, section=SECTION)


@router.get("/new")
def ask_page(
    request: Request,
    session: Reading,
    _: PageOperator,
    diagnosis: Annotated[str, Query(max_length=32)] = "",
    again: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """The form; started from a diagnosis its recording is the sound, and its axis is chosen; or filled with what was
    asked before, to be changed."""
    before = get_investigation(session, again) if again else None
    diagnosis = diagnosis or (before.diagnosis_id if before else None) or ""
    context = {
        "diagnosis": diagnosis,
        "recording": get_diagnosis(session, diagnosis).recording if diagnosis else None,
        "before": before,
        "files": [name for part in PARTS if before for name in names_of(before, part)],
        "axes": [row.name for row in list_axes(session)],
        "robots": [row.name for row in revisions.current(session, RobotRevision)],
        "units": {name: units_of(name) for name in (TIME, *CHANNELS)},
        "table_kinds": table_kinds(),
        "table_endings": ",".join((*TEXT, *binary_endings())),
    }
    return render(request, "investigate.html", context, section=SECTION)


@router.post("/new")
def ask(principal: PageOperator, upload: OurUpload, service: TheService, jobs: TheJobs) -> Response:
    """Queue an investigation and lead to its job."""
    upload = completed(service, upload)
    if not given(upload, "axis", "robot", "urdf", "diagnosis"):
        raise Unprocessable("Choose an axis or a robot, or send its axis.toml or robot.toml.")
    _, take = asked_of(service, upload)
    question = take()
    with service.library.transaction(principal.actor) as session:
        identity = submit(service.library, session, jobs, question).id
    return lead(service, f"/jobs/{identity}")


@router.post("/columns")
def columns(_: PageOperator, upload: OurUpload, service: TheService) -> Response:
    """What each column of a log looks like, and which channel it is by the map that is offered for it."""
    return JSONResponse(offered(service, completed(service, upload)))


@router.post("/preview")
def preview(_: PageOperator, upload: OurUpload, service: TheService) -> Response:
    """Courses of a log, or of a sound, to be laid over each other; and what such a log can show."""
    upload = completed(service, upload)
    if "telemetry" not in upload.files:
        return JSONResponse(sound_preview(upload.file("sound").path))
    axis = axis_of(service, upload) if given(upload, "axis") else None
    channels = upload.text("channels", service.settings.document_bytes).strip()
    return JSONResponse(log_preview(upload.file("telemetry").path, channels or None, axis))


@router.get("/{investigation_id}")
def story(request: Request, session: Reading, _: PageViewer, investigation_id: str) -> Response:
    """What was found, told in order."""
    row = get_investigation(session, investigation_id)
    document: dict[str, Any] = row.document or {}
    revision, limits = RobotRevision if row.robot else AxisRevision, document.get("limits", ())
    context: dict[str, Any] = {
        "row": row,
        "document": document,
        "headline": investigation_headline(document) if document else None,
        "box": box_of_row(row),
        "limits": limits,
        "bar": bar_of(document),
        "heard": "sound" in row.inputs and "telemetry" not in row.inputs,
        "diagnosed": None,
        "shows": SHOWS,
        "overlay": panels_of(document, "overlay"),
        "others": headlined(session, comparable(session, row)) if document else [],
        "accepted": session.scalars(select(revision).where(revision.investigation_id == row.id)).first(),
    }
    if row.robot:
        context |= {
            "unexplained": rests_of_robot(document) if document else "",
            "finding_words": finding_words,
            "unexplained_words": lambda found: unexplained_words(unexplained_of(found)),
            "not_examined": [one for one in document.get("remarks", ()) if one not in limits],
            "joints": joints_of(document) if document else (),
            "robot_values": of_robot(document) if document else (),
        }
        return render(request, "robot.html", context, section=SECTION)
    told = document.get("story", {})
    rest = document.get("unexplained") if document and document["verdict"] != "unnamed" else None
    diagnosed = get_diagnosis(session, row.diagnosis_id) if row.diagnosis_id else None
    context |= {
        "likely_words": likely_words,
        "unexplained": unexplained_words(unexplained_of(rest)) if rest else "",
        "residual": panels_of(document, "residual"),
        "sound": panels_of(document, "sound"),
        "candidates": told.get("candidates", ()),
        "checked": told.get("checked", ()),
        "not_examined": [one for one in told.get("not_examined", ()) if one not in limits],
        "diagnosed": verdict_of(diagnosed.document).headline if diagnosed else None,
    }
    return render(request, "investigation.html", context, section=SECTION)


def box_of_row(row: StoredInvestigation) -> list[Shown]:
    """Return what a technician reads first; of one that is at work, nothing."""
    if row.error is not None:
        return [Shown(refused(row.error))]
    if row.document is None:
        return []
    if row.robot:
        return box_shown(row.document, box_of_robot(row.document))
    return box_shown(row.document, box_of(row.document, described(row)))


def bar_of(document: Mapping[str, Any]) -> str:
    """Return the class of the bar beside the box: red where something is urgent, green where nothing was found."""
    if document and document["verdict"] == "nothing_missing":
        return "normal"
    return "notch" if document and is_urgent(document) else "unknown"


def described(row: StoredInvestigation) -> Axis | None:
    """Return the axis as it was described; None where this version does not read it any more."""
    try:
        return read_axis(row.axis_document)
    except AxisError:
        return None


@router.get("/{investigation_id}/compare")
def compare(
    request: Request,
    session: Reading,
    _: PageViewer,
    investigation_id: str,
    other: Annotated[str, Query(alias="with", max_length=32)],
) -> Response:
    """Two investigations of one axis or robot side by side."""
    found = compared(session, investigation_id, other)
    parts = [part for part in PARTS if names_of(found.before, part) or names_of(found.after, part)]
    context = {
        **vars(found),
        "other_description": found.other_description,
        "headline": comparison_headline(found.rows),
        "given": [
            (part.replace("_", " "), *(", ".join(names_of(row, part)) for row in (found.before, found.after)))
            for part in parts
        ],
    }
    return render(request, "compared.html", context, section=SECTION)


@router.get("/{investigation_id}/panels/{part}/{number}")
def panel(session: Reading, _: PageViewer, investigation_id: str, part: Part, number: int) -> Response:
    """Numbers of one panel, for the interactive drawing."""
    document = document_of(get_investigation(session, investigation_id))
    panels = panels_of(document, part)
    if not 0 <= number < len(panels):
        raise NotFound(f"This investigation has {len(panels)} panels of its {part}.")
    return JSONResponse(panels[number].document(), headers=UNCHANGING)


@router.get("/{investigation_id}/report.html")
def report(session: Reading, _: PageViewer, investigation_id: str) -> Response:
    """The report with all plots, as one file."""
    row = get_investigation(session, investigation_id)
    document_of(row)
    return self_contained(row.report or "", "'self'", **{"X-Frame-Options": "SAMEORIGIN"})


@router.get("/{investigation_id}/work-sheet")
def work_sheet(session: Reading, service: TheService, _: PageViewer, investigation_id: str) -> Response:
    """A page of paper to take to the machine, as one file: the box, its plot, what to check, who signs."""
    row = get_investigation(session, investigation_id)
    document, box = document_of(row), box_of_row(row)
    when = instant(row.created_at, service.settings.time_zone).striptags()
    steps = [one.entry.do_first for one in box]
    steps += [f"Measure next: {document['next_measurement']}"] if document["next_measurement"] else []
    context = {
        "row": row,
        "measured": " · ".join([str(row.subject), when, *(name for part in PARTS for name in names_of(row, part))]),
        "headline": investigation_headline(document),
        "limits": document.get("limits", ()),
        "box": box,
        "checks": list(dict.fromkeys(steps)),
        "chart": next((one.chart for one in box if one.chart is not None), None),
        "style": style_sheet(),
    }
    return self_contained(ENVIRONMENT.get_template("work_sheet.html").render(context))


@router.post("/{investigation_id}/accept", dependencies=[FromOurPage])
def take_over(service: TheService, principal: PageAdmin, investigation_id: str) -> Response:
    """Store the extended axis or robot as its next revision."""
    with service.library.transaction(principal.actor) as session:
        row = accept(service.library, session, get_investigation(session, investigation_id))
        place = f"{row.__tablename__}/{quote(row.name, safe='')}"
    return lead(service, f"/{place}")
