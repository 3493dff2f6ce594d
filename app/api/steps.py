"""Steps: what people did to diagnoses and cases, and how each is taken back."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Response
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from app.documents import Instant
from app.http.errors import Forbidden
from app.http.headers import Made, OnlyOnce
from app.http.security import Operator, Role, Viewer
from app.report.steps import described
from app.service import Reading
from casebase.errors import NotFoundError
from casebase.steps import entries_of, standing, stands, undo
from casebase.store.models import AuditEntry

router = APIRouter(tags=["steps"], prefix="/steps")
LARGEST = 2**31 - 1
Number = Annotated[int, Path(ge=1, le=LARGEST, description="of the step, as `GET /steps` answers it")]


class SubjectAnswer(BaseModel):
    """What a step was about."""

    kind: Literal["diagnosis", "case"]
    id: str


class StepAnswer(BaseModel):
    """A verdict, a case kept, or a change of cases, with all that was done together with it."""

    number: int
    what: str = Field(description="one sentence")
    subjects: list[SubjectAnswer]
    at: Instant
    by: str
    stands: bool = Field(description="false once it was taken back")
    role: Role = Field(description="who may take it back, with this role or a higher one: cases are changed by admins")


class StepsAnswer(BaseModel):
    """The steps with a subject."""

    items: list[StepAnswer]


@router.get("")
def steps(
    _: Viewer,
    session: Reading,
    kind: Annotated[Literal["diagnosis", "case"], Query(description="of what the steps were taken with")],
    subject: Annotated[str, Query(pattern=r"^[0-9a-f]{32}$", description="its id")],
) -> StepsAnswer:
    """The steps with a diagnosis or case that stand, the newest first: the order in which they can be taken back."""
    found = dict.fromkeys(entries_of(session, each.id)[0].id for each in reversed(standing(session, (kind, subject))))
    return StepsAnswer(items=[_answer(session, entries_of(session, number)) for number in found])


@router.get("/{number}")
def step(_: Viewer, session: Reading, number: Number) -> StepAnswer:
    """One step, also after it was taken back."""
    return _answer(session, _entries(session, number))


@router.post("/{number}/undo", response_model=StepAnswer)
def take_back(_: Operator, once: OnlyOnce, number: Number) -> Response:
    """Take a step back, all of it: diagnoses and cases are as they were before. The audit keeps both.

    Steps are taken back in the opposite order: 409 where a later one stands, or where it was taken back already.
    """

    def work(session: Session) -> Made:
        entries = _entries(session, number)
        before = _answer(session, entries)
        if not once.principal.role.may(before.role):
            raise Forbidden(f"This step takes the role {before.role}; the key has the role {once.principal.role}.")
        undo(session, number)
        return Made(before.model_copy(update={"stands": False}), status=200)

    return once.run(work)


def _entries(session: Session, number: int) -> list[AuditEntry]:
    entries = entries_of(session, number)
    if not entries:
        raise NotFoundError(f"no step has the number {number}: GET /steps names those with a diagnosis or case")
    return entries


def _answer(session: Session, entries: list[AuditEntry]) -> StepAnswer:
    newest, said = entries[0], described(session, entries)
    return StepAnswer.model_validate(
        {
            "number": newest.id,
            "what": said.words,
            "subjects": [{"kind": each.subject_kind, "id": each.subject_id} for each in entries],
            "at": newest.at,
            "by": newest.actor,
            "stands": stands(session, newest),
            "role": Role.ADMIN if said.by_admin else Role.OPERATOR,
        }
    )
