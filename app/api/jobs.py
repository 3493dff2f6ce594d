"""Jobs: how far they are, live over server-sent events, cancelled and resumed."""

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Path
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import EventSourceResponse, ServerSentEvent

from app.documents import Cursor, Limit, PageOf
from app.http.security import Operator
from app.jobs.job import Job
from app.service import TheJobs, TheService

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
