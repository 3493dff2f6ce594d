"""A worker process with a kind of job made for the tests: each task writes its number into a file, slowly."""

import os
import sys
import time
from pathlib import Path

from app.jobs.job import JobKind, Json, Report
from app.jobs.runner import run_worker
from app.logs import leave, stop_on_signals
from casebase.library import CaseLibrary


def plan(parameters: dict[str, Json]) -> list[dict[str, Json]]:
    count = parameters["count"]
    assert isinstance(count, int)
    return [{**parameters, "number": number} for number in range(count)]


def run(task: dict[str, Json], report: Report) -> Json:
    """Leave a file named by the task; append to the diary when it was not there (idempotent by key)."""
    folder, number = Path(str(task["folder"])), task["number"]
    if number == task.get("bad"):
        raise ValueError(f"number {number} is bad")
    report("half", 0.5)
    time.sleep(float(str(task["seconds"])))
    with (folder / "attempts").open("a") as diary:
        diary.write(f"{number} {os.getpid()}\n")
    try:
        os.close(os.open(folder / f"done-{number}", os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return {"number": number, "new": False}
    return {"number": number, "new": True}


def finish(parameters: dict[str, Json], results: list[Json]) -> Json:
    return {"numbers": [result["number"] for result in results if isinstance(result, dict)]}


COUNT = JobKind("count", "counting", plan, run, finish)

if __name__ == "__main__":
    data_dir, url, name, lease_s = sys.argv[1:]
    stop = stop_on_signals()
    lost = run_worker(CaseLibrary.open(Path(data_dir), url or None), [COUNT], name, stop=stop, lease_s=float(lease_s))
    leave(again=lost)
