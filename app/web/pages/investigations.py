"""Model versus measurement: ask, follow, read the story, accept a better model."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse, Response
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.api.recordings import UNCHANGING
from app.http.errors import NotFound, Unprocessable
from app.http.headers import self_contained
from app.http.security import Principal, check_csrf
from app.http.uploads import TheUpload, Upload
from app.investigation_request import asked_of, axis_of
from app.investigations import (
    PARTS,
    accept,
    comparable,
    compared,
    document_of,
    get_investigation,
    names_of,
    submit,
)
from app.report.formatting import ENVIRONMENT, instant, style_sheet
from app.report.investigation_report import Part, Shown, box_shown, joints_of, of_robot, panels_of
from app.report.words import comparison_headline, finding_words, investigation_headline, likely_words, verdict_of
from app.service import Reading, TheJobs, TheService
from app.web.log_preview import log_preview, sound_preview
from app.web.page import (
    FromOurPage,
    Headlined,
    PageAdmin,
    PageOperator,
    PageViewer,
    headlined,
    lead,
    light,
    listing,
    render,
)
from casebase.axes import list_axes
from casebase.diagnoses import get_diagnosis
from casebase.store import revisions
from casebase.store.models import AxisRevision, RobotRevision, StoredInvestigation
from signals.columns.joint_maps import joint_map_template
from signals.columns.table_kinds import TEXT, binary_endings, table_kinds
from signals.telemetry import recognise_columns
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.errors import AxisError
from sim.investigation.report.box import box_of, box_of_robot, is_urgent, refused, rests_of_robot, unexplained_words
from sim.investigation.report.panels import SHOWS
from sim.investigation.unexplained import unexplained_of

router = APIRouter(prefix="/investigations")
SECTION = "/investigations"


@router.get("")
def investigation_list(request: Request, session: Reading, principal: PageViewer) -> Response:
    """Investigations, newest first."""
    subject = func.coalesce(StoredInvestigation.robot, StoredInvestigation.axis)
    columns = {"axis_or_robot": subject, "state": StoredInvestigation.state, "by": StoredInvestigation.created_by}
    found = listing(request, session, light(), **columns)
    context = {"list": found, "rows": headlined(session, found.rows)}
    return render(request, "investigations.html", context, principal=principal, section=SECTION)


@router.get("/new")
def ask_page(
    request: Request,
    session: Reading,
    principal: PageOperator,
    diagnosis: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """The form; started from a diagnosis its recording is the sound, and its axis is chosen."""
    recording = get_diagnosis(session, diagnosis).recording if diagnosis else None
    context = {
        "diagnosis": diagnosis,
        "recording": recording,
        "axes": [row.name for row in list_axes(session)],
        "robots": [row.name for row in revisions.current(session, RobotRevision)],
        "base_url": str(request.base_url).rstrip("/"),
        "robot_map": joint_map_template(6),
        "table_kinds": table_kinds(),
        "table_endings": ",".join((*TEXT, *binary_endings())),
        "binary_endings": ",".join(binary_endings()),
    }
    return render(request, "investigate.html", context, principal=principal, section=SECTION)


@router.post("/new")
def ask(request: Request, principal: PageOperator, upload: TheUpload, service: TheService, jobs: TheJobs) -> Response:
    """Queue an investigation and lead to its job."""
    check_csrf(request, upload.fields.get("csrf", ""))
    upload = upload.filled()
    name = upload.fields.get("axis_name", "").strip()
    robot = upload.fields.pop("robot_name", "").strip()
    if not {"axis", "robot", "urdf"} & {*upload.files}:
        if not name and not robot and not upload.fields.get("diagnosis"):
            raise Unprocessable("Choose a stored axis or robot, or send its axis.toml or robot.toml.")
        upload.fields.update({"axis": name} if name else {"robot": robot} if robot else {})
    _, take = asked_of(service, upload)
    question = take()
    with service.library.transaction(principal.actor) as session:
        identity = submit(service.library, session, jobs, question).id
    return lead(service, f"/jobs/{identity}")


@router.post("/columns")
def columns(request: Request, _: PageOperator, upload: TheUpload) -> Response:
    """What the columns of a table tell: a channel map, and what has to be filled in there."""
    check_csrf(request, upload.fields.get("csrf", ""))
    return JSONResponse(asdict(recognise_columns(upload.file("telemetry").path)))


@router.post("/preview")
def preview(request: Request, _: PageOperator, upload: TheUpload, service: TheService) -> Response:
    """Courses of a log, or of a sound, to be laid over each other; and what such a log can show."""
    check_csrf(request, upload.fields.get("csrf", ""))
    if "sound" in upload.files:
        return JSONResponse(sound_preview(upload.file("sound").path))
    axis = axis_of(service, upload) if _has_axis(upload) else None
    channels = upload.text("channels", service.settings.document_bytes).strip()
    return JSONResponse(log_preview(upload.file("telemetry").path, channels or None, axis))


def _has_axis(upload: Upload) -> bool:
    """Whether the form has an axis; that of a stored one stands where its description would."""
    if "axis" in upload.files and upload.file("axis").size:
        return True
    upload.files.pop("axis", None)
    upload.fields["axis"] = upload.fields.get("axis_name", "").strip()
    return bool(upload.fields["axis"])


@router.get("/{investigation_id}")
def story(request: Request, session: Reading, principal: PageViewer, investigation_id: str) -> Response:
    """What was found, told in order."""
    row = get_investigation(session, investigation_id)
    document: dict[str, Any] = row.document or {}
    told = document.get("story", {})
    if row.robot:
        return _robot_page(request, session, row, document, principal)
    context = {
        "row": row,
        "document": document,
        "headline": investigation_headline(document) if document else None,
        "box": box_of_row(row),
        "bar": bar_of(document),
        "shows": SHOWS,
        "likely_words": likely_words,
        "unexplained": unexplained_in_words(document),
        "overlay": panels_of(document, "overlay"),
        "residual": panels_of(document, "residual"),
        "sound": panels_of(document, "sound"),
        "candidates": told.get("candidates", ()),
        "checked": told.get("checked", ()),
        "not_examined": told.get("not_examined", ()),
        "diagnosed": diagnosis_words(session, row),
        "others": others_of(session, row),
        "accepted": session.scalars(select(AxisRevision).where(AxisRevision.investigation_id == row.id)).first(),
    }
    return render(request, "investigation.html", context, principal=principal, section=SECTION)


def others_of(session: Session, row: StoredInvestigation) -> list[Headlined]:
    """Return what a finished investigation can be compared with, and what each found."""
    if row.document is None:
        return []
    return headlined(session, comparable(session, row))


def diagnosis_words(session: Session, row: StoredInvestigation) -> str | None:
    """Say what the diagnosis said from which an investigation was started."""
    if row.diagnosis_id is None:
        return None
    return verdict_of(get_diagnosis(session, row.diagnosis_id).document).headline


def unexplained_in_words(document: Mapping[str, Any]) -> str:
    """Say what is left beside what was found; nothing where that is the verdict itself."""
    found = document.get("unexplained")
    return unexplained_words(unexplained_of(found)) if found and document["verdict"] != "unnamed" else ""


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


def _robot_page(
    request: Request, session: Session, row: StoredInvestigation, document: Mapping[str, Any], principal: Principal
) -> Response:
    accepted = session.scalars(select(RobotRevision).where(RobotRevision.investigation_id == row.id)).first()
    context: dict[str, Any] = {
        "row": row,
        "document": document,
        "accepted": accepted,
        "box": box_of_row(row),
        "bar": bar_of(document),
        "shows": SHOWS,
        "unexplained": "",
        "headline": None,
        "not_examined": (),
    }
    if document:
        context |= {
            "unexplained": rests_of_robot(document),
            "headline": investigation_headline(document),
            "finding_words": finding_words,
            "unexplained_words": lambda found: unexplained_words(unexplained_of(found)),
            "not_examined": document["remarks"],
            "others": others_of(session, row),
            "joints": joints_of(document),
            "robot_values": of_robot(document),
            "torques": panels_of(document, "overlay"),
        }
    return render(request, "robot.html", context, principal=principal, section=SECTION)


@router.get("/{investigation_id}/compare")
def compare(
    request: Request,
    session: Reading,
    principal: PageViewer,
    investigation_id: str,
    other: Annotated[str, Query(alias="with", max_length=32)],
) -> Response:
    """Two investigations of one axis or robot side by side."""
    found = compared(session, investigation_id, other)
    parts = [part for part in PARTS if names_of(found.before, part) or names_of(found.after, part)]
    context = {
        "before": found.before,
        "after": found.after,
        "headline": comparison_headline(found.rows),
        "other_description": found.other_description,
        "rows": found.rows,
        "values": found.values,
        "given": [
            (part.replace("_", " "), *(", ".join(names_of(row, part)) for row in (found.before, found.after)))
            for part in parts
        ],
    }
    return render(request, "compared.html", context, principal=principal, section=SECTION)


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
