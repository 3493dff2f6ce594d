"""What a job is, apart from its rows: a name does not cost the import of a database."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal, TypeAlias

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
JobState: TypeAlias = Literal["queued", "running", "done", "failed", "cancelled"]
Report: TypeAlias = Callable[[str, float], None]


@dataclass(frozen=True)
class JobKind:
    """What a kind of job does; registered in `app.jobs.kinds`.

    `plan` cuts the parameters into tasks of 1 to 10 s, `run` does one of them (again, after a worker died) and may
    report (stage, fraction), `finish` makes the result of the results, in the order of the tasks.
    """

    name: str
    stage: str
    plan: Callable[[dict[str, Json]], list[dict[str, Json]]]
    run: Callable[[dict[str, Json], Report], Json]
    finish: Callable[[dict[str, Json], list[Json]], Json]
    priority: int = 10  # lower goes first: what a person waits for before campaigns


@dataclass(frozen=True)
class Progress:
    """How far a job is: fraction in [0, 1], remaining time [s] as estimated from the pace so far."""

    stage: str = "queued"
    fraction: float = 0.0
    done: int = 0
    total: int = 0
    remaining_s: float | None = None


@dataclass(frozen=True)
class Job:
    """One job as the database knows it."""

    id: str
    kind: str
    state: JobState
    progress: Progress
    created_at: datetime
    finished_at: datetime | None
    submitted_by: str | None
    worker: str | None
    result: Any
    error: str | None
    about: str | None
    """The axis, robot or file that it is of."""


@dataclass(frozen=True)
class JobEvent:
    """One entry of a job's history; `number` counts from 0 without gaps."""

    number: int
    progress: Progress


class JobError(Exception):
    """Something asked of the jobs that cannot be done."""


class JobNotFoundError(JobError):
    """There is no job of this id."""


class JobStateError(JobError):
    """The job is in a state in which this cannot be done."""


class JobFailedError(JobError):
    """A task of the job failed."""
