"""Alarms: rules over gearboxes, receivers of their messages, and the outbox."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response, status
from pydantic import Field, StringConstraints
from sqlalchemy.orm import Session

from app.alarms.addresses import check_receiver
from app.documents import Answer, Cursor, Identifier, Instant, Limit, PageOf, Question, page_of
from app.fleet import settle
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin
from app.service import Reading, TheService
from casebase.alarms import outbox, rules
from casebase.store.fields import AxisName, Label, Positive, Word
from casebase.store.models import AlarmReceiver, AlarmRule, Delivery

router = APIRouter(prefix="/alarms", tags=["alarms"])

Clock = Annotated[str, StringConstraints(pattern=r"^([01][0-9]|2[0-3]):[0-5][0-9]$")]
Id = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{32}$")]
ReceiverKind = Literal["email", "webhook", "mqtt"]
RuleKind = Literal["state", "change", "silence"]
StateFilter = Annotated[
    Literal["waiting", "sent", "failed"] | None, Query(description="only those; failed: no further attempt is made")
]


class ReceiverRequest(
    Question,
    json_schema_extra={
        "examples": [{"name": "maintenance team", "kind": "email", "address": "maintenance@example.com"}]
    },
):
    """Where messages are to go."""

    name: Word = Field(description="who or what it is")
    kind: ReceiverKind = Field(description="how it is reached")
    address: Annotated[str, StringConstraints(min_length=1, max_length=2000)] = Field(
        description="an e-mail address, the URL of a webhook, or an MQTT topic"
    )
    quiet_from: Clock | None = Field(None, description="quiet hours, in the time of the site")
    quiet_to: Clock | None = Field(None, description="when they end; messages wait for it")

    @property
    def quiet(self) -> tuple[str, str] | None:
        if self.quiet_from is None and self.quiet_to is None:
            return None
        return self.quiet_from or "", self.quiet_to or ""


class ReceiverAnswer(Answer, of=AlarmReceiver, without=("secret",)):
    """A receiver as it is shown: of a webhook no more than its host, and never its secret."""

    kind: ReceiverKind

    @classmethod
    def of(cls, row: AlarmReceiver) -> "ReceiverAnswer":
        return cls.model_validate(row).model_copy(update={"address": outbox.shown_address(row)})


class NewReceiver(ReceiverAnswer):
    secret: str | None = Field(
        description="of a webhook: what signs its messages, this once; null when an Idempotency-Key is repeated"
    )


class RuleRequest(
    Question,
    json_schema_extra={
        "examples": [{"name": "any fault", "kind": "state", "least_probability": 0.9, "receivers": ["0" * 32]}]
    },
):
    """What is to be told: a state of a gearbox, a change of its sound, or its silence."""

    name: Word = Field(description="what it is called in messages")
    kind: RuleKind = Field(
        description="state: a fault stands, or the newest diagnosis has a verdict; change: it sounds otherwise than it "
        "did; silence: not heard"
    )
    axis: AxisName | None = Field(None, description="only of this axis")
    gearbox: Word | None = Field(None, description="only of this gearbox")
    verdict: Literal["diagnosed", "ambiguous", "not_in_library", "unusable"] | None = Field(
        None, description="of a state: the verdict; a fault that was diagnosed where not given"
    )
    label: Label | None = Field(None, description="of a fault: which one; any where not given")
    least_probability: Annotated[float, Field(ge=0, le=1)] | None = Field(
        None, description="of a fault: no less than this"
    )
    least_size_rad: Positive | None = Field(
        None, description="of a fault: no smaller than this, at the driven gear [rad]"
    )
    silent_days: Annotated[float, Field(gt=0, le=3650)] | None = Field(
        None, description="of silence: not heard for so long [d]"
    )
    receivers: Annotated[list[Id], Field(min_length=1, max_length=50)] = Field(description="ids of who is told")

    def condition(self) -> rules.Condition:
        return rules.Condition(**self.model_dump(exclude={"name", "receivers"}))


class RuleAnswer(Answer, of=AlarmRule):
    """A rule."""

    kind: RuleKind
    receivers: list[str]


class DeliveryAnswer(Answer, of=Delivery, without=("job_id",)):
    """One message to one receiver, and what became of it."""

    id: str = Field(description="of the message too: the same at every attempt")
    state: Literal["waiting", "sent", "failed"]
    message: dict[str, object] = Field(description="what is told, as facts")
    error: str | None = Field(description="why the last attempt failed")
    next_at: Instant | None = Field(description="no sooner than this the next attempt is made")


@router.get("/receivers")
def list_receivers(_: Admin, session: Reading) -> list[ReceiverAnswer]:
    """All receivers, oldest first."""
    return [ReceiverAnswer.of(row) for row in outbox.list_receivers(session)]


@router.post("/receivers", status_code=status.HTTP_201_CREATED, response_model=NewReceiver)
def create_receiver(_: Admin, service: TheService, body: ReceiverRequest, once: OnlyOnce) -> Response:
    """Make a receiver. The secret of a webhook is in this answer and nowhere else."""
    if (kept := once.replay(body.model_dump())) is not None:
        return kept
    check_receiver(service.settings, body.kind, body.address)  # in no transaction: it asks for names of hosts

    def work(session: Session) -> Made:
        row = outbox.add_receiver(session, body.name, body.kind, body.address, body.quiet)
        shown = ReceiverAnswer.of(row).model_dump()
        return Made(NewReceiver(**shown, secret=row.secret), repeated=NewReceiver(**shown, secret=None))

    return once.run(work, body.model_dump())


@router.delete("/receivers/{receiver_id}", status_code=status.HTTP_204_NO_CONTENT)
def remove_receiver(admin: Admin, service: TheService, receiver_id: Identifier) -> None:
    """Remove a receiver that no rule names."""
    with service.library.transaction(admin.actor) as session:
        outbox.remove_receiver(session, receiver_id)


@router.post("/receivers/{receiver_id}/test", status_code=status.HTTP_202_ACCEPTED, response_model=DeliveryAnswer)
def send_test(_: Admin, receiver_id: Identifier, once: OnlyOnce) -> Response:
    """Send a message that says that it is a test, quiet hours or not; the outbox says what became of it."""

    def work(session: Session) -> Made:
        row = outbox.post_test(session, receiver_id)
        return Made(DeliveryAnswer.model_validate(row), status=status.HTTP_202_ACCEPTED)

    return once.run(work)


@router.get("/rules")
def list_rules(_: Admin, session: Reading) -> list[RuleAnswer]:
    """All rules, oldest first."""
    return [RuleAnswer.model_validate(row) for row in rules.list_rules(session)]


@router.post("/rules", status_code=status.HTTP_201_CREATED, response_model=RuleAnswer)
def create_rule(_: Admin, body: RuleRequest, once: OnlyOnce) -> Response:
    """Make a rule. A message is sent where it holds already, when it begins to hold, and again after it has ceased."""
    condition = body.condition()

    def work(session: Session) -> Made:
        return Made(RuleAnswer.model_validate(rules.add_rule(session, body.name, condition, body.receivers)))

    answer = once.run(work, body.model_dump())
    settle(once.service.library, once.service.fleet, at_once=True)
    return answer


@router.delete("/rules/{rule_id}", status_code=status.HTTP_204_NO_CONTENT)
def remove_rule(admin: Admin, service: TheService, rule_id: Identifier) -> None:
    """Remove a rule; what is in the outbox is still sent."""
    with service.library.transaction(admin.actor) as session:
        rules.remove_rule(session, rule_id)


@router.get("/deliveries")
def list_deliveries(
    _: Admin, session: Reading, state: StateFilter = None, limit: Limit = 50, cursor: Cursor = None
) -> PageOf[DeliveryAnswer]:
    """The outbox: every message to every receiver, newest first."""
    page = outbox.list_deliveries(session, state=state, limit=limit, cursor=cursor)
    return page_of(page, DeliveryAnswer.model_validate)


@router.post("/deliveries/{delivery_id}/retry", status_code=status.HTTP_202_ACCEPTED)
def retry_delivery(admin: Admin, service: TheService, request: Request, delivery_id: Identifier) -> DeliveryAnswer:
    """Send a message now that was given up or waits for a later attempt; it has ten attempts again."""
    with service.library.transaction(admin.actor, request.scope["request_id"]) as session:
        return DeliveryAnswer.model_validate(outbox.send_now(session, delivery_id))
