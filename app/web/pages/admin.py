"""Jobs for operators: the list, one of them live, cancel and resume; keys and the audit log, for admins."""

import csv
import io
from typing import Annotated

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import Response

from app.documents import KeyRequest
from app.http import keys
from app.http.errors import Unprocessable
from app.http.keys import Role
from app.service import Reading, TheJobs, TheService
from app.web.page import FromOurPage, PageAdmin, PageOperator, checked_form, lead, render
from casebase.store import audit

router = APIRouter()
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
ENTRIES = 100
Before = Annotated[int | None, Query(ge=1, le=2**63 - 1)]


@router.get("/jobs")
def job_list(request: Request, jobs: TheJobs, principal: PageOperator) -> Response:
    """The newest jobs and the workers that run them."""
    context = {"rows": jobs.list(limit=100), "workers": jobs.workers()}
    return render(request, "jobs.html", context, principal=principal, section="/jobs")


@router.get("/jobs/{job_id}")
def job(request: Request, jobs: TheJobs, principal: PageOperator, job_id: str) -> Response:
    """One job, live."""
    return render(request, "job.html", {"job": jobs.get(job_id)}, principal=principal, section="/jobs")


@router.post("/jobs/{job_id}/cancel", dependencies=[FromOurPage])
def cancel(service: TheService, jobs: TheJobs, _: PageOperator, job_id: str) -> Response:
    """Stop it; what is done stays."""
    jobs.cancel(job_id)
    return lead(service, f"/jobs/{job_id}")


@router.post("/jobs/{job_id}/resume", dependencies=[FromOurPage])
def resume(service: TheService, jobs: TheJobs, _: PageOperator, job_id: str) -> Response:
    """Go on with it."""
    jobs.resume(job_id)
    return lead(service, f"/jobs/{job_id}")


@router.get("/keys")
def key_list(request: Request, session: Reading, principal: PageAdmin) -> Response:
    """Every key that was ever made, by name; never the keys themselves."""
    context = {"rows": keys.list_keys(session), "made": None, "roles": list(Role)}
    return render(request, "keys.html", context, principal=principal, section="/keys")


@router.post("/keys", dependencies=[FromOurPage])
def key_create(
    request: Request,
    service: TheService,
    principal: PageAdmin,
    name: Annotated[str, Form()],
    role: Annotated[str, Form()],
) -> Response:
    """Make a key and show it, this once."""
    if role not in list(Role):
        raise Unprocessable(f"The role must be one of {', '.join(Role)}, got {role!r}.")
    asked = checked_form(KeyRequest, {"name": name, "role": role})
    with service.library.transaction(principal.actor) as session:
        _, key = keys.create_key(session, name=asked.name, role=asked.role)
    with service.library.reading() as session:
        context = {"rows": keys.list_keys(session), "made": key, "roles": list(Role)}
        return render(request, "keys.html", context, principal=principal, section="/keys")


@router.post("/keys/{key_id}/revoke", dependencies=[FromOurPage])
def key_revoke(service: TheService, principal: PageAdmin, key_id: str, sure: Annotated[str, Form()] = "") -> Response:
    """Revoke a key for good."""
    if sure != "yes":
        raise Unprocessable("A key is revoked for good: tick the box that says so. Nothing was changed.")
    with service.library.transaction(principal.actor) as session:
        keys.revoke_key(session, key_id)
    return lead(service, "/keys")


@router.get("/audit")
def audit_log(request: Request, session: Reading, principal: PageAdmin, before: Before = None) -> Response:
    """Who did what to which, newest first."""
    rows = audit.entries(session, limit=ENTRIES, before_id=before)
    context = {"rows": rows, "older": rows[-1].id if len(rows) == ENTRIES else None}
    return render(request, "audit.html", context, principal=principal, section="/audit")


@router.get("/audit.csv")
def audit_csv(session: Reading, _: PageAdmin) -> Response:
    """The whole log as CSV; no cell can become a formula."""
    target = io.StringIO()
    table = csv.writer(target)
    table.writerow(["id", "at", "actor", "action", "subject_kind", "subject_id", "before", "after", "request_id"])
    last: int | None = None
    while rows := audit.entries(session, limit=1000, before_id=last):
        for row in rows:
            cells = (row.at.isoformat(), row.actor, row.action, row.subject_kind, row.subject_id)
            rest = (str(row.before), str(row.after), row.request_id or "")
            table.writerow([row.id, *(harmless(cell) for cell in (*cells, *rest))])
        last = rows[-1].id
    headers = {"Content-Disposition": 'attachment; filename="audit.csv"'}
    return Response(target.getvalue(), media_type="text/csv; charset=utf-8", headers=headers)


def harmless(cell: str) -> str:
    """Return a cell that no spreadsheet takes for a formula.

    >>> harmless("=1+1"), harmless("notch")
    ("'=1+1", 'notch')
    """
    return f"'{cell}" if cell.startswith(FORMULA_STARTS) else cell
