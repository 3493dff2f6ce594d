"""What the service takes, so that nobody has to find out by trying."""

from dataclasses import asdict

from fastapi import APIRouter

from app.documents import LimitsAnswer
from app.http.security import Viewer
from app.service import TheService
from signals.reading.decode import LIMITS

router = APIRouter(tags=["service"])


@router.get("/limits")
def limits(_: Viewer, service: TheService) -> LimitsAnswer:
    """Sizes [byte], times [s] and counts that requests must keep to."""
    decoding = {name: value for name, value in asdict(LIMITS).items() if name != "lossy"}
    return LimitsAnswer(**service.settings.model_dump(include=set(LimitsAnswer.model_fields)), decoding=decoding)
