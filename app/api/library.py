"""The library as a whole: how well it does on gearboxes that it has not seen."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from app.documents import EvaluationAnswer
from app.http.security import Viewer
from app.service import Reading, TheService
from casebase.review import review


class FindingAnswer(BaseModel):
    """A case to look at."""

    case_id: str
    label: str
    origin: Literal["measured", "simulated"]
    reason: str
    other_id: str | None


class HoleAnswer(BaseModel):
    """What has no case, and how many would fill it."""

    label: str
    reason: str
    cases: int
    payload_kg_m2: tuple[float, float] | None
    speed_rad_s: tuple[float, float] | None


class PlanAnswer(BaseModel):
    """Cases to generate: by label, and hole by hole, each of which `POST /simulations` takes beside an axis."""

    counts: dict[str, int]
    campaigns: list[dict[str, dict[str, int] | tuple[float, float]]]


class CompetenceAnswer(BaseModel):
    """How much the library knows by itself (Smyth and McKenna 2001)."""

    solved: int = Field(description="cases looked at that a nearer case of their label, of another gearbox, solves")
    of: int = Field(description="cases looked at")
    footprint: int = Field(description="how few cases solve as many")


class ReviewAnswer(BaseModel):
    """What a look through the library found."""

    cases: int
    looked_at: int = Field(description="cases held against all others: all of them in a library of up to 10,000")
    redundant: list[FindingAnswer]
    contradictory: list[FindingAnswer]
    suspect: list[FindingAnswer]
    far: list[FindingAnswer]
    uncovered: list[HoleAnswer]
    competence: CompetenceAnswer
    plan: PlanAnswer


router = APIRouter(prefix="/library", tags=["library"])


@router.get("/evaluation")
def evaluation(
    _: Viewer,
    session: Reading,
    service: TheService,
    group: Annotated[Literal["gearbox", "axis", "case"], Query(description="what is left out together")] = "gearbox",
    origin: Annotated[
        Literal["measured", "simulated", "both"], Query(description="cases that answers are given from")
    ] = "both",
) -> EvaluationAnswer:
    """Leave out one gearbox at a time and diagnose it from the others; kept until the library changes."""
    return EvaluationAnswer.model_validate(service.evaluation(session, group, origin).to_document())


@router.get("/review")
def get_review(_: Viewer, session: Reading, service: TheService) -> ReviewAnswer:
    """Redundant, contradictory, suspect and far cases, and what is missing.

    `plan` holds what `POST /simulations` takes: the counts of all holes together, and `campaigns` hole by hole.
    """
    return ReviewAnswer.model_validate(review(session, service.library.reuse.reasoner(session)).to_document())
