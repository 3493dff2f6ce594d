"""Jobs: how far they are, live over server-sent events, cancelled and resumed; and simulations, which are jobs."""

from collections.abc import AsyncIterator
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Header, Path, Request, Response, status
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import Field, PositiveFloat
from sqlalchemy.orm import Session

from app.documents import Cursor, Limit, PageOf, Question
from app.http.headers import location
from app.http.idempotency import Made, OnlyOnce
from app.http.security import Admin, Operator
from app.jobs.job import Job
from app.service import Service, TheJobs, TheService
from app.simulated.generation import KIND, Campaign, fitted_microphones
from casebase.axes import get_axis
from casebase.description import check_name
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.design_of_experiments import DURATION_S, LABELS, labels

router = APIRouter(tags=["jobs"])
PATIENCE_S = 2.0
"""So long after it is told to stop, the service still waits for a job that says nothing."""

JobId = Annotated[
    str,
    Path(min_length=1, max_length=100, pattern=r"^[0-9A-Za-z-]+$", description="as answered by what ordered the job"),
]


def existing(job_id: JobId, jobs: TheJobs) -> Job:
    """The job, before anything is answered."""
    return jobs.get(job_id)


Existing = Annotated[Job, Depends(existing)]


@router.get("/jobs", summary="Jobs, newest first")
def list_jobs(jobs: TheJobs, _: Operator, limit: Limit = 50, cursor: Cursor = None) -> PageOf[Job]:
    page = jobs.page(limit=limit, cursor=cursor)
    return PageOf(items=list(page.items), next_cursor=page.next_cursor)


@router.get("/jobs/{job_id}/events", summary="What happens to a job, live", response_class=EventSourceResponse)
async def job_events(
    operator: Operator,  # first: who may not ask does not learn which jobs there are
    job: Existing,
    jobs: TheJobs,
    service: TheService,
    last_event_id: Annotated[
        int | None, Header(alias="Last-Event-ID", ge=0, le=2**31 - 1, description="go on after this event")
    ] = None,
) -> AsyncIterator[ServerSentEvent]:
    """Every `progress` event has a number; a client that comes back with the last one it saw misses none.

    The stream ends with an `end` event that holds the job as `GET /jobs/{id}` gives it; without one, when the service
    stops, or the key or session of who listens is over.
    """
    after = -1 if last_event_id is None else last_event_id
    async for event in service.job_feed.follow(job.id, after=after, patience_s=PATIENCE_S):
        if service.stopping.is_set() or not await service.in_force.has(operator.credential):
            return
        if event is None:
            yield ServerSentEvent(comment="still there")
            continue
        yield ServerSentEvent(event="progress", id=str(event.number), data=event.progress)
    yield ServerSentEvent(event="end", data=await run_in_threadpool(jobs.get, job.id))


@router.get("/jobs/{job_id}", summary="A job and how far it is")
def get_job(job_id: JobId, jobs: TheJobs, _: Operator) -> Job:
    return jobs.get(job_id)


@router.delete("/jobs/{job_id}", summary="Cancel a job")
def cancel_job(job_id: JobId, jobs: TheJobs, _: Operator) -> Job:
    """Running tasks end, waiting ones never start; what is done stays. A cancelled job can be resumed."""
    return jobs.cancel(job_id)


@router.post("/jobs/{job_id}/resume", summary="Go on with a cancelled job")
def resume_job(job_id: JobId, jobs: TheJobs, _: Operator) -> Job:
    return jobs.resume(job_id)


simulations = APIRouter(tags=["simulations"])

Count = Annotated[int, Field(ge=0, le=10_000)]
Span = Annotated[tuple[PositiveFloat, PositiveFloat], Field(examples=[[20.0, 40.0]])]
LABEL_NAMES = ", ".join(labels())


class SimulationRequest(
    Question, json_schema_extra={"examples": [{"axis": "axis-a", "counts": {"normal": 50, "play": 100}}]}
):
    """What is to be generated."""

    axis: dict[str, object] | str = Field(description="an axis description, or the name of a stored one")
    per_label: Count = Field(100, description=f"cases of each of {', '.join(LABELS)}")
    counts: dict[str, Count] | None = Field(None, description=f"cases by label instead; labels are {LABEL_NAMES}")
    seed: int = Field(0, ge=0, lt=2**31, description="the same seed gives the same cases")
    duration_s: float = Field(DURATION_S, ge=1.0, le=120.0, description="of each recording [s]")
    payload_kg_m2: Span | None = Field(None, description="from, to; around the axis's own if not given [kg m2]")
    speed_rad_s: Span | None = Field(None, description="from, to; around the axis's own if not given [rad/s]")
    motion: Literal["described", "any"] = Field(
        "described", description="described: stroke, acceleration time and rest around those of the description"
    )
    fitted: bool = Field(True, description="use the sound fitted to the place, where there is one")


@simulations.post("/simulations", status_code=status.HTTP_202_ACCEPTED, response_model=Job)
def simulate(wanted: SimulationRequest, _: Admin, once: OnlyOnce, request: Request) -> Response:
    """Generate cases for an axis: a space-filling plan over fault size, place and flank, payload, speed, microphone
    and noise. Cases that are there already are not made again.

    Answers the job; follow it at its `Location`.
    """
    campaign = campaign_of(once.service, wanted)

    def work(session: Session) -> Made:
        job = once.service.jobs.order(session, KIND, campaign.to_document(), submitted_by=once.principal.actor)
        return Made(job, location(request, "get_job", job_id=job.id), status=status.HTTP_202_ACCEPTED)

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
        wanted.motion,
    )


def _axis(service: Service, given: dict[str, object] | str) -> Axis:
    if not isinstance(given, str):
        axis = read_axis(given)
        check_name("axis.name", axis.name)
        return axis
    with service.library.reading() as session:
        return read_axis(get_axis(session, given, None).document)
