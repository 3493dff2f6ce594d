"""Alarms, for admins: what stands, rules, receivers, and what became of each message."""

from collections.abc import Mapping
from typing import Annotated, TypeVar

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from pydantic import BaseModel, ValidationError

from app.alarms.message import message_of
from app.api.alarms import ReceiverRequest, RuleRequest
from app.http.errors import Unprocessable, validation_problem
from app.report.words import VERDICTS
from app.service import Reading, Service, TheService
from app.web.page import FromOurPage, PageAdmin, lead, render
from casebase.alarms import outbox, rules

router = APIRouter(prefix="/alarms")
SECTION = "/alarms"
SHOWN = 50
Asked = TypeVar("Asked", bound=BaseModel)
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
    asked = _asked(ReceiverRequest, given)
    with service.library.transaction(principal.actor) as session:
        row = outbox.add_receiver(session, asked.name, asked.kind, asked.address, asked.quiet)
        secret = row.secret
    if secret is None:
        return _back(service)
    with service.library.reading() as session:
        context = _context(session, service, secret)
        return render(request, "alarms.html", context, principal=principal, section=SECTION)


@router.post("/receivers/{receiver_id}/test", dependencies=[FromOurPage])
def send_test(service: TheService, principal: PageAdmin, receiver_id: str) -> Response:
    """Send a test."""
    with service.library.transaction(principal.actor) as session:
        outbox.post_test(session, receiver_id)
    return _back(service, "#outbox")


@router.post("/receivers/{receiver_id}/remove", dependencies=[FromOurPage])
def remove_receiver(service: TheService, principal: PageAdmin, receiver_id: str) -> Response:
    """Remove a receiver that no rule names."""
    with service.library.transaction(principal.actor) as session:
        outbox.remove_receiver(session, receiver_id)
    return _back(service)


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
    asked = _asked(
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
    return _back(service)


@router.post("/rules/{rule_id}/remove", dependencies=[FromOurPage])
def remove_rule(service: TheService, principal: PageAdmin, rule_id: str) -> Response:
    """Remove a rule."""
    with service.library.transaction(principal.actor) as session:
        rules.remove_rule(session, rule_id)
    return _back(service)


@router.post("/deliveries/{delivery_id}/retry", dependencies=[FromOurPage])
def send_again(service: TheService, principal: PageAdmin, delivery_id: str) -> Response:
    """Send again what was given up."""
    with service.library.transaction(principal.actor) as session:
        outbox.send_again(session, delivery_id)
    return _back(service, "#outbox")


def _asked(model: type[Asked], given: Mapping[str, object]) -> Asked:
    try:
        return model.model_validate({name: value for name, value in given.items() if value not in ("", None)})
    except ValidationError as error:
        raise validation_problem(error.errors(include_url=False), "The form") from None


def _number(label: str, text: str) -> float | None:
    if not text.strip():
        return None
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise Unprocessable(f"{label} must be a number such as 2.5, got {text!r}.") from None


def _back(service: Service, anchor: str = "") -> Response:
    return lead(service, f"/alarms{anchor}")
