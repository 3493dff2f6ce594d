"""Care of the library: how well it does on gearboxes it has not seen, and cases carried in and out."""

from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Literal

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response
from starlette.background import BackgroundTask

from app.background_cache import Pending
from app.http.security import check_csrf
from app.http.uploads import TheUpload
from app.service import Reading, TheService
from app.web.session import PageAdmin, PageViewer
from app.web.templating import render
from app.web.waiting import of_library, waiting_page
from casebase.search.case_filter import CaseFilter
from casebase.store.bundle import export_cases, import_cases

router = APIRouter(prefix="/library")
SECTION = "/library"
HOW = "Each gearbox is left out once, the library diagnoses it from the others."


@router.get("/evaluation")
def evaluation(
    request: Request,
    session: Reading,
    service: TheService,
    principal: PageViewer,
    origin: Literal["measured", "simulated", "both"] = "both",
) -> Response:
    """Leave-one-gearbox-out confusion matrix; its cells open the cases."""
    found = service.evaluation_soon(session, origin)
    if isinstance(found, Pending):
        basis = of_library(session, service)
        return waiting_page(request, principal, found, "Evaluation", HOW, basis, tab="/library/evaluation")
    context = {"evaluation": found, "origin": origin, "labels": sorted(found.confusion), "how": HOW}
    return render(request, "evaluation.html", context, principal=principal, section=SECTION)


@router.get("/exchange")
def exchange(request: Request, principal: PageAdmin) -> Response:
    """Forms of import and export."""
    return render(request, "exchange.html", {"imported": None}, principal=principal, section=SECTION)


@router.get("/export.zip")
def export(session: Reading, service: TheService, _: PageAdmin, label: str = "", origin: str = "") -> Response:
    """The cases wanted as one bundle."""
    folder = Path(mkdtemp(dir=service.settings.data_dir))
    target = folder / "cases.zip"
    export_cases(service.library, session, target, CaseFilter(label=label or None, origin=origin or None))
    return FileResponse(target, filename="cases.zip", background=BackgroundTask(rmtree, folder))


@router.post("/import")
def take(request: Request, principal: PageAdmin, upload: TheUpload, service: TheService) -> Response:
    """Take a bundle in."""
    check_csrf(request, upload.fields.get("csrf", ""))
    imported = import_cases(service.library, upload.file("file").path, principal.actor)
    return render(request, "exchange.html", {"imported": imported}, principal=principal, section=SECTION)
