"""Jobs: the list, one of them live, cancel and resume."""

from fastapi import APIRouter, Request
from fastapi.responses import RedirectResponse, Response

from app.service import TheJobs, TheService
from app.web.session import FromOurPage, PageOperator
from app.web.templating import render

router = APIRouter(prefix="/jobs")
SECTION = "/jobs"


@router.get("")
def job_list(request: Request, jobs: TheJobs, principal: PageOperator) -> Response:
    """The newest jobs and the workers that run them."""
    context = {"rows": jobs.list(limit=100), "workers": jobs.workers()}
    return render(request, "jobs.html", context, principal=principal, section=SECTION)


@router.get("/{job_id}")
def job(request: Request, jobs: TheJobs, principal: PageOperator, job_id: str) -> Response:
    """One job, live."""
    return render(request, "job.html", {"job": jobs.get(job_id)}, principal=principal, section=SECTION)


@router.post("/{job_id}/cancel", dependencies=[FromOurPage])
def cancel(service: TheService, jobs: TheJobs, _: PageOperator, job_id: str) -> Response:
    """Stop it; what is done stays."""
    jobs.cancel(job_id)
    return RedirectResponse(f"{service.settings.root_path.rstrip('/')}/jobs/{job_id}", status_code=303)


@router.post("/{job_id}/resume", dependencies=[FromOurPage])
def resume(service: TheService, jobs: TheJobs, _: PageOperator, job_id: str) -> Response:
    """Go on with it."""
    jobs.resume(job_id)
    return RedirectResponse(f"{service.settings.root_path.rstrip('/')}/jobs/{job_id}", status_code=303)
