"""Care of the library: its evaluation and review with edits, cases to simulate, cases carried in and out."""

from contextlib import ExitStack
from tempfile import TemporaryFile
from typing import Annotated, Literal

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response, StreamingResponse
from pydantic import Field
from sqlalchemy import select
from starlette.background import BackgroundTask

from app.api.jobs import SimulationRequest, campaign_of
from app.background_cache import Pending
from app.http.errors import Unprocessable
from app.recordings.bundle_import import order as order_import
from app.service import Reading, TheJobs, TheService
from app.simulated.generation import KIND as GENERATION
from app.web.forms import MOST_AT_ONCE, OurUpload, number_of
from app.web.page import ROWS, FromOurPage, Message, PageAdmin, PageViewer, lead, of_library, render, waiting_page
from casebase import review as care
from casebase.axes import get_axis, list_axes
from casebase.errors import NotFoundError
from casebase.search.case_filter import CaseFilter
from casebase.store.audio_store import read_chunks
from casebase.store.bundle import check_bundle, export_cases
from casebase.store.models import Artifact
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import LABELS, labels, labels_of

router = APIRouter(prefix="/library")
SECTION = "/library"
HOW = "Each gearbox is left out once, the library diagnoses it from the others."


@router.get("/review")
def review(
    request: Request, session: Reading, service: TheService, _: PageViewer, edit: int = 0, taken_back: int = 0
) -> Response:
    """The findings, worst first within each kind; edits are offered to admins and can be taken back as a whole."""
    found = service.review_soon(session)
    if isinstance(found, Pending):
        words = "Cases that contradict each other, that add nothing, and what is missing."
        basis = of_library(service, session)
        return waiting_page(request, found, title="Review", words=words, basis=basis, tab="/library/review")
    context = {
        "review": found,
        "shown": ROWS,
        "edits": session.scalars(
            select(Artifact).where(Artifact.kind == care.KIND).order_by(Artifact.version.desc()).limit(10)
        ).all(),
        "axes": [row.name for row in list_axes(session)],
    }
    said = f"Edit {edit} is done. It can be taken back below." if edit else f"Edit {taken_back} is taken back."
    messages = (Message(said),) if edit or taken_back else ()
    return render(request, "review.html", context, section=SECTION, messages=messages)


@router.post("/review", dependencies=[FromOurPage])
def edit(service: TheService, principal: PageAdmin, kind: Annotated[Literal["redundant", "far"], Form()]) -> Response:
    """Retire what is redundant or quarantine what is far, all together."""
    with service.library.transaction(principal.actor) as session:
        found = care.review(session, service.library.reuse.reasoner(session))
        version = care.apply(service.library, session, found, kind).version
    return lead(service, f"/library/review?edit={version}")


@router.post("/review/undo", dependencies=[FromOurPage])
def undo(service: TheService, principal: PageAdmin, version: Annotated[int, Form(ge=1, le=2**31 - 1)]) -> Response:
    """Take back the edits of a version."""
    with service.library.transaction(principal.actor) as session:
        care.undo(service.library, session, version)
    return lead(service, f"/library/review?taken_back={version}")


@router.get("/simulate")
def simulate_page(request: Request, session: Reading, _: PageAdmin, axis: str = "", label: str = "") -> Response:
    """How many cases of which label the simulator is to make for an axis: of any that its model can have."""
    axes = [row.name for row in list_axes(session)]
    if axis and axis not in axes:
        raise NotFoundError(f"no axis is described as {axis!r}, so it cannot be simulated; add it by POST /api/v1/axes")
    offered = labels_of(read_axis(get_axis(session, axis).document)) if axis else labels()
    usual = {one: 20 if label in ("", one) and (one in LABELS or label) else 0 for one in offered}
    given = {one: number_of(request, one) for one in offered}
    counts = {one: usual[one] if count is None else min(count, MOST_AT_ONCE) for one, count in given.items()}
    context = {
        "axes": axes,
        "axis": axis,
        "counts": counts,
        "usual": LABELS,
        "most": MOST_AT_ONCE,
        "not_simulated": label if label and label not in labels() else "",
        "no_place": label if label in labels() and label not in offered else "",
    }
    return render(request, "simulate.html", context, section=SECTION)


@router.post("/simulate", dependencies=[FromOurPage])
def simulate(
    service: TheService,
    jobs: TheJobs,
    principal: PageAdmin,
    axis: Annotated[str, Form()],
    count: Annotated[list[Annotated[int, Field(ge=0, le=MOST_AT_ONCE)]], Form()],
    label: Annotated[list[str] | None, Form()] = None,
) -> Response:
    """Queue it and lead to the job; counts are in the order of the labels, or of those that a simulation knows."""
    names = label or labels()[: len(count)]
    if len(count) != len(names) or not any(count):
        raise Unprocessable("Say how many cases of each label; at least one of one of them.")
    counts = {one: number for one, number in zip(names, count, strict=True) if number or one in LABELS}
    wanted = SimulationRequest(axis=axis, counts=counts)
    job_id = jobs.submit(GENERATION, campaign_of(service, wanted).to_document(), submitted_by=principal.actor)
    return lead(service, f"/jobs/{job_id}")


@router.get("/evaluation")
def evaluation(
    request: Request,
    session: Reading,
    service: TheService,
    _: PageViewer,
    origin: Literal["measured", "simulated", "both"] = "both",
) -> Response:
    """Leave-one-gearbox-out confusion matrix; its cells open the cases."""
    found = service.evaluation_soon(session, origin)
    if isinstance(found, Pending):
        basis = of_library(service, session)
        return waiting_page(request, found, title="Evaluation", words=HOW, basis=basis, tab="/library/evaluation")
    context = {"evaluation": found, "origin": origin, "labels": sorted(found.confusion), "how": HOW}
    return render(request, "evaluation.html", context, section=SECTION)


@router.get("/exchange")
def exchange(request: Request, _: PageAdmin) -> Response:
    """Forms of import and export."""
    return render(request, "exchange.html", {}, section=SECTION)


@router.get("/export.zip")
def export(session: Reading, service: TheService, _: PageAdmin, label: str = "", origin: str = "") -> Response:
    """The cases wanted as one bundle."""
    wanted = CaseFilter(label=label or None, origin=origin or None)
    with ExitStack() as stack:
        # it has no name: a kill leaves nothing
        target = stack.enter_context(TemporaryFile(dir=service.settings.data_dir))
        export_cases(service.library, session, target, wanted)
        target.seek(0)
        headers = {"Content-Disposition": 'attachment; filename="cases.zip"'}
        done = BackgroundTask(stack.pop_all().close)
    return StreamingResponse(read_chunks(target), headers=headers, media_type="application/zip", background=done)


@router.post("/import")
def take(principal: PageAdmin, upload: OurUpload, service: TheService) -> Response:
    """Order the import of a bundle."""
    file, library = upload.file("file"), service.library
    check_bundle(file.path)
    bundle = library.audio.content(file.path)
    with library.transaction(principal.actor) as session:
        job = order_import(library, session, service.jobs, bundle, file.name, principal.actor)
    return lead(service, f"/jobs/{job.id}")
