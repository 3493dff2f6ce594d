"""The library: cases in a table and on a map, coverage, one case with its history, several edited together."""

import json
from collections import Counter
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response
from numpy.typing import NDArray
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.errors import Unprocessable
from app.intake import take_in
from app.metadata import CaseMetadata, read_metadata
from app.security import check_csrf
from app.service import Reading, TheService
from app.uploads import TheUpload
from app.web.features import features_of
from app.web.pages.diagnoses import told
from app.web.recorded import chart_of
from app.web.session import FromOurPage, PageAdmin, PageViewer
from app.web.svg import Point, map_chart
from app.web.templating import Message, render
from casebase.case_table import CaseTable
from casebase.description import Labelling
from casebase.library import CaseFilter
from casebase.models import Case, StoredRecording
from casebase.signals.features import catalogue

router = APIRouter()
SECTION = "/library"
SHOWN_ON_MAP = 1500
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
    page = service.library.cases(session, wanted, limit=100, cursor=cursor)
    chosen = {"label": label, "origin": origin, "axis": axis, "gearbox": gearbox, "state": state}
    counts = service.library.counts(session)
    context = {
        "rows": page.items,
        "next_cursor": page.next_cursor,
        "chosen": chosen,
        "query": "&".join(f"{name}={value}" for name, value in chosen.items() if value),
        "labels": sorted({one for one, _ in counts}),
        "counts": sorted(counts.items()),
        "total": sum(counts.values()),
    }
    messages = (Message(f"{done} cases changed. Their history keeps what they were; restore brings them back."),)
    return render(
        request, "library.html", context, principal=principal, section=SECTION, messages=messages if done else ()
    )


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
                service.library.retire(session, one)
            elif action == "restore":
                service.library.restore(session, one)
            elif action == "label":
                service.library.revise(session, one, {"label": label.strip()})
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
        labelling = Labelling(metadata.label, verified_by=metadata.verified_by)
        case_id = service.library.retain(session, row, labelling).id
    return RedirectResponse(f"{service.settings.root_path.rstrip('/')}/cases/{case_id}", status_code=303)


@router.get("/library/map")
def library_map(
    request: Request, session: Reading, service: TheService, principal: PageViewer, recording: str = ""
) -> Response:
    """Every case as a point, alike ones near each other, with one recording among them if asked for."""
    asked = service.library.recording(session, recording) if recording else None
    table = service.library.reasoner(session).table
    query = features_of(session, recording) if recording else {}
    points, drawn, explained = placed(table, query, service.settings.root_path.rstrip("/"))
    chart = map_chart("Map of the library", points, drawn) if points else None
    context = {
        "chart": chart,
        "count": len(points),
        "all": len(table),
        "explained": explained,
        "labels": table.classes,
        "query": asked,
    }
    return render(request, "map.html", context, principal=principal, section=SECTION)


def placed(table: CaseTable, query: dict[str, float | None], root: str) -> tuple[list[Point], Point | None, float]:
    """Return the cases by their first two principal components, the query among them, and the share explained.

    Features are scaled by median and median absolute deviation; a missing value counts as the median.
    """
    if len(table) < 3:
        return [], None, 0.0
    known = catalogue()
    compared = np.array([name not in known or known[name].compared for name in table.names])
    values = table.values[:, compared].astype(np.float64)
    names = [name for name, used in zip(table.names, compared, strict=True) if used]
    middle = np.nan_to_num(np.nanmedian(values, axis=0))
    spread = np.nan_to_num(np.nanmedian(np.abs(values - middle), axis=0))
    used = spread > 0
    scaled = np.clip(np.nan_to_num((values - middle)[:, used] / spread[used]), -8, 8)
    centre = scaled.mean(axis=0)
    _, singular, axes = np.linalg.svd(scaled - centre, full_matrices=False)
    places = (scaled - centre) @ axes[:2].T
    step = -(-len(table) // SHOWN_ON_MAP)
    points = [_point(table, places, row, root) for row in range(0, len(table), step)]
    explained = float(np.sum(singular[:2] ** 2) / np.sum(singular**2))
    if not query:
        return points, None, explained
    vector = np.array([np.nan if query.get(name) is None else query[name] for name in names], dtype=np.float64)
    at = (np.clip(np.nan_to_num((vector - middle)[used] / spread[used]), -8, 8) - centre) @ axes[:2].T
    return points, Point(float(at[0]), float(at[1]), "query", "measured", "", "the recording asked for"), explained


def _point(table: CaseTable, places: NDArray[np.float64], row: int, root: str) -> Point:
    label, origin = str(table.labels[row]), str(table.origins[row])
    text = f"{label}, {origin}, gearbox {table.gearboxes[row] or 'not told'}"
    return Point(float(places[row, 0]), float(places[row, 1]), label, origin, f"{root}/cases/{table.ids[row]}", text)


@router.get("/library/coverage")
def coverage(request: Request, session: Reading, principal: PageViewer) -> Response:
    """How many cases there are of every label, per axis and origin, and where there are none."""
    context = {"rows": covered(session), "columns": ("measured", "simulated")}
    return render(request, "coverage.html", context, principal=principal, section=SECTION)


def covered(session: Session) -> list[tuple[str, str, int, int, int]]:
    """Return (axis, label, measured, simulated, gearboxes) for every axis and every label of the library."""
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
        counted[axis or "not told", label, origin] += count
        gearboxes[axis or "not told", label] += units
    axes = sorted({axis for axis, _, _ in counted})
    labels = sorted({label for _, label, _ in counted} | {"normal", "notch", "play"})
    return [
        (axis, label, counted[axis, label, "measured"], counted[axis, label, "simulated"], gearboxes[axis, label])
        for axis in axes
        for label in labels
    ]


@router.get("/cases/{case_id}")
def case(request: Request, session: Reading, service: TheService, principal: PageViewer, case_id: str) -> Response:
    """One case: what it sounds like, where it comes from, what happened to it."""
    row = service.library.case(session, case_id)
    known = catalogue()
    features = [
        (name, value, known[name].unit, known[name].physics)
        for name, value in features_of(session, row.recording_id).items()
        if name in known
    ]
    context = {
        "case": row,
        "recording": row.recording,
        "waveform": chart_of("waveform", session, service, row.recording),
        "spectrum": chart_of("spectrum", session, service, row.recording),
        "features": features,
        "history": service.library.history(session, case_id),
    }
    return render(request, "case.html", context, principal=principal, section=SECTION)
