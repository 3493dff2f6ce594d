"""For admins: keys, the audit log, alarms with their rules, receivers and deliveries; jobs, for operators as well.

And for everybody: signing in with a key, and out.
"""

import csv
import io
import secrets
from collections import Counter
from collections.abc import Callable
from typing import Annotated, Literal

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.alarms.addresses import check_receiver
from app.alarms.message import message_of
from app.api.alarms import ReceiverRequest, RuleRequest
from app.axes import check_place
from app.documents import KeyRequest
from app.fleet import settle
from app.http import keys
from app.http.errors import Forbidden, NotAuthenticated, NotFound, Unprocessable
from app.http.keys import Role
from app.http.security import COOKIE, FORM_COOKIE, check_csrf, client_of, csrf_token, principal_of
from app.http.sessions import LASTS, end_session, open_session
from app.jobs.jobs import ORDERED, job_of
from app.report.formatting import WORDS
from app.report.words import investigation_headline
from app.service import Reading, Service, TheJobs, TheService, service_of
from app.web.forms import Fields, choices, number
from app.web.page import (
    ROWS,
    FromOurPage,
    Message,
    PageAdmin,
    PageOperator,
    PageViewer,
    Visitor,
    checked_form,
    lead,
    listing,
    render,
    root_of,
)
from app.web.pages.axes import in_words
from app.web.pages.investigations import box_of_row
from casebase.alarms import outbox, rules
from casebase.store import audit
from casebase.store.models import AuditEntry, StoredInvestigation, StoredJob, now

router = APIRouter()
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
alarms = APIRouter(prefix="/alarms")
ALARMS = "/alarms"
CHANGES: dict[tuple[str, str], tuple[Callable[[Session, str], object], str]] = {
    ("receivers", "test"): (outbox.post_test, "#outbox"),
    ("receivers", "remove"): (outbox.remove_receiver, ""),
    ("rules", "remove"): (rules.remove_rule, ""),
    ("deliveries", "retry"): (outbox.send_now, "#outbox"),
}
"""What is done to one row of the page, by what it is and what its button says: with it, and where it leads."""


@router.get("/jobs")
def job_list(request: Request, session: Reading, jobs: TheJobs, _: PageOperator) -> Response:
    """The jobs, newest first, and the workers that run them."""
    columns = {"kind": StoredJob.kind, "state": StoredJob.state, "by": StoredJob.submitted_by}
    found = listing(request, session, ORDERED, **columns)
    context = {"list": found, "rows": [job_of(row) for row in found.rows], "workers": jobs.workers()}
    return render(request, "jobs.html", context, section="/jobs")


@router.get("/jobs/{job_id}")
def job(request: Request, service: TheService, jobs: TheJobs, _: PageOperator, job_id: str) -> Response:
    """One job, live."""
    shown = jobs.get(job_id)
    with service.library.reading() as session:
        row = session.get(StoredInvestigation, job_id) if shown.kind == "investigations" else None
        document = row.document if row is not None else None
        found = {"headline": investigation_headline(document), "box": box_of_row(row)} if row and document else None
    return render(request, "job.html", {"job": shown, "found": found}, section="/jobs")


@router.post("/jobs/{job_id}/{verb}", dependencies=[FromOurPage])
def change_job(
    service: TheService, jobs: TheJobs, _: PageOperator, job_id: str, verb: Literal["cancel", "resume"]
) -> Response:
    """Stop it, and what is done stays; or go on with it."""
    jobs.cancel(job_id) if verb == "cancel" else jobs.resume(job_id)
    return lead(service, f"/jobs/{job_id}")


@router.get("/keys")
def key_list(request: Request, session: Reading, _: PageAdmin) -> Response:
    """Every key that was ever made, by name; never the keys themselves."""
    return _keys(request, session)


def _keys(request: Request, session: Session, made: str | None = None) -> Response:
    context = {"rows": keys.list_keys(session), "made": made, "roles": list(Role)}
    return render(request, "keys.html", context, section="/keys")


@router.post("/keys", dependencies=[FromOurPage])
def key_create(request: Request, service: TheService, principal: PageAdmin, fields: Fields) -> Response:
    """Make a key and show it, this once."""
    asked = checked_form(KeyRequest, fields)
    with service.library.transaction(principal.actor) as session:
        _, key = keys.create_key(session, name=asked.name, role=asked.role)
    with service.library.reading() as session:
        return _keys(request, session, key)


@router.post("/keys/{key_id}/revoke", dependencies=[FromOurPage])
def key_revoke(service: TheService, principal: PageAdmin, key_id: str, sure: Annotated[str, Form()] = "") -> Response:
    """Revoke a key for good."""
    if sure != "yes":
        raise Unprocessable("A key is revoked for good: tick the box that says so. Nothing was changed.")
    with service.library.transaction(principal.actor) as session:
        keys.revoke_key(session, key_id)
    return lead(service, "/keys")


@router.get("/docs")
def docs(request: Request, _: Visitor) -> Response:
    """The interface for programs: found, read and tried out, with the session of whoever is signed in."""
    return render(request, "docs.html", {"address": str(request.base_url).rstrip("/")})


@router.get("/audit")
def audit_log(request: Request, session: Reading, _: PageAdmin) -> Response:
    """Who did what to which, newest first."""
    columns = {"who": AuditEntry.actor, "what": AuditEntry.action, "subject": AuditEntry.subject_id}
    found = listing(request, session, select(AuditEntry), **columns)
    return render(request, "audit.html", {"list": found}, section="/audit")


@router.get("/audit.csv")
def audit_csv(session: Reading, _: PageAdmin) -> Response:
    """The whole log as CSV; no cell can become a formula."""
    target = io.StringIO()
    table = csv.writer(target)
    columns = ("actor", "action", "subject_kind", "subject_id", "before", "after", "request_id")
    table.writerow(["id", "at", *columns])
    last: int | None = None
    while rows := audit.entries(session, limit=1000, before_id=last):
        for row in rows:
            cells = [getattr(row, name) for name in columns]
            table.writerow([row.id, row.at.isoformat(), *("" if one is None else harmless(str(one)) for one in cells)])
        last = rows[-1].id
    headers = {"Content-Disposition": 'attachment; filename="audit.csv"'}
    return Response(target.getvalue(), media_type="text/csv; charset=utf-8", headers=headers)


def harmless(cell: str) -> str:
    """Return a cell that no spreadsheet takes for a formula.

    >>> harmless("=1+1"), harmless("notch")
    ("'=1+1", 'notch')
    """
    return f"'{cell}" if cell.startswith(FORMULA_STARTS) else cell


@alarms.get("")
def alarms_page(request: Request, session: Reading, service: TheService, _: PageAdmin) -> Response:
    """Everything about alarms on one page."""
    return _alarms(request, session, service)


def _alarms(request: Request, session: Session, service: Service, made: str | None = None) -> Response:
    settings = service.settings
    servers = {"email": ("GEARCASE_SMTP_URL", settings.smtp_url), "mqtt": ("GEARCASE_MQTT_URL", settings.mqtt_url)}
    deliveries = outbox.list_deliveries(session, limit=ROWS).items
    receivers = outbox.list_receivers(session)
    known, standing = rules.list_rules(session), rules.standing(session)
    places = {(alarm.axis, alarm.gearbox) for alarm in standing}
    whole = [] if service.fleet_soon(session) else service.fleet.gearboxes(session, now(), settings.silent_after)
    gearboxes = in_words(session, service, [row for row in whole if (row.axis, row.gearbox or "") in places])
    context = {
        "made": made,
        "standing": standing,
        "said": {(row.axis, row.gearbox or ""): (why, step) for row, _, why, step in gearboxes},
        "holding": Counter(alarm.rule_id for alarm in standing),
        "rules": known,
        "rule_names": {rule.id: rule.name for rule in known},
        "receivers": receivers,
        "receiver_names": {row.id: row.name for row in receivers},
        "shown_address": outbox.shown_address,
        "deliveries": [(row, message_of(row, settings.time_zone, settings.public_url).subject) for row in deliveries],
        "shown": ROWS,
        "kinds": WORDS["receivers"],
        "missing": {kind: name for kind, (name, url) in servers.items() if url is None},
        "labels": choices(label for label, _ in service.counts(session)),
    }
    return render(request, "alarms.html", context, section=ALARMS)


@alarms.post("/receivers", dependencies=[FromOurPage])
def create_receiver(request: Request, service: TheService, principal: PageAdmin, fields: Fields) -> Response:
    """Make a receiver; the secret of a webhook is shown this once."""
    asked = checked_form(ReceiverRequest, fields)
    check_receiver(service.settings, asked.kind, asked.address)
    with service.library.transaction(principal.actor) as session:
        row = outbox.add_receiver(session, asked.name, asked.kind, asked.address, asked.quiet)
        secret = row.secret
    if secret is None:
        return lead(service, ALARMS)
    with service.library.reading() as session:
        return _alarms(request, session, service, secret)


@alarms.post("/rules", dependencies=[FromOurPage])
def create_rule(
    service: TheService,
    principal: PageAdmin,
    fields: Fields,
    receivers: Annotated[list[str] | None, Form()] = None,
) -> Response:
    """Make a rule."""
    if not receivers:
        raise Unprocessable("Say who gets the message: tick a receiver. Without one, make one first.")
    numbers = {
        "least_probability": _number("How sure [%]", fields.get("least_probability"), 100),
        "least_size_rad": _number("The size [mrad]", fields.get("least_size_mrad"), 1000),
        "silent_days": _number("The days of silence", fields.get("silent_days")),
    }
    asked = checked_form(RuleRequest, {**fields, **numbers, "receivers": receivers})
    with service.library.transaction(principal.actor) as session:
        check_place(session, fields)
        rules.add_rule(session, asked.name, asked.condition(), asked.receivers)
    settle(service.library, service.fleet, at_once=True)
    return lead(service, ALARMS)


@alarms.post("/{noun}/{identity}/{verb}", dependencies=[FromOurPage])
def change_alarms(service: TheService, principal: PageAdmin, noun: str, identity: str, verb: str) -> Response:
    """Send a test to a receiver, or a message now; remove a receiver that no rule names, or a rule."""
    done = CHANGES.get((noun, verb))
    if done is None:
        raise NotFound(f"Nothing is called {verb!r} of {noun}.")
    with service.library.transaction(principal.actor) as session:
        done[0](session, identity)
    return lead(service, f"/alarms{done[1]}")


def _number(label: str, text: str | None, of_one: float = 1) -> float | None:
    return number(label, text) / of_one if text else None


def _local(path: str) -> str:
    """A path on this site, whatever was asked for."""
    return path if path.startswith("/") and not path.startswith(("//", "/\\")) else "/"


@router.get("/sign-in")
def sign_in_page(request: Request, _: Visitor, next: str = "/") -> Response:
    """Ask for a key."""
    return _form(request, next)


@router.post("/sign-in")
def sign_in(
    request: Request, key: Annotated[str, Form()], next: Annotated[str, Form()] = "/", csrf: Annotated[str, Form()] = ""
) -> Response:
    """Begin a session, whose token stands in a cookie that no script can read.

    The form's token keeps another site from signing somebody in with a key of its own, to see what is then sent.
    """
    if not request.cookies.get(FORM_COOKIE):
        raise Forbidden("The sign-in form comes with a cookie, which is missing. Open /sign-in and send its form.")
    check_csrf(request, csrf, FORM_COOKIE)
    service = service_of(request)
    try:
        principal = principal_of(service, key.strip(), client_of(request))
    except NotAuthenticated as error:
        notice = Message(str(error.detail), "bad")
        return _form(request, next, (notice,), status=401)
    with service.library.transaction(principal.actor) as session:
        token = open_session(session, principal.key_id, request.cookies.get(COOKIE, ""))
    return _with_cookie(request, lead(service, _local(next)), COOKIE, token, int(LASTS.total_seconds()))


def _form(request: Request, next: str, messages: tuple[Message, ...] = (), status: int = 200) -> Response:
    """Return the form, whose token belongs to a cookie that is made here where there is none."""
    token = request.cookies.get(FORM_COOKIE) or secrets.token_urlsafe(32)
    context = {"next": _local(next), "csrf": csrf_token(token)}
    answer = render(request, "sign_in.html", context, messages=messages, status=status)
    return _with_cookie(request, answer, FORM_COOKIE, token)


def _with_cookie(request: Request, answer: Response, name: str, value: str, max_age: int | None = None) -> Response:
    service = service_of(request)
    secure = service.settings.cookie_secure or request.url.scheme == "https"
    path = f"{root_of(service)}/"
    answer.set_cookie(name, value, max_age, path=path, httponly=True, samesite="strict", secure=secure)
    return answer


@router.post("/sign-out", dependencies=[FromOurPage])
def sign_out(request: Request, principal: PageViewer) -> Response:
    """End the session."""
    service = service_of(request)
    with service.library.transaction(principal.actor) as session:
        end_session(session, request.cookies[COOKIE], principal.key_id)
    answer = lead(service, "/")
    answer.delete_cookie(COOKIE, path=f"{root_of(service)}/")
    return answer
