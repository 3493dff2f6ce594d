"""The library as a whole: how well it does on gearboxes that it has not seen."""

from typing import Literal

from fastapi import APIRouter

from app.documents import EvaluationAnswer
from app.security import Viewer
from app.service import Reading, TheService

router = APIRouter(prefix="/library", tags=["library"])


@router.get("/evaluation")
def evaluation(
    _: Viewer,
    session: Reading,
    service: TheService,
    group: Literal["gearbox", "axis", "case"] = "gearbox",
    origin: Literal["measured", "simulated", "both"] = "both",
) -> EvaluationAnswer:
    """Leave out one gearbox at a time, learn from the others and diagnose it; kept until the library changes."""
    return EvaluationAnswer.model_validate(service.evaluation(session, group, origin).to_document())
