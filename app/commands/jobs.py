"""`gearcase jobs list | show | follow | cancel | resume | workers | adopt`."""

from typing import Annotated

import typer
from pydantic_core import to_jsonable_python

from app.commands import DONE, FAILURE, frame
from app.commands.frame import Json
from app.jobs.job import Job
from app.jobs.jobs import open_jobs

jobs = typer.Typer(help="List, follow, cancel, resume and adopt jobs.", no_args_is_help=True)
Id = Annotated[str, typer.Argument(metavar="JOB", help="id of the job")]


@jobs.command("list")
def list_jobs(json: Json = False) -> None:
    """List the newest jobs."""
    with open_jobs(frame.settings()) as opened:
        found = opened.list()
    rows = [
        (
            job.id,
            job.kind,
            job.state,
            job.progress.stage,
            f"{job.progress.fraction:.0%}",
            job.worker or "",
            f"{job.created_at:%Y-%m-%d %H:%M:%SZ}",
        )
        for job in found
    ]
    columns = ("job", "kind", "state", "stage", "done", "worker", "since")
    frame.answer(json, [_document(job) for job in found], frame.table(columns, rows))


@jobs.command()
def show(job: Id, json: Json = True) -> None:
    """Show one job as JSON."""
    with open_jobs(frame.settings()) as opened:
        frame.print_json(_document(opened.get(job)))


@jobs.command()
def follow(job: Id, json: Json = False) -> None:
    """Follow a job to its end.

    The exit code is 0 if it is done, else 1.
    """
    with open_jobs(frame.settings()) as opened, frame.progress() as progress:
        bar = progress.add_task("queued", total=1.0)
        for event in opened.events(job):
            progress.update(bar, completed=event.progress.fraction, description=event.progress.stage)
        ended = opened.get(job)
    _tell(ended, json)
    raise typer.Exit(DONE if ended.state == "done" else FAILURE)


@jobs.command()
def cancel(job: Id, json: Json = False) -> None:
    """Stop a job.

    What is done of it stays, and it can be resumed.
    """
    with open_jobs(frame.settings()) as opened:
        _tell(opened.cancel(job), json)


@jobs.command()
def resume(job: Id, json: Json = False) -> None:
    """Go on with a cancelled job."""
    with open_jobs(frame.settings()) as opened:
        _tell(opened.resume(job), json)


@jobs.command()
def workers(json: Json = False) -> None:
    """List the workers that have jobs or tasks."""
    with open_jobs(frame.settings()) as opened:
        held = opened.workers()
    frame.answer(json, held, *(f"{name}\t{count}" for name, count in sorted(held.items())))


@jobs.command()
def adopt(
    worker: Annotated[str, typer.Argument(metavar="WORKER", help="as `jobs workers` names it")],
    json: Json = False,
) -> None:
    """Give the jobs of a dead worker to others now.

    Without this they take over 15 s after its last sign of life.
    """
    with open_jobs(frame.settings()) as opened:
        count = opened.adopt(worker)
    if json:
        frame.print_json({"worker": worker, "adopted": count})
        return
    frame.say(f"{count} jobs and tasks of {worker} go to the other workers" if count else f"{worker} holds nothing")


def _document(job: Job) -> dict[str, object]:
    document: dict[str, object] = to_jsonable_python(job)
    return document


def _tell(job: Job, json: bool) -> None:
    if json:
        frame.print_json(_document(job))
        return
    reason = f": {job.error}" if job.error else ""
    frame.say(f"job {job.id} is {job.state}, {job.progress.fraction:.0%} done{reason}")
