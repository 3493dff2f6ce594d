"""Simulations: cases generated for an axis, as a job."""

from typing import Annotated

from fastapi import APIRouter, Request, Response, status
from pydantic import Field, PositiveFloat
from sqlalchemy.orm import Session

from app.documents import Question
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin
from app.jobs.job import Job
from app.service import Service
from app.simulated.generation import KIND, Campaign, fitted_microphones
from casebase.axes import get_axis
from casebase.description import check_name
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import DURATION_S, LABELS, labels

router = APIRouter(tags=["simulations"])

Count = Annotated[int, Field(ge=0, le=10_000)]
Span = Annotated[tuple[PositiveFloat, PositiveFloat], Field(examples=[[20.0, 40.0]])]
LABEL_NAMES = ", ".join(labels())


class SimulationRequest(Question):
    """What is to be generated."""

    axis: dict[str, object] | str = Field(description="an axis description, or the name of a stored one")
    per_label: Count = Field(100, description=f"cases of each of {', '.join(LABELS)}")
    counts: dict[str, Count] | None = Field(
        None, description=f"cases by label instead; labels are {LABEL_NAMES}", examples=[{"normal": 50, "play": 100}]
    )
    seed: int = Field(0, ge=0, lt=2**31, description="the same seed gives the same cases")
    duration_s: float = Field(DURATION_S, ge=1.0, le=120.0, description="of each recording [s]")
    payload_kg_m2: Span | None = Field(None, description="from, to; around the axis's own if not given [kg m2]")
    speed_rad_s: Span | None = Field(None, description="from, to; around the axis's own if not given [rad/s]")
    fitted: bool = Field(True, description="use the sound fitted to the place, where there is one")


@router.post("/simulations", status_code=status.HTTP_202_ACCEPTED, response_model=Job)
def simulate(wanted: SimulationRequest, _: Admin, once: OnlyOnce, request: Request) -> Response:
    """Generate cases for an axis: a space-filling plan over fault size, place and flank, payload, speed, microphone
    and noise. Cases that are there already are not made again.

    Answers the job; follow it at its `Location`.
    """
    campaign = campaign_of(once.service, wanted)

    def work(session: Session) -> Made:
        job = once.service.jobs.order(session, KIND, campaign.to_document(), submitted_by=once.principal.actor)
        location = str(request.url_for("get_job", job_id=job.id).path)
        return Made(job, location, status=status.HTTP_202_ACCEPTED)

    return once.run(work, wanted.model_dump(mode="json"))


def campaign_of(service: Service, wanted: SimulationRequest) -> Campaign:
    """The campaign that a request describes. Raises SimulationError and NotFoundError."""
    axis = _axis(service, wanted.axis)
    microphones, version = fitted_microphones(service.library, axis) if wanted.fitted else ((), None)
    counts = dict.fromkeys(LABELS, wanted.per_label) if wanted.counts is None else wanted.counts
    return Campaign(
        axis,
        counts,
        wanted.seed,
        wanted.duration_s,
        microphones,
        version,
        wanted.payload_kg_m2,
        wanted.speed_rad_s,
    )


def _axis(service: Service, given: dict[str, object] | str) -> Axis:
    if not isinstance(given, str):
        axis = read_axis(given)
        check_name("axis.name", axis.name)
        return axis
    with service.library.reading() as session:
        return read_axis(get_axis(session, given, None).document)
