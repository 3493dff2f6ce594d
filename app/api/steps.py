"""Steps: what people did to diagnoses and cases, in words, and how each is taken back."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Response
from pydantic import BaseModel, Field
from sqlalchemy.orm import Session

from app.documents import Instant
from app.http.errors import Forbidden
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Operator, Role, Viewer
from app.report.formatting import name_of
from app.service import Reading
from casebase.cycle.retain import RETAINED
from casebase.cycle.revise import CHANGED
from casebase.diagnoses import get_diagnosis
from casebase.errors import NotFoundError
from casebase.steps import entries_of, standing, stands, undo
from casebase.store.models import AuditEntry, Case


@dataclass(frozen=True)
class StepTaken:
    """A step in words.

    Args:
        number: of its entry in the audit.
        words: one sentence.
        path: the page of what it was about, below the root.
        kept: id of the case that was kept by it.
        by_admin: whether only admins take such a step.
    """

    number: int
    words: str
    path: str
    kept: str | None
    by_admin: bool


def told(session: Session, number: int | None) -> StepTaken | None:
    """Return what a step was; None where no such step stands any more."""
    entries = entries_of(session, number) if number else []
    return described(session, entries) if entries and stands(session, entries[0]) else None


def described(session: Session, entries: Sequence[AuditEntry]) -> StepTaken:
    """Return in words what the entries of one step say, the newest first."""
    revised = next((one for one in entries if one.subject_kind == "diagnosis"), None)
    cases = [one.subject_id for one in entries if one.action == RETAINED]
    kept = cases[0] if len(cases) == 1 else None
    changed = [one.subject_id for one in entries if one.action == CHANGED]
    words, path = [], "/library"
    if revised is not None:
        words.append(_revised(session, revised))
        path = f"/diagnoses/{revised.subject_id}"
    if len(cases) > 1:
        words.append(f"{len(cases)} cases were kept")
    if kept is not None:
        case = session.get(Case, kept)
        words.append("kept as a case of the library" if revised else "A case was kept")
        if revised is None:
            path = f"/diagnoses/{case.diagnosis_id}" if case and case.diagnosis_id else f"/cases/{kept}"
    if changed:
        labels = dict.fromkeys(
            name_of(str(one.after["label"])) for one in entries if one.action == CHANGED and "label" in one.after
        )
        what = f"labelled {', '.join(labels)}" if labels else "changed"
        words.append(f"{len(changed)} {'case' if len(changed) == 1 else 'cases'} {what}")
        path = f"/cases/{changed[0]}" if len(changed) == 1 else "/library"
    return StepTaken(entries[0].id, f"{' and '.join(words)}.", path, kept, bool(cases or changed))


def _revised(session: Session, entry: AuditEntry) -> str:
    name = get_diagnosis(session, entry.subject_id).recording.file_name
    state, label = entry.after["state"], entry.after["label"]
    return f"{name}: {state}{f' as {name_of(str(label))}' if label else ''}"


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
