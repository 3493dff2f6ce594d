"""`gearcase jobs list | show | follow | cancel | resume | adopt`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from app.api.jobs import JobDocument
from app.commands.exit_codes import DONE, FAILURE
from app.commands.frame import Frame, frame_of
from app.jobs.job import Job
from app.jobs.kinds import open_jobs

jobs = typer.Typer(help="List, follow, cancel, resume and adopt jobs.", no_args_is_help=True)
Id = Annotated[str, typer.Argument(metavar="JOB", help="id of the job")]
AsJson = Annotated[bool, typer.Option("--json", help="one JSON document on stdout")]


def register(app: typer.Typer) -> None:
    app.add_typer(jobs, name="jobs")


@jobs.command("list")
def list_jobs(context: typer.Context, json: AsJson = False) -> None:
    """List the newest jobs."""
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened:
        found = opened.list()
    if json:
        frame.print_json([_document(job) for job in found])
        return
    table = Table("job", "kind", "state", "stage", "done", "worker", "since")
    for job in found:
        done = f"{job.progress.fraction:.0%}"
        since = f"{job.created_at:%Y-%m-%d %H:%M:%SZ}"
        table.add_row(job.id, job.kind, job.state, job.progress.stage, done, job.worker or "", since)
    frame.results.print(table)


@jobs.command()
def show(context: typer.Context, job: Id, json: AsJson = True) -> None:
    """Show one job as JSON."""
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened:
        frame.print_json(_document(opened.get(job)))


@jobs.command()
def follow(context: typer.Context, job: Id, json: AsJson = False) -> None:
    """Follow a job to its end.

    The exit code is 0 if it is done, else 1.
    """
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened, frame.progress() as progress:
        bar = progress.add_task("queued", total=1.0)
        for event in opened.events(job):
            if event is not None:
                progress.update(bar, completed=event.progress.fraction, description=event.progress.stage)
        ended = opened.get(job)
    _tell(frame, ended, json)
    raise typer.Exit(DONE if ended.state == "done" else FAILURE)


@jobs.command()
def cancel(context: typer.Context, job: Id, json: AsJson = False) -> None:
    """Stop a job.

    What is done of it stays, and it can be resumed.
    """
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened:
        _tell(frame, opened.cancel(job), json)


@jobs.command()
def resume(context: typer.Context, job: Id, json: AsJson = False) -> None:
    """Go on with a cancelled job."""
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened:
        _tell(frame, opened.resume(job), json)


@jobs.command()
def workers(context: typer.Context, json: AsJson = False) -> None:
    """List the workers that have jobs or tasks."""
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened:
        held = opened.workers()
    if json:
        frame.print_json(held)
        return
    for name, count in sorted(held.items()):
        frame.print(f"{name}\t{count}")


@jobs.command()
def adopt(
    context: typer.Context,
    worker: Annotated[str, typer.Argument(metavar="WORKER", help="as `jobs workers` names it")],
    json: AsJson = False,
) -> None:
    """Give the jobs of a dead worker to others now.

    Without this they take over 15 s after its last sign of life.
    """
    frame = frame_of(context)
    with open_jobs(frame.settings) as opened:
        count = opened.adopt(worker)
    if json:
        frame.print_json({"worker": worker, "adopted": count})
        return
    frame.say(f"{count} jobs and tasks of {worker} go to the other workers" if count else f"{worker} holds nothing")


def _document(job: Job) -> dict[str, object]:
    return JobDocument.of(job).model_dump(mode="json")


def _tell(frame: Frame, job: Job, json: bool) -> None:
    if json:
        frame.print_json(_document(job))
        return
    reason = f": {job.error}" if job.error else ""
    frame.say(f"job {job.id} is {job.state}, {job.progress.fraction:.0%} done{reason}")
