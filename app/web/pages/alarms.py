"""Alarms, for admins: what stands, rules, receivers, and what became of each message."""

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from sqlalchemy.orm import Session

from app.alarms.message import message_of
from app.api.alarms import ReceiverRequest, RuleRequest
from app.http.errors import NotFound, Unprocessable
from app.report.words import VERDICTS
from app.service import Reading, Service, TheService
from app.web.page import FromOurPage, PageAdmin, checked_form, lead, render
from app.web.pages.diagnoses import number
from casebase.alarms import outbox, rules

router = APIRouter(prefix="/alarms")
SECTION = "/alarms"
SHOWN = 50
CHANGES: dict[tuple[str, str], tuple[Callable[[Session, str], object], str]] = {
    ("receivers", "test"): (outbox.post_test, "#outbox"),
    ("receivers", "remove"): (outbox.remove_receiver, ""),
    ("rules", "remove"): (rules.remove_rule, ""),
    ("deliveries", "retry"): (outbox.send_again, "#outbox"),
}
"""What is done to one row of the page, by what it is and what its button says: with it, and where it leads."""
OptionalText = Annotated[str, Form()]


@router.get("")
def page(request: Request, session: Reading, service: TheService, principal: PageAdmin) -> Response:
    """Everything about alarms on one page."""
    return render(request, "alarms.html", _context(session, service), principal=principal, section=SECTION)


def _context(session: Reading, service: Service, made: str | None = None) -> dict[str, object]:
    settings = service.settings
    servers = {"GEARCASE_SMTP_URL": settings.smtp_url, "GEARCASE_MQTT_URL": settings.mqtt_url}
    deliveries = outbox.list_deliveries(session, limit=SHOWN).items
    receivers = outbox.list_receivers(session)
    known = rules.list_rules(session)
    return {
        "made": made,
        "standing": rules.standing(session),
        "rules": known,
        "rule_names": {rule.id: rule.name for rule in known},
        "receivers": receivers,
        "receiver_names": {row.id: row.name for row in receivers},
        "shown_address": outbox.shown_address,
        "deliveries": [(row, message_of(row, settings.time_zone, settings.public_url).subject) for row in deliveries],
        "shown": SHOWN,
        "verdicts": VERDICTS,
        "kinds": {"email": "E-mail", "webhook": "Webhook", "mqtt": "MQTT"},
        "missing": [name for name, url in servers.items() if url is None],
    }


@router.post("/receivers", dependencies=[FromOurPage])
def create_receiver(
    request: Request,
    service: TheService,
    principal: PageAdmin,
    name: Annotated[str, Form()],
    kind: Annotated[str, Form()],
    address: Annotated[str, Form()],
    quiet_from: OptionalText = "",
    quiet_to: OptionalText = "",
) -> Response:
    """Make a receiver; the secret of a webhook is shown this once."""
    given = {"name": name, "kind": kind, "address": address.strip(), "quiet_from": quiet_from, "quiet_to": quiet_to}
    asked = checked_form(ReceiverRequest, given)
    with service.library.transaction(principal.actor) as session:
        row = outbox.add_receiver(session, asked.name, asked.kind, asked.address, asked.quiet)
        secret = row.secret
    if secret is None:
        return lead(service, SECTION)
    with service.library.reading() as session:
        context = _context(session, service, secret)
        return render(request, "alarms.html", context, principal=principal, section=SECTION)


@router.post("/rules", dependencies=[FromOurPage])
def create_rule(
    service: TheService,
    principal: PageAdmin,
    name: Annotated[str, Form()],
    kind: Annotated[str, Form()],
    receivers: Annotated[list[str] | None, Form()] = None,
    axis: OptionalText = "",
    gearbox: OptionalText = "",
    verdict: OptionalText = "",
    label: OptionalText = "",
    least_probability: OptionalText = "",
    least_size_mrad: OptionalText = "",
    silent_days: OptionalText = "",
) -> Response:
    """Make a rule."""
    if not receivers:
        raise Unprocessable("Say who is told: tick a receiver. Without one, make one first.")
    per_cent, mrad = _number("How sure [%]", least_probability), _number("The size [mrad]", least_size_mrad)
    asked = checked_form(
        RuleRequest,
        {
            "name": name,
            "kind": kind,
            "receivers": receivers,
            "axis": axis.strip(),
            "gearbox": gearbox.strip(),
            "verdict": verdict,
            "label": label.strip(),
            "least_probability": None if per_cent is None else per_cent / 100,
            "least_size_rad": None if mrad is None else mrad / 1000,
            "silent_days": _number("The days of silence", silent_days),
        },
    )
    with service.library.transaction(principal.actor) as session:
        rules.add_rule(session, asked.name, asked.condition(), asked.receivers)
    return lead(service, SECTION)


@router.post("/{noun}/{identity}/{verb}", dependencies=[FromOurPage])
def change(service: TheService, principal: PageAdmin, noun: str, identity: str, verb: str) -> Response:
    """Send a test to a receiver or what was given up again; remove a receiver that no rule names, or a rule."""
    done = CHANGES.get((noun, verb))
    if done is None:
        raise NotFound(f"Nothing is called {verb!r} of {noun}.")
    with service.library.transaction(principal.actor) as session:
        done[0](session, identity)
    return lead(service, f"/alarms{done[1]}")


def _number(label: str, text: str) -> float | None:
    return number(label, text) if text.strip() else None
