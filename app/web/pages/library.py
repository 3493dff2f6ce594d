"""The library: cases in a table and on a map, coverage, one case with its history, several edited together."""

import json
from collections import Counter
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.errors import Unprocessable
from app.gate import Looking
from app.intake import take_in
from app.metadata import CaseMetadata, read_metadata
from app.security import check_csrf
from app.service import Reading, TheService
from app.uploads import TheUpload
from app.web.counted import counted, counts_of
from app.web.features import features_of
from app.web.label_table import damage_of, mechanism_rows, other_rows
from app.web.map import projected
from app.web.pages.diagnoses import told
from app.web.recorded import chart_of
from app.web.session import FromOurPage, PageAdmin, PageViewer
from app.web.svg import map_chart
from app.web.templating import Message, render, sentence
from casebase.axes import find_axis, is_axis, unknown_axis
from casebase.case_filter import CaseFilter
from casebase.models import Case, StoredRecording
from casebase.origins import MEASURED
from casebase.signals.features import catalogue

router = APIRouter()
SECTION = "/library"
AXES_AND_LABELS = 400


@router.get("/library")
def cases(
    request: Request,
    session: Reading,
    service: TheService,
    principal: PageViewer,
    label: str = "",
    origin: str = "",
    axis: str = "",
    gearbox: str = "",
    state: str = "",
    cursor: str | None = None,
    done: int = 0,
) -> Response:
    """The cases, newest first, by label, axis, gearbox, origin and state."""
    wanted = CaseFilter(label or None, origin or None, axis or None, gearbox or None, state or None)
    page = service.library.retrieve.cases(session, wanted, limit=100, cursor=cursor)
    chosen = {"label": label, "origin": origin, "axis": axis, "gearbox": gearbox, "state": state}
    counts = counts_of(service.library, session)
    context = {
        "rows": page.items,
        "next_cursor": page.next_cursor,
        "chosen": chosen,
        "query": "&".join(f"{name}={value}" for name, value in chosen.items() if value),
        "labels": sorted({one for one, _ in counts}),
        "counts": sorted(counts.items()),
        "total": sum(counts.values()),
    }
    messages = []
    if done:
        messages.append(Message(changed_words(done)))
    if axis and not is_axis(session, axis):
        messages.append(Message(sentence(unknown_axis(session, axis)), "warn"))
    return render(request, "library.html", context, principal=principal, section=SECTION, messages=tuple(messages))


def changed_words(count: int) -> str:
    """Say how many cases were changed.

    >>> changed_words(1)
    "1 case changed. Its page shows what it was; 'Restore' brings back a retired case."
    """
    cases, page = ("case", "Its page shows what it was") if count == 1 else ("cases", "Their pages show what they were")
    return f"{count} {cases} changed. {page}; 'Restore' brings back a retired case."


@router.post("/library/change", dependencies=[FromOurPage])
def change_several(
    service: TheService,
    principal: PageAdmin,
    action: Annotated[str, Form()],
    case_id: Annotated[list[str] | None, Form()] = None,
    label: Annotated[str, Form()] = "",
) -> Response:
    """Retire, restore or label all chosen cases together, or none of them."""
    chosen = case_id or []
    if not chosen:
        raise Unprocessable("No case was chosen: tick the cases first.")
    with service.library.transaction(principal.actor) as session:
        for one in chosen:
            if action == "retire":
                service.library.revise.retire(session, one)
            elif action == "restore":
                service.library.revise.restore(session, one)
            elif action == "label":
                service.library.revise.case(session, one, {"label": label.strip()})
            else:
                raise Unprocessable(f"Unknown action {action!r}; known: retire, restore, label.")
    root = service.settings.root_path.rstrip("/")
    return RedirectResponse(f"{root}/library?done={len(chosen)}", status_code=303)


@router.get("/library/add")
def add_page(request: Request, principal: PageAdmin) -> Response:
    """The form of a new case."""
    return render(request, "add_case.html", {}, principal=principal, section=SECTION)


@router.post("/library/add")
def add(request: Request, principal: PageAdmin, upload: TheUpload, service: TheService) -> Response:
    """Take a labelled recording in."""
    check_csrf(request, upload.fields.get("csrf", ""))
    metadata = read_metadata(json.dumps(told(upload.fields, "label", "verified_by")), CaseMetadata)
    file = upload.file("file")
    intake = take_in(service.library, file.path, file.name, file.media_type, metadata)
    with service.library.transaction(principal.actor) as session:
        row = intake.store(service.library, session)
        labelling = metadata.labelling()
        case_id = service.library.retain.case(session, row, labelling).id
    return RedirectResponse(f"{service.settings.root_path.rstrip('/')}/cases/{case_id}", status_code=303)


@router.get("/library/map")
def library_map(
    request: Request, session: Reading, service: TheService, principal: PageViewer, recording: str = ""
) -> Response:
    """Every case as a point, alike ones near each other, with one recording among them if asked for."""
    asked = service.library.retrieve.recording(session, recording) if recording else None
    library = service.library
    projection = counted(library, session, "map", lambda: projected(library.retrieve.table(session)))
    root = service.settings.root_path.rstrip("/")
    points = projection.points(root) if projection else []
    query = projection.place(features_of(session, recording)) if projection and recording else None
    context = {
        "chart": map_chart("Map of the library", points, query, projection.titles) if projection else None,
        "count": len(points),
        "all": len(projection.table) if projection else 0,
        "labels": projection.table.classes if projection else (),
        "query": asked,
    }
    return render(request, "map.html", context, principal=principal, section=SECTION)


@router.get("/library/labels")
def label_list(request: Request, session: Reading, service: TheService, principal: PageViewer) -> Response:
    """Mechanisms and labels beside each other, with the names of ISO 10825-1."""
    counts = counts_of(service.library, session)
    context = {"mechanisms": mechanism_rows(counts), "others": other_rows(counts)}
    return render(request, "labels.html", context, principal=principal, section=SECTION)


@router.get("/library/coverage")
def coverage(request: Request, session: Reading, service: TheService, principal: PageViewer) -> Response:
    """How many cases there are of every label, per axis and origin, and where there are none."""
    context = {"rows": counted(service.library, session, "coverage", lambda: covered(session))}
    return render(request, "coverage.html", context, principal=principal, section=SECTION)


def covered(session: Session) -> list[tuple[str, str, int, int, int]]:
    """Return (axis, label, measured, simulated, measured gearboxes) for every axis and every label of the library."""
    statement = (
        select(
            StoredRecording.axis, Case.label, Case.origin, func.count(), func.count(StoredRecording.gearbox.distinct())
        )
        .join(StoredRecording, StoredRecording.id == Case.recording_id)
        .where(Case.state == "confirmed", Case.quarantine_reason.is_(None))
        .group_by(StoredRecording.axis, Case.label, Case.origin)
        .limit(AXES_AND_LABELS)
    )
    counted: Counter[tuple[str, str, str]] = Counter()
    gearboxes: Counter[tuple[str, str]] = Counter()
    for axis, label, origin, count, units in session.execute(statement).all():
        counted[axis or "not given", label, origin] += count
        gearboxes[axis or "not given", label] += units if origin == MEASURED else 0
    axes = sorted({axis for axis, _, _ in counted})
    labels = sorted({label for _, label, _ in counted} | {"normal", "notch", "play"})
    return [
        (axis, label, counted[axis, label, "measured"], counted[axis, label, "simulated"], gearboxes[axis, label])
        for axis in axes
        for label in labels
    ]


@router.get("/cases/{case_id}", dependencies=[Looking])
def case(request: Request, session: Reading, service: TheService, principal: PageViewer, case_id: str) -> Response:
    """One case: what it sounds like, where it comes from, what happened to it."""
    row = service.library.retrieve.case(session, case_id)
    known, erased = catalogue(), row.recording.erased_at is not None
    features = [
        (name, value, known[name].unit, known[name].physics)
        for name, value in features_of(session, row.recording_id).items()
        if name in known
    ]
    context = {
        "case": row,
        "recording": row.recording,
        "waveform": None if erased else chart_of("waveform", session, service, row.recording),
        "spectrum": None if erased else chart_of("spectrum", session, service, row.recording),
        "features": features,
        "damage": damage_of(row.label),
        "history": service.library.retrieve.history(session, case_id),
        "described": row.recording.axis is None or find_axis(session, row.recording.axis) is not None,
    }
    return render(request, "case.html", context, principal=principal, section=SECTION)
