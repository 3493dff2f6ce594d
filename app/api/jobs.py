"""Jobs: how far they are, live over server-sent events, cancelled and resumed."""

from collections.abc import AsyncIterator
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Path, Query
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import BaseModel, ConfigDict

from app.documents import CONTINUES, Limit, PageOf, page_of
from app.http.security import Operator
from app.jobs.job import Job, JobState
from app.service import TheJobs, TheService

router = APIRouter(tags=["jobs"])
PATIENCE_S = 2.0
"""So long after it is told to stop, the service still waits for a job that says nothing."""

JobId = Annotated[
    str,
    Path(min_length=1, max_length=100, pattern=r"^[0-9A-Za-z-]+$", description="as answered by what ordered the job"),
]
After = Annotated[
    str | None,
    Query(max_length=120, description=CONTINUES, json_schema_extra={"pattern": r"^[0-9]{1,16}\.[0-9A-Za-z-]{1,100}$"}),
]


class ProgressDocument(BaseModel):
    """How far a job is."""

    model_config = ConfigDict(from_attributes=True)

    stage: str
    fraction: float
    done: int
    total: int
    remaining_s: float | None


class JobDocument(BaseModel):
    """A job."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    kind: str
    state: JobState
    progress: ProgressDocument
    created_at: datetime
    finished_at: datetime | None
    submitted_by: str | None
    worker: str | None
    result: Any
    error: str | None

    @classmethod
    def of(cls, job: Job) -> "JobDocument":
        return cls.model_validate(job)


def existing(job_id: JobId, jobs: TheJobs) -> Job:
    """The job, before anything is answered."""
    return jobs.get(job_id)


Existing = Annotated[Job, Depends(existing)]


@router.get("/jobs", summary="Jobs, newest first")
def list_jobs(jobs: TheJobs, _: Operator, limit: Limit = 50, cursor: After = None) -> PageOf[JobDocument]:
    """Without their results, which `GET /jobs/{id}` has."""
    return page_of(jobs.page(limit=limit, cursor=cursor), JobDocument.of)


@router.get("/jobs/{job_id}/events", summary="What happens to a job, live", response_class=EventSourceResponse)
async def job_events(
    _: Operator,  # first: who may not ask does not learn which jobs there are
    job: Existing,
    jobs: TheJobs,
    service: TheService,
    last_event_id: Annotated[
        int | None, Header(alias="Last-Event-ID", ge=0, le=2**31 - 1, description="go on after this event")
    ] = None,
) -> AsyncIterator[ServerSentEvent]:
    """Every `progress` event has a number; a client that comes back with the last one it saw misses none.

    The stream ends with an `end` event that holds the job as `GET /jobs/{id}` gives it; without one, when the service
    stops.
    """
    after = -1 if last_event_id is None else last_event_id
    async for event in service.job_feed.follow(job.id, after=after, patience_s=PATIENCE_S):
        if service.stopping.is_set():
            return
        if event is None:
            yield ServerSentEvent(comment="still there")
            continue
        document = ProgressDocument.model_validate(event.progress)
        yield ServerSentEvent(event="progress", id=str(event.number), data=document)
    yield ServerSentEvent(event="end", data=JobDocument.of(await run_in_threadpool(jobs.get, job.id)))


@router.get("/jobs/{job_id}", summary="A job and how far it is")
def get_job(job_id: JobId, jobs: TheJobs, _: Operator) -> JobDocument:
    return JobDocument.of(jobs.get(job_id))


@router.delete("/jobs/{job_id}", summary="Cancel a job")
def cancel_job(job_id: JobId, jobs: TheJobs, _: Operator) -> JobDocument:
    """Running tasks end, waiting ones never start; what is done stays. A cancelled job can be resumed."""
    return JobDocument.of(jobs.cancel(job_id))


@router.post("/jobs/{job_id}/resume", summary="Go on with a cancelled job")
def resume_job(job_id: JobId, jobs: TheJobs, _: Operator) -> JobDocument:
    return JobDocument.of(jobs.resume(job_id))
